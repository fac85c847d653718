// SPDX-License-Identifier: Apache-2.0
#include "calib/rig/extrinsics.h"

#include <Eigen/Core>
#include <array>
#include <cmath>
#include <limits>
#include <numbers>

#include "calib/camera/rigid_transform.h"

namespace plenocal {
namespace {

struct Name {
  std::string_view name, unit;
};
constexpr std::array kNames{Name{"baseline", "mm"},
                            Name{"angle", "degrees"},
                            Name{"x", "mm"},
                            Name{"y", "mm"},
                            Name{"z", "mm"},
                            Name{"rotation about x", "degrees"},
                            Name{"rotation about y", "degrees"},
                            Name{"rotation about z", "degrees"}};
using Values = Eigen::Vector<double, kNames.size()>;

Values ValuesOf(const Vector6d& xi_camera_rig) {
  const RigidTransform T_rig_camera = Exp(-xi_camera_rig);
  const Eigen::Vector3d centre = 1e3 * T_rig_camera.t;
  const Eigen::Vector3d rotation = -xi_camera_rig.tail<3>() * (180 / std::numbers::pi);
  Values values;
  values << centre.norm(), rotation.norm(), centre, rotation;
  return values;
}

}  // namespace

std::vector<Extrinsic> ExtrinsicsOf(const RigidTransform& T_camera_rig,
                                    const Matrix6d& covariance) {
  const Vector6d xi = Log(T_camera_rig);
  if (xi.isZero(0)) return {};
  const Values values = ValuesOf(xi);
  Eigen::Matrix<double, kNames.size(), 6> J;
  constexpr double kStep = 1e-6;
  for (Eigen::Index i = 0; i < 6; ++i) {
    const Vector6d step = kStep * Vector6d::Unit(i);
    J.col(i) = (ValuesOf(xi + step) - ValuesOf(xi - step)) / (2 * kStep);
  }
  const bool determined = covariance.allFinite();
  std::vector<Extrinsic> extrinsics;
  for (size_t k = 0; k < kNames.size(); ++k) {
    const auto row = J.row(static_cast<Eigen::Index>(k));
    const double variance = row * covariance * row.transpose();
    extrinsics.push_back({.name = kNames[k].name,
                          .unit = kNames[k].unit,
                          .value = values[static_cast<Eigen::Index>(k)],
                          .sigma = determined ? std::sqrt(std::max(0.0, variance))
                                              : std::numeric_limits<double>::infinity()});
  }
  return extrinsics;
}

std::vector<Extrinsic> ExtrinsicsOf(const CalibratedCamera& camera,
                                    const Correlations& correlations) {
  const Eigen::Index first = std::ssize(camera.params);
  return ExtrinsicsOf(camera.T_camera_rig,
                      JointCovariance({&camera}, correlations).block<6, 6>(first, first));
}

}  // namespace plenocal
