// SPDX-License-Identifier: Apache-2.0
#include "assess/views/projection_sigma.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "assess/views/micro_lens_visibility.h"
#include "assess/views/projection_jacobian.h"
#include "calib/base/format_error.h"
#include "calib/base/linear_algebra.h"

namespace plenocal {
namespace {

constexpr int kGridColumns = 16, kGridRows = 12;

/// Derivatives of one projected point by the unknowns in units and by a motion of the rig's frame.
struct GridPoint : ProjectionSigma::Result {
  Eigen::Matrix<double, 2, 6> by_motion;
};

class Grid {
 public:
  Grid(const RigEstimate& rig, const RigUnknowns& unknowns)
      : rig_(rig), unknowns_(unknowns), scale_(UnknownScales(rig, unknowns)) {}

  std::vector<GridPoint> Make(const std::vector<double>& distances) {
    for (size_t c = 0; c < rig_.bundle.cameras.size(); ++c) AddCamera(c, distances);
    return std::move(points_);
  }

 private:
  void AddCamera(size_t c, const std::vector<double>& distances) {
    const BundleCamera& camera = rig_.bundle.cameras[c];
    const MicroLensVisibility lenses =
        rig_.lenses[c].lenses.empty() ? MicroLensVisibility() : MicroLensVisibility(rig_.lenses[c]);
    if (camera.model->plenoptic && !lenses.HasLenses()) return;
    for (int row = 0; row < kGridRows; ++row) {
      for (int column = 0; column < kGridColumns; ++column) {
        const Eigen::Vector2d u_px((column + 0.5) / kGridColumns * camera.image_size[0] - 0.5,
                                   (row + 0.5) / kGridRows * camera.image_size[1] - 0.5);
        std::array<double, kMaxObservationSize> values{u_px.x(), u_px.y()};
        if (camera.model->plenoptic) {
          // Beside the middle of a micro image, on sides that change: there the depth shows.
          const Eigen::Vector2d lens = lenses.Nearest(u_px);
          const double side = rig_.lenses[c].Pitch() / 4 * ((row + column) % 2 == 0 ? 1 : -1);
          values = {lens.x() + side, lens.y(), lens.x(), lens.y()};
        }
        for (const double distance : distances) {
          Add(c, RegionOf(u_px, camera.image_size), values, distance);
        }
      }
    }
  }

  void Add(size_t c,
           size_t region,
           const std::array<double, kMaxObservationSize>& values,
           double distance) {
    const BundleCamera& camera = rig_.bundle.cameras[c];
    const auto ray =
        camera.model->Unproject(camera.params.data(), camera.config.data(), values.data());
    if (!ray) return;
    const Eigen::Vector3d p_cam = ray->origin + distance * ray->direction;
    ProjectionJacobian J;
    if (!Differentiate(camera, values.data(), p_cam, &J)) return;
    GridPoint point{{c, region, Eigen::MatrixXd::Zero(2, scale_.size())}, {}};
    for (Eigen::Index k = 0; k < J.by_params.cols(); ++k) {
      const int index = unknowns_.params[c][static_cast<size_t>(k)];
      if (index >= 0) point.by_unknowns.col(index) = scale_[index] * J.by_params.col(k);
    }
    // Retract turns and shifts the point in the camera's frame, the motion in the rig's.
    const RigidTransform& T = camera.T_camera_rig;
    if (const int first = unknowns_.extrinsics[c]; first >= 0) {
      Eigen::Matrix<double, 3, 6> moved;
      moved << Eigen::Matrix3d::Identity(), -Hat(p_cam - T.t);
      point.by_unknowns.middleCols<6>(first) =
          J.by_point * moved * scale_.segment<6>(first).asDiagonal();
    }
    Eigen::Matrix<double, 3, 6> motion;
    motion << T.R, -T.R * Hat(T.Inverse() * p_cam);
    point.by_motion = J.by_point * motion;
    points_.push_back(std::move(point));
  }

  const RigEstimate& rig_;
  const RigUnknowns& unknowns_;
  Eigen::VectorXd scale_;
  std::vector<GridPoint> points_;
};

}  // namespace

ProjectionSigma::ProjectionSigma(const RigEstimate& rig,
                                 const RigUnknowns& unknowns,
                                 const std::vector<double>& distances) {
  const std::vector<GridPoint> points = Grid(rig, unknowns).Make(distances);
  if (points.empty()) {
    throw JobError("the projection cannot be judged: no camera images points at these distances");
  }
  const Eigen::Index size = unknowns.unit.size();
  Matrix6d normal = Matrix6d::Zero();
  Eigen::MatrixXd mixed = Eigen::MatrixXd::Zero(6, size);
  for (const GridPoint& point : points) {
    normal += point.by_motion.transpose() * point.by_motion;
    mixed += point.by_motion.transpose() * point.by_unknowns;
  }
  const Eigen::MatrixXd follow = SolveSymmetric(normal, mixed);
  std::vector<Result> results;
  for (const GridPoint& point : points) {
    results.push_back({point.camera, point.region, point.by_unknowns - point.by_motion * follow});
  }
  *this = ProjectionSigma(results, rig.bundle.cameras.size(), {});
}

ProjectionSigma::ProjectionSigma(const std::vector<Result>& results,
                                 size_t cameras,
                                 LoweredSigma words)
    : words_(std::move(words)), regions_(cameras) {
  const Eigen::Index size = results[0].by_unknowns.cols();
  all_ = Eigen::MatrixXd::Zero(size, size);
  std::vector<std::array<double, kRegions>> counts(cameras);
  for (const Result& result : results) {
    const Eigen::MatrixXd square = result.by_unknowns.transpose() * result.by_unknowns;
    all_ += square / static_cast<double>(results.size());
    Eigen::MatrixXd& region = regions_[result.camera][result.region];
    if (region.size() == 0) region = Eigen::MatrixXd::Zero(size, size);
    region += square;
    ++counts[result.camera][result.region];
  }
  for (size_t c = 0; c < cameras; ++c) {
    for (size_t r = 0; r < kRegions; ++r) regions_[c][r] /= std::max(1.0, counts[c][r]);
  }
}

double ProjectionSigma::Of(const Eigen::MatrixXd& M, const Eigen::MatrixXd& covariance) {
  return std::sqrt(std::max(M.cwiseProduct(covariance).sum(), 0.0));  // NaN stays
}

double ProjectionSigma::InRegion(size_t camera,
                                 size_t region,
                                 const Eigen::MatrixXd& covariance) const {
  const Eigen::MatrixXd& M = regions_[camera][region];
  return M.size() == 0 ? std::numeric_limits<double>::quiet_NaN() : Of(M, covariance);
}

size_t RegionOf(const Eigen::Vector2d& u_px, ImageSize image_size) {
  const auto third = [](double u, int pixels) {
    return static_cast<size_t>(
        std::clamp(static_cast<int>(std::floor(3 * (u + 0.5) / pixels)), 0, 2));
  };
  return 3 * third(u_px.y(), image_size[1]) + third(u_px.x(), image_size[0]);
}

}  // namespace plenocal
