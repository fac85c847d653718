// SPDX-License-Identifier: Apache-2.0
#include "calib/adjust/solver/reduced_cost.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <span>
#include <utility>

#include "calib/adjust/poses.h"
#include "calib/adjust/solver/scaled_manifold.h"

namespace plenocal::internal {
namespace {

// Part of the diagonal of the normal matrix that is added to it, so that rounding of the sums
// leaves it positive definite. Ceres' damping is larger.
constexpr double kRounding = 1e-13;
// Factor on `line_search_factor_` after each rejected step.
constexpr double kLineSearchReduction = 0.5;

}  // namespace

ReducedCost::ReducedCost(const std::vector<bool>& used,
                         const RobustLoss& loss,
                         const Unknowns& unknowns,
                         Bundle* bundle)
    : bundle_(*bundle),
      used_(used),
      unknowns_(unknowns),
      objective_(ObjectiveOf(*bundle, loss)),
      layout_(MakeLayout(*bundle, used)) {
  AddIntrinsics(used);
  const auto six = [](int first) {
    std::vector<int> indices;
    for (int i = 0; i < 6; ++i) indices.push_back(first + i);
    return indices;
  };
  for (size_t c = 0; c < used.size(); ++c) {
    if (layout_.extrinsics[c] < 0) continue;
    AddBlock(unknowns.extrinsics[c].delta, six(layout_.extrinsics[c]), &unknowns.extrinsics[c]);
  }
  for (size_t k = 0; k < layout_.targets.size(); ++k) {
    if (layout_.targets[k] < 0) continue;
    AddBlock(unknowns.targets[k].delta, six(layout_.targets[k]), &unknowns.targets[k]);
  }
  set_num_residuals(layout_.head + 1);
}

void ReducedCost::AddIntrinsics(const std::vector<bool>& used) {
  for (size_t c = 0; c < used.size(); ++c) {
    if (!used[c]) continue;
    const IntrinsicsBlock& block = *unknowns_.intrinsics[c].block;
    auto place = static_cast<size_t>(std::ranges::find(blocks_, block.values) - blocks_.begin());
    if (place == blocks_.size()) {
      AddBlock(block.values, std::vector<int>(block.Size(), -1), nullptr);
    }
    for (size_t k = 0; k < layout_.params[c].size(); ++k) {
      const size_t slot = unknowns_.intrinsics[c].Slot(k);
      if (slot != kNoSlot) indices_[place][slot] = layout_.params[c][k];
    }
  }
}

void ReducedCost::AddBlock(double* values, std::vector<int> indices, const ChartedPose* pose) {
  mutable_parameter_block_sizes()->push_back(static_cast<int>(indices.size()));
  blocks_.push_back(values);
  indices_.push_back(std::move(indices));
  poses_.push_back(pose);
}

bool ReducedCost::Evaluate(double const* const* parameters,
                           double* residuals,
                           double** jacobians) const {
  const Eigen::VectorXd values = Gather(parameters);
  if (evaluated_.size() == 0 || evaluated_ != values) {
    if (at_ && at_->values == values) {
      Load(at_->state);
      squares_ = at_->equations.squares;
    } else {
      MoveTo(values);
      line_search_factor_ *= kLineSearchReduction;
      squares_ = SquaresHere();
      if (at_ && WithinDomain() && !(squares_ < at_->equations.squares)) RefinePoses();
    }
    evaluated_ = values;
  }
  if (!std::isfinite(squares_)) return false;
  const Eigen::Index head = layout_.head;
  Eigen::Map<Eigen::VectorXd> r(residuals, head + 1);
  r.setZero();
  r[head] = std::sqrt(squares_);
  if (jacobians == nullptr) return true;
  if (!Linearise(values)) return false;
  r.head(head) = at_->residual;
  r[head] = std::sqrt(std::max(0.0, squares_ - at_->residual.squaredNorm()));
  SetJacobians(jacobians);
  return true;
}

void ReducedCost::SetManifolds(ceres::Problem* problem) const {
  Eigen::VectorXd diagonal = Eigen::VectorXd::Zero(layout_.head);
  const std::vector<const double*> parameters(blocks_.begin(), blocks_.end());
  if (WithinDomain() && Linearise(Gather(parameters.data()))) {
    diagonal = at_->equations.diagonal.head(layout_.head);
  }
  for (size_t b = 0; b < blocks_.size(); ++b) {
    std::vector<ScaledManifold::Part> parts;
    for (size_t i = 0; i < indices_[b].size(); ++i) {
      const int index = indices_[b][i];
      if (index < 0) continue;
      const double square = diagonal[index];
      parts.push_back({static_cast<int>(i), square > 0 ? 1 / std::sqrt(square) : 1.0});
    }
    if (parts.empty()) {
      problem->SetParameterBlockConstant(blocks_[b]);
      continue;
    }
    problem->SetManifold(
        blocks_[b], new ScaledManifold(static_cast<int>(indices_[b].size()), std::move(parts)));
  }
}

void ReducedCost::DampByUnits(ceres::Solver::Options* options) {
  options->jacobi_scaling = false;
  options->min_lm_diagonal = options->max_lm_diagonal = 1;
}

void ReducedCost::Restore() const {
  if (at_) Load(at_->state);
}

Eigen::VectorXd ReducedCost::Gather(double const* const* parameters) const {
  Eigen::Index size = 0;
  for (const std::vector<int>& indices : indices_) size += std::ssize(indices);
  Eigen::VectorXd values(size);
  double* next = values.data();
  for (size_t b = 0; b < blocks_.size(); ++b) {
    next = std::copy_n(parameters[b], indices_[b].size(), next);
  }
  return values;
}

ReducedCost::State ReducedCost::Save() const {
  State state;
  state.T_rig_target = bundle_.T_rig_target;
  state.jitter = bundle_.jitter.delta;
  state.markers = bundle_.markers;
  for (const BundleCamera& camera : bundle_.cameras) {
    state.params.push_back(camera.params);
    state.T_camera_rig.push_back(camera.T_camera_rig);
  }
  for (const BundleTarget& target : bundle_.targets) {
    state.T_target_own.push_back(target.T_target_own);
  }
  return state;
}

void ReducedCost::Load(const State& state) const {
  bundle_.T_rig_target = state.T_rig_target;
  bundle_.jitter.delta = state.jitter;
  bundle_.markers = state.markers;
  for (size_t c = 0; c < bundle_.cameras.size(); ++c) {
    bundle_.cameras[c].params = state.params[c];
    bundle_.cameras[c].T_camera_rig = state.T_camera_rig[c];
  }
  for (size_t k = 0; k < bundle_.targets.size(); ++k) {
    bundle_.targets[k].T_target_own = state.T_target_own[k];
  }
}

void ReducedCost::SetCameras(const Eigen::VectorXd& values) const {
  const double* next = values.data();
  for (size_t b = 0; b < blocks_.size(); next += indices_[b].size(), ++b) {
    if (poses_[b] == nullptr) {
      for (size_t c = 0; c < bundle_.cameras.size(); ++c) {
        const Intrinsics& intrinsics = unknowns_.intrinsics[c];
        if (intrinsics.block->values != blocks_[b]) continue;
        std::vector<double>& params = bundle_.cameras[c].params;
        for (size_t k = 0; k < params.size(); ++k) {
          if (intrinsics.Slot(k) != kNoSlot) params[k] = next[intrinsics.Slot(k)];
        }
      }
      continue;
    }
    const RigidTransform T = Retract(poses_[b]->origin, Eigen::Map<const Vector6d>(next));
    const auto of_camera = poses_[b] - unknowns_.extrinsics.data();
    if (of_camera >= 0 && of_camera < std::ssize(unknowns_.extrinsics)) {
      bundle_.cameras[static_cast<size_t>(of_camera)].T_camera_rig = T;
    } else {
      MoveTarget(static_cast<size_t>(poses_[b] - unknowns_.targets.data()), T, &bundle_);
    }
  }
}

void ReducedCost::MoveTo(const Eigen::VectorXd& values) const {
  if (at_) {
    Load(at_->state);
    const Eigen::Index head = layout_.head, markers = layout_.total - head;
    Eigen::VectorXd step(layout_.total);
    step.head(head) = HeadStep(values);
    if (markers > 0) {
      Eigen::VectorXd right(head + 1);
      right << step.head(head), line_search_factor_;
      step.tail(markers) = -at_->markers.Solve(at_->marker_roots * right);
    }
    at_->equations.steps->Apply(step, line_search_factor_, &bundle_);
    for (Eigen::Index m = 0; 3 * m < markers; ++m) {
      bundle_.markers[static_cast<size_t>(m)].position += step.segment<3>(head + 3 * m);
    }
  }
  SetCameras(values);
}

Eigen::VectorXd ReducedCost::HeadStep(const Eigen::VectorXd& values) const {
  Eigen::VectorXd step = Eigen::VectorXd::Zero(layout_.head);
  Eigen::Index first = 0;
  for (size_t b = 0; b < blocks_.size(); first += std::ssize(indices_[b]), ++b) {
    if (poses_[b] == nullptr) {
      for (size_t i = 0; i < indices_[b].size(); ++i) {
        const Eigen::Index at = first + static_cast<Eigen::Index>(i);
        if (indices_[b][i] >= 0) step[indices_[b][i]] = values[at] - at_->values[at];
      }
      continue;
    }
    const RigidTransform from = Retract(poses_[b]->origin, Vector6d(at_->values.segment<6>(first)));
    const RigidTransform to = Retract(poses_[b]->origin, Vector6d(values.segment<6>(first)));
    step.segment<6>(indices_[b][0]) = LocalCoordinates(from, to);
  }
  return step;
}

bool ReducedCost::WithinDomain() const {
  for (size_t c = 0; c < used_.size(); ++c) {
    const BundleCamera& camera = bundle_.cameras[c];
    if (used_[c] && !WithinBounds(*camera.model, camera.params.data())) return false;
  }
  return true;
}

double ReducedCost::SquaresHere() const {
  return WithinDomain() ? SumOfSquares(bundle_, objective_)
                        : std::numeric_limits<double>::infinity();
}

void ReducedCost::RefinePoses() const {
  const std::vector<RigidTransform> linear = bundle_.T_rig_target;
  const double squares = squares_;
  AdjustPoses(&bundle_, std::vector<bool>(linear.size(), true));
  squares_ = SquaresHere();
  if (squares_ < squares) return;
  bundle_.T_rig_target = linear;
  squares_ = squares;
}

bool ReducedCost::Linearise(const Eigen::VectorXd& values) const {
  if (at_ && at_->values == values) return true;
  at_.reset();  // before the next takes as much memory
  line_search_factor_ = 1;
  at_.emplace();
  at_->values = values;
  at_->state = Save();
  Eliminate();
  if (!at_->equations.complete) at_.reset();
  return at_.has_value();
}

void ReducedCost::Eliminate() const {
  const Eigen::Index head = layout_.head, markers = layout_.total - head;
  // Fewer eliminated poses than unknowns of markers.
  const bool separate =
      6 * (std::ssize(bundle_.T_rig_target) + std::ssize(bundle_.jitter.delta)) < markers;
  at_->equations =
      EliminateFrames(bundle_,
                      layout_,
                      objective_,
                      {.damping = kRounding, .keep_steps = true, .separate_markers = separate});
  const Eigen::MatrixXd& S = at_->equations.S;
  Eigen::MatrixXd matrix = S.topLeftCorner(head, head).selfadjointView<Eigen::Lower>();
  Eigen::VectorXd gradient = S.row(layout_.total).head(head).transpose();
  if (markers > 0) {
    const auto of_markers = S.block(head, head, markers, markers);
    const Eigen::VectorXd damping = kRounding * at_->equations.diagonal.segment(head, markers);
    if (separate) {
      at_->markers.Compute(of_markers, damping, at_->equations.steps->MarkerColumns());
    } else {
      at_->markers.Compute(of_markers, damping);
    }
    Eigen::MatrixXd by_head(markers, head + 1);
    by_head << S.block(head, 0, markers, head),
        S.row(layout_.total).segment(head, markers).transpose();
    at_->marker_roots = at_->markers.Root(by_head);
    const auto roots = at_->marker_roots.leftCols(head);
    matrix.noalias() -= roots.transpose() * roots;
    gradient.noalias() -= roots.transpose() * at_->marker_roots.col(head);
  }
  FactorHead(matrix, gradient, at_->equations.diagonal.head(head));
}

void ReducedCost::FactorHead(const Eigen::MatrixXd& matrix,
                             const Eigen::VectorXd& gradient,
                             const Eigen::VectorXd& diagonal) const {
  const Eigen::VectorXd scale =
      diagonal.unaryExpr([](double square) { return square > 0 ? 1 / std::sqrt(square) : 1.0; });
  const Eigen::MatrixXd scaled = scale.asDiagonal() * matrix * scale.asDiagonal();
  Eigen::LLT<Eigen::MatrixXd> factor;
  double damping = kRounding;
  do {
    Eigen::MatrixXd damped = scaled;
    damped.diagonal().array() += damping;
    factor.compute(damped);
    damping *= 10;
  } while (factor.info() != Eigen::Success && damping < 1);
  at_->root = factor.matrixU();
  at_->root = (at_->root * scale.cwiseInverse().asDiagonal()).eval();
  at_->residual = factor.matrixL().solve(scale.cwiseProduct(gradient));
}

void ReducedCost::SetJacobians(double** jacobians) const {
  using RowMajor = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
  const Eigen::Index head = layout_.head;
  Eigen::Index first = 0;
  for (size_t b = 0; b < blocks_.size(); first += std::ssize(indices_[b]), ++b) {
    if (jacobians[b] == nullptr) continue;
    Eigen::Map<RowMajor> J(jacobians[b], head + 1, std::ssize(indices_[b]));
    J.setZero();
    for (Eigen::Index i = 0; i < J.cols(); ++i) {
      const int index = indices_[b][static_cast<size_t>(i)];
      if (index >= 0) J.col(i).head(head) = at_->root.col(index);
    }
    if (poses_[b] == nullptr) continue;
    const Eigen::Vector3d w = at_->values.segment<3>(first + 3);
    J.rightCols<3>() = (J.rightCols<3>() * LeftJacobian(w)).eval();
  }
}

}  // namespace plenocal::internal
