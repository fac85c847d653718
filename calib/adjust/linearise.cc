// SPDX-License-Identifier: Apache-2.0
#include "calib/adjust/linearise.h"

#include <algorithm>

namespace plenocal::internal {
namespace {

// Spreads rows of derivatives by the model's parameters so that each is followed by those by the
// nuisance parameters.
void AppendNuisances(const BundleCamera& camera,
                     const BundleObservation& observation,
                     double weight,
                     double* J_params) {
  const size_t rows = camera.model->measured.size(), own = camera.ModelParams();
  const size_t width = camera.params.size(), stated = observation.by_nuisance.size() / rows;
  for (size_t r = rows; r-- > 0;) {
    double* const row = J_params + r * width;
    if (r > 0) std::copy_backward(J_params + r * own, J_params + (r + 1) * own, row + own);
    for (size_t k = 0; k < camera.Nuisances(); ++k) {
      row[own + k] = k < stated ? -weight * observation.by_nuisance[r * stated + k] : 0;
    }
  }
}

}  // namespace

LinearisedView ViewOf(const Bundle& bundle, size_t frame, size_t camera) {
  LinearisedView view{.T_camera_rig = bundle.cameras[camera].T_camera_rig,
                      .T_rig_target = bundle.SeenPose(frame, camera)};
  if (bundle.motion.empty()) return view;
  const Vector6d way = bundle.MotionIncrement(frame, camera, bundle.cameras[camera].params.data());
  view.by_time_shift = bundle.motion[bundle.View(frame, camera)].velocity;
  Eigen::Vector3d rotation = LeftJacobian(way.tail<3>()) * view.by_time_shift.tail<3>();
  if (!bundle.jitter.delta.empty()) {
    rotation = ExpRotation(bundle.jitter.delta[bundle.View(frame, camera)].tail<3>()) * rotation;
  }
  view.by_time_shift.tail<3>() = rotation;
  return view;
}

// R = Exp(w_jitter) Exp(w_motion) Exp(w_pose) R_0: a change of w_pose is rotated by what is left of
// it.
ViewCharts ChartsOf(const Bundle& bundle, size_t frame, size_t camera) {
  ViewCharts charts;
  if (!bundle.motion.empty()) {
    const Vector6d way =
        bundle.MotionIncrement(frame, camera, bundle.cameras[camera].params.data());
    charts.pose = ExpRotation(way.tail<3>());
  }
  if (!bundle.jitter.delta.empty()) {
    const Vector6d& jitter = bundle.jitter.delta[bundle.View(frame, camera)];
    charts.pose = (ExpRotation(jitter.tail<3>()) * charts.pose).eval();
    charts.jitter = LeftJacobian(jitter.tail<3>());
  }
  return charts;
}

bool Linearise(const BundleCamera& camera,
               const double* params,
               const LinearisedView& view,
               const Eigen::Vector3d& p_target,
               const BundleObservation& observation,
               const LinearisedRows& out) {
  const Eigen::Vector3d rotated = view.T_rig_target.R * p_target;
  const Eigen::Vector3d rotated_rig = view.T_camera_rig.R * (rotated + view.T_rig_target.t);
  const Eigen::Vector3d p_cam = rotated_rig + view.T_camera_rig.t;

  const CameraModel& model = *camera.model;
  const Observation seen = WithoutDisplacement(observation, camera, params);
  const size_t rows = model.measured.size();
  double predicted[kMaxObservationSize];
  double J_point[kMaxObservationSize * 3];
  const bool derive = out.HasDerivatives();
  const bool inside =
      derive ? model.ProjectWithJacobian(
                   params,
                   camera.config.data(),
                   seen.values.data(),
                   p_cam,
                   {.predicted = predicted, .J_params = out.J_params, .J_point = J_point})
             : model.Project(params, camera.config.data(), seen.values.data(), p_cam, predicted);
  if (!inside) return false;
  const double weight = 1 / camera.noise.OwnSigma(observation.assumed_sigma);
  for (size_t r = 0; r < rows; ++r) out.residual[r] = weight * (seen.values[r] - predicted[r]);
  if (!derive) return true;

  // Residual = measured - predicted, so every derivative is minus that of the prediction. With a
  // rotation by w before the point: row (-Hat(a)) = (a x row)'.
  if (out.J_params != nullptr) {
    for (size_t i = 0; i < rows * model.params.size(); ++i) out.J_params[i] *= -weight;
    if (camera.Nuisances() > 0) AppendNuisances(camera, observation, weight, out.J_params);
  }
  for (size_t r = 0; r < rows; ++r) {
    const Eigen::Vector3d J_cam = -weight * Eigen::Map<const Eigen::Vector3d>(J_point + 3 * r);
    const Eigen::Vector3d J_rig = view.T_camera_rig.R.transpose() * J_cam;
    if (out.J_extrinsics != nullptr) {
      Eigen::Map<Eigen::Vector3d>(out.J_extrinsics + 6 * r) = J_cam;
      Eigen::Map<Eigen::Vector3d>(out.J_extrinsics + 6 * r + 3) =
          view.chart_extrinsics.transpose() * rotated_rig.cross(J_cam);
    }
    if (out.J_pose != nullptr) {
      Eigen::Map<Eigen::Vector3d>(out.J_pose + 6 * r) = J_rig;
      Eigen::Map<Eigen::Vector3d>(out.J_pose + 6 * r + 3) =
          view.chart_pose.transpose() * rotated.cross(J_rig);
    }
    if (out.J_jitter != nullptr) {
      Eigen::Map<Eigen::Vector3d>(out.J_jitter + 6 * r) = J_rig;
      Eigen::Map<Eigen::Vector3d>(out.J_jitter + 6 * r + 3) =
          view.chart_jitter.transpose() * rotated.cross(J_rig);
    }
    if (out.J_marker != nullptr) {
      Eigen::Map<Eigen::Vector3d>(out.J_marker + 3 * r) = view.T_rig_target.R.transpose() * J_rig;
    }
    if (camera.time_shift && out.J_params != nullptr) {
      out.J_params[r * camera.params.size() + *camera.time_shift] =
          J_rig.dot(view.by_time_shift.head<3>()) +
          rotated.cross(J_rig).dot(view.by_time_shift.tail<3>());
    }
  }
  return true;
}

}  // namespace plenocal::internal
