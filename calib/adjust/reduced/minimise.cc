// SPDX-License-Identifier: Apache-2.0
#include "calib/adjust/reduced/minimise.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "calib/adjust/poses.h"

namespace plenocal::internal {
namespace {

// Part of the diagonal of the normal matrix that is added to it, so that rounding of the sums
// leaves it positive definite.
constexpr double kRounding = 1e-13;
// A step of this part of the unknowns ends the solve of exact observations.
constexpr double kRoundingOfStep = 1e-13;

// A step of the head, and by how much it lowers half the sum of squares of the linearised
// residuals.
struct Step {
  Eigen::VectorXd value;
  double predicted_gain = 0;
};

// The best step, damped by 1 / radius in `unit`s. Unknowns that would leave their bounds stop
// there, and the step of the others is the best one then (active set).
Step DampedStep(const ReducedProblem::Linearisation& at,
                const StepBounds& bounds,
                const Eigen::VectorXd& unit,
                double radius) {
  const Eigen::Index size = unit.size();
  const Eigen::MatrixXd matrix = unit.asDiagonal() * at.matrix * unit.asDiagonal();
  const Eigen::VectorXd gradient = unit.cwiseProduct(at.gradient);
  const Eigen::VectorXd lower = bounds.lower.cwiseQuotient(unit),
                        upper = bounds.upper.cwiseQuotient(unit);
  Eigen::VectorXd step = Eigen::VectorXd::Zero(size);
  Eigen::Array<bool, Eigen::Dynamic, 1> stopped =
      (gradient.array() > 0).select(lower.array() == 0, upper.array() == 0);
  double damping = 0;
  for (bool again = true; again;) {
    Eigen::MatrixXd free = matrix;
    for (Eigen::Index i = 0; i < size; ++i) {
      if (!stopped[i]) continue;
      free.row(i).setZero();
      free.col(i).setZero();
      free(i, i) = 1;
    }
    Eigen::LLT<Eigen::MatrixXd> factor;
    damping = 0.1 / radius;
    do {
      damping *= 10;
      Eigen::MatrixXd damped = free;
      damped.diagonal().array() += damping;
      factor.compute(damped);
    } while (factor.info() != Eigen::Success && damping < 1);
    // The step is zero but where unknowns have stopped.
    const Eigen::VectorXd solved =
        -factor.solve(Eigen::VectorXd(gradient + matrix * stopped.select(step, 0).matrix()));
    const Eigen::VectorXd within = solved.cwiseMax(lower).cwiseMin(upper);
    const auto stop = (!stopped && within.array() != solved.array()).eval();
    step = stopped.select(step, within);
    stopped = stopped || stop;
    again = stop.any();
  }
  // -(gradient + matrix step / 2)' step, without the product where the step solves the equations:
  // along directions of little information it is the rounding of `matrix`.
  const Eigen::VectorXd change = stopped.select(matrix * step, -gradient - damping * step);
  return {unit.cwiseProduct(step), -step.dot(gradient + change / 2)};
}

}  // namespace

ReducedProblem::ReducedProblem(const RobustLoss& loss, Bundle* bundle)
    : bundle_(*bundle),
      used_(CamerasWithData(*bundle)),
      layout_(MakeLayout(*bundle, true)),
      objective_(ObjectiveOf(*bundle, loss)) {}

double ReducedProblem::Squares() const {
  if (!WithinDomain(bundle_, used_)) return std::numeric_limits<double>::infinity();
  double squares = SumOfSquares(bundle_, objective_);
  for (const std::vector<SparseRow>& rows :
       {RowsOfPriors(bundle_, layout_), RowsOfDistances(bundle_, layout_)}) {
    for (const SparseRow& row : rows) squares += row.residual * row.residual;
  }
  return squares;
}

std::optional<ReducedProblem::Linearisation> ReducedProblem::Linearise() const {
  if (!WithinDomain(bundle_, used_)) return std::nullopt;
  // Fewer eliminated states than unknowns of markers.
  const bool separate =
      6 * (std::ssize(bundle_.T_rig_target) + std::ssize(bundle_.jitter.delta)) < layout_.Markers();
  Linearisation at{
      .state = bundle_,
      .equations = EliminateFrames(bundle_,
                                   layout_,
                                   objective_,
                                   kRounding,
                                   {.keep_steps = true, .separate_markers = separate})};
  if (!at.equations.complete) return std::nullopt;
  const Eigen::Index head = layout_.head;
  at.squares = at.equations.squares;
  const std::vector<SparseRow> distances = RowsOfDistances(bundle_, layout_);
  AddInformation(distances, &at.equations.S, separate ? layout_.head : layout_.total);
  Eigen::MatrixXd plus =
      Eigen::MatrixXd::Zero(layout_.Markers(), separate ? std::ssize(distances) : 0);
  for (size_t r = 0; r < distances.size(); ++r) {
    const SparseRow& row = distances[r];
    at.squares += row.residual * row.residual;
    for (const auto& [index, J] : row.J) {
      at.equations.S(layout_.total, index) += J * row.residual;
      if (separate && index >= head) plus(index - head, static_cast<Eigen::Index>(r)) = J;
    }
  }
  at.matrix = at.equations.S.topLeftCorner(head, head).selfadjointView<Eigen::Lower>();
  at.gradient = at.equations.S.row(layout_.total).head(head).transpose();
  at.diagonal = at.equations.diagonal.head(head);
  if (layout_.Markers() > 0) EliminateMarkers(separate, plus, &at);
  const std::vector<SparseRow> priors = RowsOfPriors(bundle_, layout_);
  AddInformation(priors, &at.matrix);
  at.matrix = at.matrix.selfadjointView<Eigen::Lower>();
  for (const SparseRow& row : priors) {
    at.squares += row.residual * row.residual;
    for (const auto& [index, J] : row.J) at.gradient[index] += J * row.residual;
  }
  return at;
}

void ReducedProblem::EliminateMarkers(bool separate,
                                      const Eigen::MatrixXd& plus,
                                      Linearisation* at) const {
  const Eigen::Index head = layout_.head, markers = layout_.Markers();
  const Eigen::MatrixXd& S = at->equations.S;
  const auto of_markers = S.block(head, head, markers, markers);
  const Eigen::VectorXd damping = kRounding * at->equations.diagonal.segment(head, markers);
  at->markers.Compute(
      of_markers,
      separate ? UnknownLayout::kOfMarker : markers,
      damping,
      plus,
      separate ? at->equations.states.RowsOfColumns(head, markers) : Eigen::MatrixXd(markers, 0));
  Eigen::MatrixXd by_head(markers, head + 1);
  by_head << S.block(head, 0, markers, head),
      S.row(layout_.total).segment(head, markers).transpose();
  at->marker_roots = at->markers.Root(by_head);
  const auto roots = at->marker_roots.leftCols(head);
  at->matrix.noalias() -= roots.transpose() * roots;
  at->gradient.noalias() -= roots.transpose() * at->marker_roots.col(head);
}

void ReducedProblem::MoveFrom(const Linearisation& from,
                              const Eigen::VectorXd& step,
                              double own_part) {
  static_cast<BundleState&>(bundle_) = from.state;
  const Eigen::Index head = layout_.head, markers = layout_.Markers();
  Eigen::VectorXd all(layout_.total);
  all.head(head) = step;
  if (markers > 0) {
    Eigen::VectorXd right(head + 1);
    right << step, own_part;
    all.tail(markers) = -from.markers.Solve(from.marker_roots * right);
  }
  from.equations.MoveStates(all, own_part, &bundle_);
  Move(layout_, all, &bundle_);
}

namespace {

// Squares at the bundle's values, with the poses optimised while all else stays where a step of the
// cameras was too long for the linear steps of the poses to be exact enough.
double SquaresWithPoses(const ReducedProblem& problem, double before, Bundle* bundle) {
  const double squares = problem.Squares();
  if (squares < before || std::isinf(squares)) return squares;
  const std::vector<RigidTransform> linear = bundle->T_rig_target;
  AdjustPoses(bundle, std::vector<bool>(linear.size(), true));
  const double refined = problem.Squares();
  if (refined < squares) return refined;
  bundle->T_rig_target = linear;
  return squares;
}

}  // namespace

AdjustSummary MinimiseReduced(const AdjustOptions& options, Bundle* bundle) {
  constexpr double kLeastQuality = 1e-3;  // of a step that is taken
  const BundleState before = *bundle;
  for (BundleCamera& camera : bundle->cameras) camera.at_bound.clear();
  ReducedProblem problem({options.loss, options.loss_width}, bundle);
  AdjustSummary summary;
  std::optional<ReducedProblem::Linearisation> at = problem.Linearise();
  if (!at) {
    static_cast<BundleState&>(*bundle) = before;
    summary.message = "an observation lies outside the domain of its camera's model at the start";
    return summary;
  }
  const Eigen::VectorXd unit = at->diagonal.unaryExpr(
      [](double square) { return square > 0 ? 1 / std::sqrt(square) : 1.0; });
  double radius = FirstTrustRegion(options), decrease = 2;  // as Nielsen (1999) changes them
  double own_part = 1;
  double rounding = kRoundingOfStep * Values(problem.Layout(), *bundle).norm();
  StepBounds bounds = BoundsOfStep(problem.Layout(), *bundle);
  summary.cost_before = summary.cost = at->squares / 2;
  while (true) {
    const int iteration = summary.iterations++;
    if (options.on_iteration && !options.on_iteration(iteration, summary.cost)) {
      summary.stopped = true;
      summary.message = "stopped";
      break;
    }
    if (summary.iterations > options.max_iterations) {
      summary.usable = true;
      summary.message = "the most iterations are done";
      break;
    }
    const auto [step, predicted] = DampedStep(*at, bounds, unit, radius);
    problem.MoveFrom(*at, step, own_part);
    const double cost = SquaresWithPoses(problem, at->squares, bundle) / 2;
    const double gain = summary.cost - cost;
    summary.converged = step.norm() <= rounding ||
                        std::abs(gain) <= options.cost_tolerance * summary.cost || radius < 1e-32;
    if (summary.converged) {
      summary.usable = true;
      summary.message = "converged";
      break;
    }
    own_part /= 2;
    if (!(predicted > 0) || !(gain > kLeastQuality * predicted)) {
      radius /= std::exchange(decrease, 2 * decrease);
      continue;
    }
    SetAtBounds(bundle);
    at.reset();  // before the next takes as much memory
    at = problem.Linearise();
    if (!at) {
      summary.message = "residuals have no derivatives after a step";
      break;
    }
    radius = std::min(1e16, radius / std::max(1.0 / 3, 1 - std::pow(2 * gain / predicted - 1, 3)));
    decrease = 2;
    own_part = 1;
    rounding = kRoundingOfStep * Values(problem.Layout(), *bundle).norm();
    bounds = BoundsOfStep(problem.Layout(), *bundle);
    summary.cost = at->squares / 2;
  }
  static_cast<BundleState&>(*bundle) = summary.usable ? at->state : before;
  if (summary.usable) SetAtBounds(bundle);
  return summary;
}

}  // namespace plenocal::internal
