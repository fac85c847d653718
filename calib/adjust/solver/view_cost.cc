// SPDX-License-Identifier: Apache-2.0
#include "calib/adjust/solver/view_cost.h"

#include <algorithm>
#include <cmath>

namespace plenocal::internal {
ViewCost::ViewCost(const Bundle& bundle,
                   const ViewUnknowns& unknowns,
                   std::span<const BundleObservation* const> observations,
                   const RobustLoss& loss)
    : bundle_(bundle),
      camera_(bundle.cameras[static_cast<size_t>(observations[0]->camera)]),
      unknowns_(unknowns),
      slots_(unknowns.intrinsics->slots),
      free_jitter_(bundle.EstimatesJitter()),
      free_markers_(bundle.EstimatesMarkers()),
      markers_per_block_(static_cast<size_t>(MarkersPerBlock(bundle))),
      observations_(observations.begin(), observations.end()),
      loss_(loss) {
  set_num_residuals(static_cast<int>(observations_.size() * camera_.model->measured.size()));
  auto& sizes = *mutable_parameter_block_sizes();
  sizes.push_back(static_cast<int>(unknowns.intrinsics->block->Size()));
  if (unknowns_.extrinsics != nullptr) sizes.push_back(6);
  sizes.push_back(6);
  if (free_jitter_) sizes.push_back(6);
  if (unknowns_.target != nullptr) sizes.push_back(6);
  if (free_markers_) sizes.push_back(static_cast<int>(3 * markers_per_block_));
}

bool ViewCost::Evaluate(double const* const* parameters,
                        double* residuals,
                        double** jacobians) const {
  std::vector<double> gathered;
  const double* const params = Gather(parameters[0], &gathered);
  // Limits are part of the model's domain; Ceres' own bounds would add a line search a step.
  if (!WithinBounds(*camera_.model, params)) return false;
  const LinearisedView view = ViewAt(parameters, params);
  const Jacobians J = JacobiansOf(jacobians);
  const size_t rows = camera_.model->measured.size();
  const size_t count = camera_.params.size();
  const size_t marker_width = 3 * markers_per_block_;
  // The model's own derivatives are needed for those by any block.
  const bool direct = J.intrinsics != nullptr && slots_.empty();
  std::vector<double> J_params(J.any && !direct ? rows * count : 0);
  if (J.intrinsics != nullptr && !direct) {
    const auto width = static_cast<size_t>(parameter_block_sizes()[0]);
    std::fill_n(J.intrinsics, observations_.size() * rows * width, 0.0);
  }
  for (size_t i = 0; i < observations_.size(); ++i) {
    const BundleObservation& observation = *observations_[i];
    const size_t slot = static_cast<size_t>(observation.marker) % markers_per_block_;
    const Eigen::Vector3d p_target = PointAt(parameters, observation);
    const size_t row = i * rows;
    double J_marker[kMaxObservationSize * 3];
    LinearisedRows out{.residual = residuals + row};
    if (J.any) {
      out.J_params = direct ? J.intrinsics + row * count : J_params.data();
      if (J.extrinsics != nullptr) out.J_extrinsics = J.extrinsics + row * 6;
      if (J.pose != nullptr) out.J_pose = J.pose + row * 6;
      if (J.jitter != nullptr) out.J_jitter = J.jitter + row * 6;
      if (J.markers != nullptr || J.target != nullptr) out.J_marker = J_marker;
    }
    if (!Linearise(camera_, params, view, p_target, observation, out)) {
      // Within rounding of the edge of the domain, where a step has ended, derivatives may not
      // exist although the residual does; the point then does not count for the next step.
      const LinearisedRows edge{.residual = out.residual};
      if (!J.any || !Linearise(camera_, params, view, p_target, observation, edge)) return false;
      ClearDerivatives(camera_, out);
    }
    Robustify(loss_, camera_, observation.assumed_sigma, out);
    if (J.intrinsics != nullptr && !direct) ScatterParams(J_params, row, J.intrinsics);
    if (unknowns_.target != nullptr && out.J_marker != nullptr) {
      MoveWithTarget(
          parameters, p_target, J.target == nullptr ? nullptr : J.target + row * 6, J_marker);
    }
    if (J.markers == nullptr) continue;
    std::fill_n(J.markers + row * marker_width, rows * marker_width, 0.0);
    for (size_t r = 0; r < rows; ++r) {
      std::copy_n(J_marker + 3 * r, 3, J.markers + (row + r) * marker_width + 3 * slot);
    }
  }
  if (camera_.noise.common_sigma > 0) {
    Decorrelate(residuals, 1);
    const std::vector<int>& sizes = parameter_block_sizes();
    for (size_t b = 0; jacobians != nullptr && b < sizes.size(); ++b) {
      if (jacobians[b] != nullptr) Decorrelate(jacobians[b], static_cast<size_t>(sizes[b]));
    }
  }
  return true;
}

ViewCost::Jacobians ViewCost::JacobiansOf(double** jacobians) const {
  if (jacobians == nullptr) return {};
  return {.any = true,
          .intrinsics = jacobians[0],
          .extrinsics = unknowns_.extrinsics != nullptr ? jacobians[1] : nullptr,
          .pose = jacobians[PoseBlock()],
          .jitter = free_jitter_ ? jacobians[JitterBlock()] : nullptr,
          .target = unknowns_.target != nullptr ? jacobians[TargetBlock()] : nullptr,
          .markers = free_markers_ ? jacobians[MarkerBlock()] : nullptr};
}

Eigen::Vector3d ViewCost::PointAt(double const* const* parameters,
                                  const BundleObservation& observation) const {
  const size_t slot = static_cast<size_t>(observation.marker) % markers_per_block_;
  Eigen::Vector3d point = bundle_.markers[static_cast<size_t>(observation.marker)].position;
  if (free_markers_) {
    point = Eigen::Map<const Eigen::Vector3d>(parameters[MarkerBlock()] + 3 * slot);
  }
  if (unknowns_.target == nullptr) return point;
  const Eigen::Map<const Vector6d> delta(parameters[TargetBlock()]);
  const Eigen::Vector3d& origin = unknowns_.target->origin.t;
  return ExpRotation(delta.tail<3>()) * (point - origin) + origin + delta.head<3>();
}

// p = Exp(w) (q - t_0) + t_0 + v with the marker's position q before the solve.
void ViewCost::MoveWithTarget(double const* const* parameters,
                              const Eigen::Vector3d& p_target,
                              double* J_target,
                              double* J_marker) const {
  const Eigen::Map<const Vector6d> delta(parameters[TargetBlock()]);
  const Eigen::Vector3d arm = p_target - unknowns_.target->origin.t - delta.head<3>();
  const Eigen::Matrix3d chart = LeftJacobian(delta.tail<3>());
  const Eigen::Matrix3d R = ExpRotation(delta.tail<3>());
  for (size_t r = 0; r < camera_.model->measured.size(); ++r) {
    Eigen::Map<Eigen::Vector3d> J(J_marker + 3 * r);
    if (J_target != nullptr) {
      Eigen::Map<Eigen::Vector3d>(J_target + 6 * r) = J;
      Eigen::Map<Eigen::Vector3d>(J_target + 6 * r + 3) = chart.transpose() * arm.cross(J);
    }
    J = (R.transpose() * J).eval();
  }
}

const double* ViewCost::Gather(const double* block, std::vector<double>* buffer) const {
  if (slots_.empty()) return block;
  *buffer = camera_.params;
  for (size_t k = 0; k < slots_.size(); ++k) {
    if (slots_[k] != kNoSlot) (*buffer)[k] = block[slots_[k]];
  }
  return buffer->data();
}

LinearisedView ViewCost::ViewAt(double const* const* parameters, const double* params) const {
  LinearisedView view;
  view.T_camera_rig = camera_.T_camera_rig;
  if (unknowns_.extrinsics != nullptr) {
    const Eigen::Map<const Vector6d> delta(parameters[1]);
    view.T_camera_rig = Retract(unknowns_.extrinsics->origin, delta);
    view.chart_extrinsics = LeftJacobian(delta.tail<3>());
  }
  const Eigen::Map<const Vector6d> delta(parameters[PoseBlock()]);
  view.T_rig_target = Retract(unknowns_.pose->origin, delta);
  view.chart_pose = LeftJacobian(delta.tail<3>());
  // R = Exp(w_jitter) Exp(w_motion) Exp(w_pose) R_0: a change of w_pose turns with what is left of
  // it.
  if (!bundle_.motion.empty()) {
    const BundleObservation& first = *observations_[0];
    const auto frame = static_cast<size_t>(first.frame), camera = static_cast<size_t>(first.camera);
    const Vector6d way = bundle_.MotionIncrement(frame, camera, params);
    view.T_rig_target = Retract(view.T_rig_target, way);
    view.chart_pose = ExpRotation(way.tail<3>()) * view.chart_pose;
    view.by_time_shift = bundle_.motion[bundle_.View(frame, camera)].velocity;
    view.by_time_shift.tail<3>() =
        (LeftJacobian(way.tail<3>()) * view.by_time_shift.tail<3>()).eval();
  }
  if (free_jitter_) {
    const Eigen::Map<const Vector6d> jitter(parameters[JitterBlock()]);
    view.T_rig_target = Retract(view.T_rig_target, jitter);
    view.chart_pose = ExpRotation(jitter.tail<3>()) * view.chart_pose;
    view.by_time_shift.tail<3>() =
        (ExpRotation(jitter.tail<3>()) * view.by_time_shift.tail<3>()).eval();
    view.chart_jitter = LeftJacobian(jitter.tail<3>());
  }
  return view;
}

void ViewCost::ScatterParams(const std::vector<double>& J_params,
                             size_t row,
                             double* J_block) const {
  const size_t rows = camera_.model->measured.size();
  const size_t count = camera_.params.size();
  const auto width = static_cast<size_t>(parameter_block_sizes()[0]);
  for (size_t r = 0; r < rows; ++r) {
    for (size_t k = 0; k < count; ++k) {
      if (slots_[k] == kNoSlot) continue;
      J_block[(row + r) * width + slots_[k]] += J_params[r * count + k];
    }
  }
}

// Multiplies rows of `columns` numbers by the inverse root of their covariance under common noise,
// marker by marker: with u_i = 1 / sigma_i it is I - (1 - 1 / sqrt(1 + t^2 |u|^2)) u u' / |u|^2.
void ViewCost::Decorrelate(double* data, size_t columns) const {
  const size_t rows = camera_.model->measured.size();
  const double common_sigma = camera_.noise.common_sigma;
  std::vector<double> u, sum(rows * columns);
  for (size_t begin = 0, end = 0; begin < observations_.size(); begin = end) {
    u.clear();
    double information = 0;
    for (; end < observations_.size() && observations_[end]->marker == observations_[begin]->marker;
         ++end) {
      u.push_back(1 / camera_.noise.OwnSigma(observations_[end]->assumed_sigma));
      information += u.back() * u.back();
    }
    const double left = 1 / std::sqrt(1 + common_sigma * common_sigma * information);
    std::fill(sum.begin(), sum.end(), 0.0);
    double* const first = data + begin * rows * columns;
    for (size_t i = 0; i < u.size(); ++i) {
      for (size_t k = 0; k < sum.size(); ++k) sum[k] += u[i] * first[i * sum.size() + k];
    }
    for (size_t i = 0; i < u.size(); ++i) {
      const double part = (1 - left) * u[i] / information;
      for (size_t k = 0; k < sum.size(); ++k) first[i * sum.size() + k] -= part * sum[k];
    }
  }
}

}  // namespace plenocal::internal
