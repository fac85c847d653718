// SPDX-License-Identifier: Apache-2.0
#include "calib/adjust/poses.h"

#include <optional>

#include "calib/adjust/rows.h"
#include "calib/base/linear_algebra.h"

namespace plenocal {
namespace {

// Normal equations H delta = -g of a target pose: a visitor of rows.
struct PoseEquations {
  Matrix6d H = Matrix6d::Zero();
  Vector6d g = Vector6d::Zero();

  void Marker(const internal::VisitedView& /*view*/, const internal::MarkerRows& rows) {
    H.noalias() += rows.Pose().transpose().lazyProduct(rows.Pose());
    g.noalias() += rows.Pose().transpose().lazyProduct(rows.Residual());
  }
  void EndView(const internal::VisitedView& /*view*/) {}
  void EndFrame(size_t /*frame*/) {}
};

// Of observations in [begin, end).
PoseEquations LinearisePose(const Bundle& bundle,
                            size_t begin,
                            size_t end,
                            const internal::RobustLoss& loss) {
  PoseEquations equations;
  internal::RowWalk(bundle, loss, {.pose = true}).Visit(begin, end, equations);
  return equations;
}

}  // namespace

void AdjustPose(size_t begin, size_t end, Bundle* bundle) {
  constexpr int kSteps = 4;
  constexpr internal::RobustLoss kLoss{.loss = Loss::kHuber, .width = 3, .reweights = true};
  RigidTransform& T_rig_target =
      bundle->T_rig_target[static_cast<size_t>(bundle->observations[begin].frame)];
  for (int step = 0; step < kSteps; ++step) {
    const PoseEquations equations = LinearisePose(*bundle, begin, end, kLoss);
    const Vector6d delta = -SolveSymmetric(equations.H, equations.g);
    if (!delta.allFinite()) break;
    T_rig_target = Retract(T_rig_target, delta);
    if (delta.dot(equations.H * delta) < 1) break;  // less than a sigma; the adjustment goes on
  }
}

void AdjustPoses(Bundle* bundle, const std::vector<bool>& frames) {
  const auto& observations = bundle->observations;
  for (size_t begin = 0, end = 0; begin < observations.size(); begin = end) {
    end = EndOfFrame(observations, begin);
    if (frames[static_cast<size_t>(observations[begin].frame)]) AdjustPose(begin, end, bundle);
  }
}

Matrix6d PoseInformation(const Bundle& bundle, size_t begin, size_t end) {
  return LinearisePose(bundle, begin, end, {}).H;
}

std::vector<PoseStep> OwnPoseSteps(const Bundle& bundle) {
  std::vector<PoseStep> steps;
  const auto& observations = bundle.observations;
  for (size_t begin = 0, end = 0; begin < observations.size(); begin = end) {
    const BundleObservation& first = observations[begin];
    end = EndOfView(observations, begin);
    const PoseEquations equations = LinearisePose(bundle, begin, end, {});
    const std::optional<Vector6d> step = SolvePositive(equations.H, equations.g);
    if (!step) continue;
    const Vector6d delta = -*step;
    steps.push_back({first.frame, first.camera, delta, -delta.dot(equations.g)});
  }
  return steps;
}

}  // namespace plenocal
