// SPDX-License-Identifier: Apache-2.0
//
// Rows of the adjustment as cost functions of Ceres. They read the bundle, which has the values of
// Ceres' parameters: `WriteUnknowns` sets it before each evaluation.
#pragma once

#include <ceres/cost_function.h>
#include <ceres/evaluation_callback.h>

#include <optional>
#include <span>
#include <vector>

#include "calib/adjust/all_unknowns/parameter_blocks.h"
#include "calib/adjust/priors.h"
#include "calib/adjust/rows.h"

namespace plenocal::internal {

/// Sets the bundle to the point at which Ceres evaluates next.
class WriteUnknowns : public ceres::EvaluationCallback {
 public:
  WriteUnknowns(const Unknowns& unknowns, Bundle* bundle) : unknowns_(unknowns), bundle_(*bundle) {}
  void PrepareForEvaluation(bool /*evaluate_jacobians*/, bool new_evaluation_point) override {
    if (new_evaluation_point) unknowns_.WriteTo(&bundle_);
  }

 private:
  const Unknowns& unknowns_;
  Bundle& bundle_;
};

/// Memory for the rows of one camera.
struct RowMemory {
  explicit RowMemory(const BundleCamera& camera)
      : residuals(camera, {}),
        derivatives(camera, {.params = true, .extrinsics = true, .pose = true, .marker = true}) {}

  MarkerRows residuals, derivatives;
};

/// Unknowns on which the observations of one view depend, beside the markers.
struct ViewUnknowns {
  const Intrinsics* intrinsics = nullptr;
  const ChartedPose* extrinsics = nullptr;  ///< null for the rig's master
  const ChartedPose* pose = nullptr;
  std::optional<size_t> target;  ///< nothing: its pose is not estimated
};

/// Rows of all observations [begin, end) of one view that fall into one block of markers of one
/// target. Parameter blocks: intrinsics, [extrinsics,] pose[, jitter][, target][, markers].
class ViewCost : public ceres::CostFunction {
 public:
  /// `rows`: of the camera. All arguments must outlive this.
  ViewCost(const Bundle& bundle,
           const Unknowns& unknowns,
           const ViewUnknowns& view,
           std::span<const BundleObservation> observations,
           const RobustLoss& loss,
           RowMemory* rows);

  bool Evaluate(double const* const* parameters,
                double* residuals,
                double** jacobians) const override;

 private:
  const Bundle& bundle_;
  const Unknowns& unknowns_;
  ViewUnknowns of_;
  std::span<const BundleObservation> observations_;
  RobustLoss loss_;
  RowMemory& memory_;
};

/// `DistanceRows` with a parameter block for each of its landmarks.
class DistanceCost : public ceres::CostFunction {
 public:
  explicit DistanceCost(DistanceRows rows);
  bool Evaluate(double const* const* parameters,
                double* residuals,
                double** jacobians) const override;

 private:
  DistanceRows rows_;
};

/// Residual of `CalibrationPrior`. Parameter blocks: those of the unknowns' intrinsics and
/// extrinsics, each once, in the order of `Blocks`.
class CalibrationPriorCost : public ceres::CostFunction {
 public:
  CalibrationPriorCost(const Bundle& bundle, const Unknowns& unknowns);
  [[nodiscard]] const std::vector<double*>& Blocks() const { return blocks_; }
  bool Evaluate(double const* const* parameters,
                double* residuals,
                double** jacobians) const override;

 private:
  size_t AddBlock(double* values, size_t size);

  const Bundle& bundle_;
  const Unknowns& unknowns_;
  std::vector<double*> blocks_;
  std::vector<size_t> block_of_;  // per unknown of the prior
};

}  // namespace plenocal::internal
