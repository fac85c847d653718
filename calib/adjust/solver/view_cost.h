// SPDX-License-Identifier: Apache-2.0
//
// The cost function of one view, where Ceres has all unknowns.
#pragma once

#include <ceres/cost_function.h>

#include <span>
#include <vector>

#include "calib/adjust/linearise.h"
#include "calib/adjust/robust_rows.h"
#include "calib/adjust/solver/parameter_blocks.h"

namespace plenocal::internal {

/// Unknowns on which the observations of one view depend, beside its jitter and the markers.
struct ViewUnknowns {
  const Intrinsics* intrinsics = nullptr;
  const ChartedPose* extrinsics = nullptr;  ///< null for the rig's master
  const ChartedPose* pose = nullptr;
  const ChartedPose* target = nullptr;  ///< null: its pose is not estimated
};

/// Weighted, robustified residuals of all observations of one camera in one frame that fall into
/// one block of markers of one target. Parameter blocks: intrinsics, [extrinsics,] pose[, jitter]
/// [, target][, markers].
class ViewCost : public ceres::CostFunction {
 public:
  /// The observations are of one view; all arguments must outlive this.
  ViewCost(const Bundle& bundle,
           const ViewUnknowns& unknowns,
           std::span<const BundleObservation* const> observations,
           const RobustLoss& loss);

  bool Evaluate(double const* const* parameters,
                double* residuals,
                double** jacobians) const override;

 private:
  // Memory for the derivatives by each block; null for blocks whose derivatives Ceres does
  // not need.
  struct Jacobians {
    bool any = false;
    double *intrinsics = nullptr, *extrinsics = nullptr, *pose = nullptr, *jitter = nullptr,
           *target = nullptr, *markers = nullptr;
  };

  [[nodiscard]] int PoseBlock() const { return unknowns_.extrinsics != nullptr ? 2 : 1; }
  [[nodiscard]] int JitterBlock() const { return PoseBlock() + 1; }
  [[nodiscard]] int TargetBlock() const { return JitterBlock() + (free_jitter_ ? 1 : 0); }
  [[nodiscard]] int MarkerBlock() const {
    return TargetBlock() + (unknowns_.target != nullptr ? 1 : 0);
  }
  [[nodiscard]] Jacobians JacobiansOf(double** jacobians) const;
  // The camera's parameters among those of its block.
  const double* Gather(const double* block, std::vector<double>* buffer) const;
  // `params`: the camera's, of `parameters`.
  [[nodiscard]] LinearisedView ViewAt(double const* const* parameters, const double* params) const;
  // Adds the derivatives by the camera's parameters to those by its block, from row `row` on.
  void ScatterParams(const std::vector<double>& J_params, size_t row, double* J_block) const;
  // The marker's position where its target is now.
  [[nodiscard]] Eigen::Vector3d PointAt(double const* const* parameters,
                                        const BundleObservation& observation) const;
  // From derivatives by the point to those by the pose of its target and by the marker in its
  // block, in `J_target` (if not null) and in place.
  void MoveWithTarget(double const* const* parameters,
                      const Eigen::Vector3d& p_target,
                      double* J_target,
                      double* J_marker) const;
  void Decorrelate(double* data, size_t columns) const;

  const Bundle& bundle_;
  const BundleCamera& camera_;
  ViewUnknowns unknowns_;
  const std::vector<size_t>& slots_;
  bool free_jitter_, free_markers_;
  size_t markers_per_block_;
  std::vector<const BundleObservation*> observations_;
  RobustLoss loss_;
};

}  // namespace plenocal::internal
