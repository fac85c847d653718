// SPDX-License-Identifier: Apache-2.0
#include "calib/noise/reduced_system.h"

#include <utility>

#include "calib/adjust/reduced/elimination.h"

namespace plenocal::internal {

ReducedSystem Reduce(const Bundle& bundle, const UnknownLayout& layout) {
  ReducedSystem reduced;
  reduced.degrees_of_poses.assign(bundle.cameras.size(), 0.0);
  reduced.degrees_of_poses_by_means.assign(bundle.cameras.size(), 0.0);
  reduced.pose_covariances.assign(bundle.T_rig_target.size(), Matrix6d::Zero());
  const Objective objective = ObjectiveOf(bundle, {});
  ReducedEquations equations = EliminateFrames(bundle, layout, objective, 0, {.keep_views = true});
  States& states = equations.states;
  states.ComputeCovariances();
  for (const EliminatedView& view : equations.views) {
    if (!states.IsDetermined(view.pose)) continue;
    const Matrix6d pose = states.Covariance(view.pose, view.pose);
    reduced.pose_covariances[view.frame] = pose;
    // Covariance of the pose that the camera saw.
    Matrix6d seen = view.charts.pose * pose * view.charts.pose.transpose();
    if (bundle.EstimatesJitter()) {
      const Matrix6d jitter = states.Covariance(view.jitter, view.jitter);
      const Matrix6d cross = view.charts.jitter * states.Covariance(view.jitter, view.pose) *
                             view.charts.pose.transpose();
      seen +=
          view.charts.jitter * jitter * view.charts.jitter.transpose() + cross + cross.transpose();
      const size_t index = bundle.View(view.frame, view.camera);
      if (!bundle.jitter.misplaced[index]) {
        const Matrix6d& W = objective.jitter_weights[index];
        const Vector6d known = Vector6d::Ones() - (W * jitter * W.transpose()).diagonal();
        reduced.jitter_translations += known.head<3>().sum();
        reduced.jitter_rotations += known.tail<3>().sum();
      }
    }
    reduced.degrees_of_poses[view.camera] += (view.information * seen).trace();
    reduced.degrees_of_poses_by_means[view.camera] += (view.information_of_means * seen).trace();
  }
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
