// SPDX-License-Identifier: Apache-2.0
//
// The cost function that Ceres gets in most adjustments: poses, jitter and markers are eliminated.
#pragma once

#include <ceres/ceres.h>

#include <Eigen/Core>
#include <optional>
#include <vector>

#include "calib/adjust/elimination/frame_elimination.h"
#include "calib/adjust/elimination/marker_factor.h"
#include "calib/adjust/solver/parameter_blocks.h"

namespace plenocal::internal {

/// All observations of a bundle of targets and the priors of markers and jitter as a function of
/// the cameras' parameters, the extrinsics and the targets' poses, its parameter blocks. Poses of
/// frames, jitter and markers follow these: from the point where derivatives were asked for last,
/// they take the step to the optimum of the residuals linearised there. So each evaluation costs
/// one pass over the observations, and derivatives one elimination whose blocks have sizes that are
/// known (`EliminateFrames`), which Ceres' own has not.
///
/// The residuals r and their Jacobian J are those of the normal equations that are left: J' J is
/// their matrix, J' r their gradient and r' r the sum of squares.
///
/// The bundle is at the point that was evaluated last.
class ReducedCost : public ceres::CostFunction {
 public:
  /// `used` per camera: whether it has used observations. All arguments must outlive this.
  ReducedCost(const std::vector<bool>& used,
              const RobustLoss& loss,
              const Unknowns& unknowns,
              Bundle* bundle);

  [[nodiscard]] const std::vector<double*>& Blocks() const { return blocks_; }
  /// Fixes the parameters that are not estimated and scales the others, so that the diagonal of the
  /// normal matrix before the elimination of poses and markers is 1.
  void SetManifolds(ceres::Problem* problem) const;
  /// Makes Ceres damp by that diagonal. Its default, the diagonal after the elimination, is small
  /// for parameters that correlate with poses (focal length and distance): steps would be too long.
  static void DampByUnits(ceres::Solver::Options* options);

  bool Evaluate(double const* const* parameters,
                double* residuals,
                double** jacobians) const override;
  /// Restores the bundle's values at the last evaluation of derivatives, which is Ceres' solution.
  void Restore() const;

  /// The values of all unknowns of the bundle.
  struct State {
    std::vector<std::vector<double>> params;
    std::vector<RigidTransform> T_camera_rig, T_rig_target, T_target_own;
    std::vector<Vector6d> jitter;
    std::vector<BundleMarker> markers;
  };
  [[nodiscard]] State Save() const;
  void Load(const State& state) const;

 private:
  // The normal equations at one point, and what the steps of markers and poses follow from.
  struct Linearisation {
    Eigen::VectorXd values;  // of all parameter blocks
    State state;
    ReducedEquations equations;
    MarkerFactor markers;          // of their part
    Eigen::MatrixXd marker_roots;  // `MarkerFactor::Root` of their rows, and of their gradient
    Eigen::MatrixXd root;          // R, R' R the matrix of the head
    Eigen::VectorXd residual;      // R^-T of its gradient
  };

  void AddBlock(double* values, std::vector<int> indices, const ChartedPose* pose);
  void AddIntrinsics(const std::vector<bool>& used);
  [[nodiscard]] Eigen::VectorXd Gather(double const* const* parameters) const;
  void SetCameras(const Eigen::VectorXd& values) const;
  // Brings the bundle from the point of the linearisation, if there is one, to `values`.
  void MoveTo(const Eigen::VectorXd& values) const;
  // In the charts of the linearisation.
  [[nodiscard]] Eigen::VectorXd HeadStep(const Eigen::VectorXd& values) const;
  [[nodiscard]] bool WithinDomain() const;
  // Sum of squares at the bundle's present values; infinite outside the domain.
  [[nodiscard]] double SquaresHere() const;
  // Optimises the poses with the cameras fixed and keeps the result if it lowers the sum of
  // squares: for a long step of the cameras the linear steps of the poses are not exact enough.
  void RefinePoses() const;
  bool Linearise(const Eigen::VectorXd& values) const;
  void Eliminate() const;
  // `diagonal`: that of the matrix before the elimination.
  void FactorHead(const Eigen::MatrixXd& matrix,
                  const Eigen::VectorXd& gradient,
                  const Eigen::VectorXd& diagonal) const;
  void SetJacobians(double** jacobians) const;

  Bundle& bundle_;
  std::vector<bool> used_;  // per camera
  const Unknowns& unknowns_;
  Objective objective_;
  UnknownLayout layout_;
  std::vector<double*> blocks_;
  std::vector<std::vector<int>> indices_;  // per block and number: in the layout, or -1
  std::vector<const ChartedPose*> poses_;  // per block; null for parameters

  // Ceres evaluates one point at a time: first without derivatives, then, if the point is better,
  // with them.
  mutable std::optional<Linearisation> at_;
  mutable Eigen::VectorXd evaluated_;  // the values at which the bundle is
  mutable double squares_ = 0;         // there; infinite outside the domain
  // The part of the step of poses and markers that does not depend on the cameras' step. Reduced
  // after each rejected step, as Ceres reduces the trust region.
  mutable double line_search_factor_ = 1;
};

}  // namespace plenocal::internal
