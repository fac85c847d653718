// SPDX-License-Identifier: Apache-2.0
#include "engine/formats/lenses/cahvor.h"

#include <Eigen/Geometry>
#include <Eigen/LU>
#include <cmath>

#include "calib/base/format_error.h"
#include "engine/formats/lens_form.h"

namespace plenocal {
namespace {

const LensTable& CahvorLenses() {
  static const LensTable kTable{
      "cahvor",
      {{"pinhole", "cahvor", "0 0 0 0 0 0"},
       {"pinhole-radial3", "cahvor", "A_0 A_1 0 0 0 0"},
       {"pinhole-radial3+tilt", "cahvor", "A_0 A_1 0 tau_x tau_y 0"},
       {"pinhole-radial3+tilt+skew", "cahvor", "A_0 A_1 0 tau_x tau_y alpha_s"}}};
  return kTable;
}

/// The part `tilt` as a homography; its last row is that of a rotation.
Eigen::Matrix3d TiltMatrix(double tau_x, double tau_y) {
  const double cx = std::cos(tau_x), sx = std::sin(tau_x), cy = std::cos(tau_y),
               sy = std::sin(tau_y);
  Eigen::Matrix3d R, P;
  R << cy, sy * sx, -sy * cx, 0, cx, sx, sy, -cy * sx, cy * cx;
  P << R(2, 2), 0, -R(0, 2), 0, R(2, 2), -R(1, 2), 0, 0, 1;
  return P * R;
}

/// A homography as an upper triangle after a tilt.
struct TiltedMatrix {
  Eigen::Matrix3d K;
  double tau_x = 0, tau_y = 0;
};

TiltedMatrix SplitTilt(const Eigen::Matrix3d& homography) {
  TiltedMatrix split;
  const double norm = homography.row(2).norm();
  const Eigen::Vector3d n = homography.row(2) / norm;
  split.tau_y = std::asin(n.x());
  split.tau_x = std::atan2(-n.y(), n.z());
  split.K = homography * TiltMatrix(split.tau_x, split.tau_y).inverse() / norm;
  return split;
}

}  // namespace

CalibratedCamera FromCahvor(const Cahvor& cahvor, ImageSize image_size, const std::string& where) {
  const double scale = 1 + cahvor.R[0];
  const Eigen::Vector3d A = cahvor.HVA.row(2);
  if (!(scale > 0)) throw InputError("{}: R: expected a first number above -1", where);
  if (!(A.norm() > 0 && cahvor.O.norm() > 0 && A.dot(cahvor.O) > 0 &&
        cahvor.HVA.determinant() > 0)) {
    throw InputError("{}: A, H, V and O are no camera", where);
  }
  // Columns: the axes of a frame with z along O, of which x is near that of the image.
  const Eigen::Vector3d z = cahvor.O.normalized();
  const Eigen::Vector3d y = z.cross(Eigen::Vector3d(cahvor.HVA.row(0).cross(A).cross(A) * -1));
  Eigen::Matrix3d axes;
  axes << y.normalized().cross(z), y.normalized(), z;
  // The rotation about O that makes K an upper triangle; the tilt changes a little with it.
  constexpr int kMost = 100;
  TiltedMatrix split;
  for (int i = 0; i < kMost; ++i) {
    split = SplitTilt(cahvor.HVA * axes * Eigen::Vector3d(scale, scale, 1).asDiagonal());
    const double phi = std::atan2(split.K(1, 0), split.K(1, 1));
    if (std::abs(phi) < 1e-16) break;
    axes *= Eigen::AngleAxisd(-phi, Eigen::Vector3d::UnitZ()).matrix();
  }
  const Eigen::Matrix3d& K = split.K;
  CalibratedCamera camera = FromLens(
      {"cahvor",
       K(0, 0),
       K(1, 1),
       K(0, 2),
       K(1, 2),
       {cahvor.R[1] / scale, cahvor.R[2] / scale, 0, split.tau_x, split.tau_y, K(0, 1) / K(0, 0)}},
      image_size,
      CahvorLenses(),
      where);
  camera.T_camera_rig = {axes.transpose(), -(axes.transpose() * cahvor.C)};
  return camera;
}

Cahvor ToCahvor(const CalibratedCamera& camera) {
  const Lens lens = ToLens(camera, CahvorLenses());
  const std::vector<double>& k = lens.coefficients;
  Eigen::Matrix3d K;
  K << lens.f_x, lens.f_x * k[5], lens.c_x, 0, lens.f_y, lens.c_y, 0, 0, 1;
  Eigen::Matrix3d M = K * TiltMatrix(k[3], k[4]);
  // H and V are orthogonal but for A when (H x A) . (V x A) = 0; a factor 1 / s of the first two
  // columns, which R_0 = s - 1 takes back, divides the product's first two terms by s^2 and the
  // third one by s^4.
  const Eigen::Vector3d H = M.row(0), V = M.row(1), A = M.row(2);
  const Eigen::Vector3d terms = H.cross(A).cwiseProduct(V.cross(A));
  const double first = terms[0] + terms[1], third = terms[2];
  constexpr double kRounding = 1e-12;
  double s = 1;
  if (std::abs(first + third) > kRounding * H.cross(A).norm() * V.cross(A).norm()) {
    if (!(first * third < 0)) {
      throw JobError(
          "camera '{}': a skew of {} without a tilt has no place in cahvor", camera.name, k[5]);
    }
    s = std::sqrt(-third / first);
  }
  M *= Eigen::Vector3d(1 / s, 1 / s, 1).asDiagonal();
  Cahvor cahvor;
  cahvor.HVA = M * camera.T_camera_rig.R / M.row(2).norm();
  cahvor.C = camera.T_camera_rig.Inverse().t;
  cahvor.O = camera.T_camera_rig.R.row(2);
  cahvor.R = {s - 1, s * k[0], s * k[1]};
  return cahvor;
}

}  // namespace plenocal
