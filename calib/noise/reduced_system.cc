// SPDX-License-Identifier: Apache-2.0
#include "calib/noise/reduced_system.h"

#include <span>
#include <utility>

#include "calib/adjust/elimination/frame_elimination.h"

namespace plenocal::internal {
namespace {

Matrix6d PoseCovarianceWithJitter(const ReducedView& view, const Matrix6d& pose_covariance) {
  const Matrix6d& A = view.jitter_covariance;
  const Matrix6d Q = view.W.transpose() * view.W;
  return A + A * Q * pose_covariance * Q * A;
}

// The part of each number of a view's jitter that the data determine.
Vector6d KnownPart(const ReducedView& view, const Matrix6d& pose_covariance) {
  const Matrix6d& A = view.jitter_covariance;
  const Matrix6d& N = view.information;
  const Matrix6d jitter = A + A * N * pose_covariance * N * A;
  return Vector6d::Ones() - (view.W * jitter * view.W.transpose()).diagonal();
}

}  // namespace

ReducedSystem Reduce(const Bundle& bundle, const UnknownLayout& layout) {
  ReducedSystem reduced;
  reduced.degrees_of_poses.assign(bundle.cameras.size(), 0.0);
  reduced.degrees_of_poses_by_means.assign(bundle.cameras.size(), 0.0);
  reduced.pose_covariances.assign(bundle.T_rig_target.size(), Matrix6d::Zero());
  const auto visit =
      [&](size_t frame, const Matrix6d& pose_covariance, std::span<const ReducedView> views) {
        reduced.pose_covariances[frame] = pose_covariance;
        for (const ReducedView& view : views) {
          Matrix6d seen = pose_covariance;  // covariance of the pose that the camera saw
          if (bundle.EstimatesJitter()) {
            seen = PoseCovarianceWithJitter(view, pose_covariance);
            if (!bundle.jitter.misplaced[bundle.View(frame, view.camera)]) {
              const Vector6d known = KnownPart(view, pose_covariance);
              reduced.jitter_translations += known.head<3>().sum();
              reduced.jitter_rotations += known.tail<3>().sum();
            }
          }
          reduced.degrees_of_poses[view.camera] += (view.information * seen).trace();
          reduced.degrees_of_poses_by_means[view.camera] += (view.of_means * seen).trace();
        }
      };
  ReducedEquations equations =
      EliminateFrames(bundle, layout, ObjectiveOf(bundle, {}), {.visit = visit});
  reduced.gradient = equations.S.row(layout.total).head(layout.total).transpose();
  for (size_t m = 0; layout.markers && m < bundle.markers.size(); ++m) {
    const BundleMarker& marker = bundle.markers[m];
    reduced.gradient.segment<3>(layout.Marker(static_cast<int>(m))) -=
        (marker.position - marker.nominal) / bundle.marker_freedom.Variance();
  }
  equations.S.conservativeResize(layout.total, layout.total);
  reduced.S = std::move(equations.S);
  return reduced;
}

}  // namespace plenocal::internal
