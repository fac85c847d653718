// SPDX-License-Identifier: Apache-2.0
#include "calib/adjust/all_unknowns/minimise.h"

#include <ceres/ceres.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <iterator>
#include <memory>
#include <optional>
#include <span>
#include <type_traits>
#include <utility>
#include <vector>

#include "calib/adjust/layout.h"
#include "calib/adjust/priors.h"
#include "calib/adjust/rows.h"
#include "calib/kernels/row_products.h"

namespace plenocal::internal {
namespace {

// Above this many unknowns a dense reduced system costs more than a sparse one. Where landmarks
// are eliminated, few poses have none in common.
constexpr int kMaxDenseUnknowns = 3000, kMaxDensePoses = 7000;

// Below rounding: `AdjustOptions::cost_tolerance` decides.
constexpr double kGradientTolerance = 1e-14, kStepTolerance = 1e-13;

// Unknowns that are one parameter block of Ceres.
struct Block {
  int first = 0, size = 0;
  bool ends_in_chart = false;  // a pose's, about its value at the start
  bool is_used = false;
  bool is_shared = false;  // a prior's row ties it to another
  double* J = nullptr;     // derivatives of the rows that are evaluated at the time, row by row
};

// Rows that depend on some blocks.
class BlockCost : public ceres::CostFunction {
 public:
  // Writes the residuals and, if `derive`, the derivatives that are not zero to `Block::J`, in
  // charts about the present values; false outside the domain of a model.
  using Rows = std::function<bool(double* residuals, bool derive)>;

  BlockCost(int count, std::vector<Block*> blocks, Rows rows)
      : blocks_(std::move(blocks)), rows_(std::move(rows)) {
    set_num_residuals(count);
    for (const Block* block : blocks_) mutable_parameter_block_sizes()->push_back(block->size);
  }

  bool Evaluate(double const* const* parameters,
                double* residuals,
                double** jacobians) const override {
    if (jacobians == nullptr) return rows_(residuals, false);
    for (size_t b = 0; b < blocks_.size(); ++b) {
      blocks_[b]->J = jacobians[b];  // no block is constant
      std::fill_n(jacobians[b], num_residuals() * blocks_[b]->size, 0.0);
    }
    if (!rows_(residuals, true)) return false;
    for (size_t b = 0; b < blocks_.size(); ++b) {
      if (!blocks_[b]->ends_in_chart) continue;
      const int size = blocks_[b]->size;
      const Eigen::Map<const Eigen::Vector3d> rotation(parameters[b] + size - 3);
      auto J = Eigen::Map<RowMajorMatrix>(jacobians[b], num_residuals(), size).rightCols<3>();
      J = (J * LeftJacobian(rotation)).eval();
    }
    return true;
  }

 private:
  std::vector<Block*> blocks_;
  Rows rows_;
};

// A bundle as a function of all its unknowns: first those of a layout, which has landmarks as well,
// then six for the pose of each frame and for the jitter of each view. Parameters are themselves,
// all others changes from the start.
class AllUnknowns : public ceres::EvaluationCallback, public ceres::IterationCallback {
 public:
  AllUnknowns(const AdjustOptions& options, Bundle* bundle)
      : bundle_(*bundle),
        start_(*bundle),
        options_(options),
        has_data_(CamerasWithData(*bundle)),
        layout_(MakeLayout(*bundle, true)) {
    layout_.markers = bundle->EstimatesMarkers();
    layout_.total = layout_.markers ? layout_.Marker(static_cast<int>(std::ssize(bundle->markers)))
                                    : layout_.head;
    MakeBlocks();
    x_start_ = Eigen::VectorXd::Zero(std::ssize(block_of_));
    x_start_.head(layout_.head) = Values(layout_, *bundle);
    x_ = x_start_;
    ceres::Problem::Options problem;
    problem.disable_all_safety_checks = true;
    problem.evaluation_callback = this;
    problem_.emplace(problem);
    std::vector<std::vector<Block*>> of_cameras;
    for (size_t c = 0; c < bundle->cameras.size(); ++c) {
      residuals_.emplace_back(bundle->cameras[c], RowColumns{});
      derivatives_.emplace_back(
          bundle->cameras[c],
          RowColumns{.params = true, .extrinsics = true, .pose = true, .marker = true});
      std::vector<int> unknowns = layout_.params[c];
      unknowns.push_back(layout_.extrinsics[c]);
      of_cameras.push_back(BlocksOf(unknowns));
    }
    const std::span<const BundleObservation> observations = bundle->observations;
    for (size_t begin = 0, end = 0; begin < observations.size(); begin = end) {
      end = EndOfMarker(bundle->observations, begin);
      AddMarker(observations.subspan(begin, end - begin),
                of_cameras[static_cast<size_t>(observations[begin].camera)]);
    }
    priors_ = Priors();
    for (size_t i = 0; i < priors_.size(); ++i) {
      std::vector<int> unknowns;
      for (const auto& [unknown, derivative] : priors_[i].J) unknowns.push_back(unknown);
      const std::vector<Block*> blocks = BlocksOf(unknowns);
      for (Block* block : blocks) block->is_shared |= blocks.size() > 1;
      AddCost(1, blocks, [this, i](double* residuals, bool derive) {
        residuals[0] = priors_[i].residual;
        for (const auto& [unknown, derivative] : priors_[i].J) {
          if (derive) J<1>(unknown, 1)(0, 0) += derivative;
        }
        return std::isfinite(residuals[0]);
      });
    }
  }

  void Solve(AdjustSummary* summary) {
    const StepBounds bounds = BoundsOfStep(layout_, start_);
    for (int i = 0; i < layout_.head; ++i) {
      const Block& block = BlockOf(i);
      double* const values = x_.data() + block.first;
      if (!block.is_used) continue;
      problem_->SetParameterLowerBound(values, i - block.first, x_start_[i] + bounds.lower[i]);
      problem_->SetParameterUpperBound(values, i - block.first, x_start_[i] + bounds.upper[i]);
    }
    ceres::Solver::Options solver = SolverOptions();
    solver.callbacks.push_back(this);
    ceres::Solver::Summary solved;
    ceres::Solve(solver, &*problem_, &solved);
    if (summary->iterations == 0) summary->cost_before = solved.initial_cost;
    summary->usable = solved.IsSolutionUsable();
    summary->converged = solved.termination_type == ceres::CONVERGENCE;
    summary->stopped = solved.termination_type == ceres::USER_FAILURE;
    summary->iterations += static_cast<int>(solved.iterations.size());
    summary->cost = solved.final_cost;
    summary->message = solved.message;
    SetBundle();
  }

  void PrepareForEvaluation(bool /*evaluate_jacobians*/, bool new_evaluation_point) override {
    if (new_evaluation_point) SetBundle();
  }
  ceres::CallbackReturnType operator()(const ceres::IterationSummary& summary) override {
    return !options_.on_iteration || options_.on_iteration(summary.iteration, summary.cost)
               ? ceres::SOLVER_CONTINUE
               : ceres::SOLVER_ABORT;
  }

 private:
  [[nodiscard]] int Pose(size_t frame) const { return layout_.total + 6 * static_cast<int>(frame); }
  [[nodiscard]] int Jitter(size_t view) const { return Pose(start_.T_rig_target.size() + view); }
  Block& BlockOf(int unknown) { return blocks_[block_of_[static_cast<size_t>(unknown)]]; }
  // The blocks of unknowns, each once; -1 is skipped.
  std::vector<Block*> BlocksOf(const std::vector<int>& unknowns) {
    std::vector<Block*> blocks;
    for (const int unknown : unknowns) {
      if (unknown >= 0) blocks.push_back(&BlockOf(unknown));
    }
    std::ranges::sort(blocks);
    blocks.erase(std::unique(blocks.begin(), blocks.end()), blocks.end());
    return blocks;
  }

  // Derivatives of `rows` rows, evaluated at the time, by unknowns from `first` on.
  template <int columns>
  typename Eigen::Map<RowMajorMatrix>::template NColsBlockXpr<columns>::Type J(int first,
                                                                               Eigen::Index rows) {
    const Block& block = BlockOf(first);
    return Eigen::Map<RowMajorMatrix>(block.J, rows, block.size)
        .middleCols<columns>(first - block.first);
  }

  void MakeBlocks() {
    const auto add = [&](int size, bool ends_in_chart) {
      if (size == 0) return;
      const int first = static_cast<int>(std::ssize(block_of_));
      block_of_.insert(block_of_.end(), static_cast<size_t>(size), blocks_.size());
      blocks_.push_back({.first = first, .size = size, .ends_in_chart = ends_in_chart});
    };
    for (size_t c = 0; c < start_.cameras.size(); ++c) {
      add(layout_.first[c + 1] - layout_.first[c], layout_.extrinsics[c] >= 0);
    }
    for (const int target : layout_.targets) add(target >= 0 ? 6 : 0, true);
    for (int k = layout_.scales; k >= 0 && k < layout_.head; ++k) add(1, false);
    for (int m = layout_.head; m < layout_.total; m += UnknownLayout::kOfMarker) {
      add(UnknownLayout::kOfMarker, false);
    }
    for (size_t frame = 0; frame < start_.T_rig_target.size(); ++frame) add(6, true);
    for (size_t view = 0; view < start_.jitter.delta.size(); ++view) add(6, false);
  }

  void AddCost(int count, const std::vector<Block*>& blocks, BlockCost::Rows rows) {
    std::vector<double*> parameters;
    for (Block* block : blocks) {
      block->is_used = true;
      parameters.push_back(x_.data() + block->first);
    }
    problem_->AddResidualBlock(new BlockCost(count, blocks, std::move(rows)), nullptr, parameters);
  }

  // Adds the rows of one marker in one view.
  void AddMarker(std::span<const BundleObservation> observations, std::vector<Block*> blocks) {
    const auto used = std::ranges::count(observations, true, &BundleObservation::used);
    if (used == 0) return;
    const BundleObservation& first = observations[0];
    const auto frame = static_cast<size_t>(first.frame), c = static_cast<size_t>(first.camera);
    const auto add = [&](int unknown) { blocks.push_back(&BlockOf(unknown)); };
    if (start_.fixed_frame != frame) add(Pose(frame));
    if (start_.EstimatesJitter()) add(Jitter(start_.View(frame, c)));
    if (const auto target = start_.FreeTarget(first.marker)) add(layout_.targets[*target]);
    if (layout_.markers) add(layout_.Marker(first.marker));
    for (size_t k = 0; layout_.scales >= 0 && k < start_.scales.size(); ++k) {
      const BundleMarker& marker = start_.markers[static_cast<size_t>(first.marker)];
      if (start_.scales[k].target == marker.target) add(layout_.scales + static_cast<int>(k));
    }
    AddCost(static_cast<int>(used * std::ssize(start_.cameras[c].model->measured)),
            blocks,
            [this, observations](double* residuals, bool derive) {
              return SetMarker(observations, residuals, derive);
            });
  }

  // Writes these rows.
  bool SetMarker(std::span<const BundleObservation> observations, double* residuals, bool derive) {
    if (!within_domain_) return false;
    const BundleObservation& first = observations[0];
    const auto frame = static_cast<size_t>(first.frame), c = static_cast<size_t>(first.camera);
    MarkerRows& rows = (derive ? derivatives_ : residuals_)[c];
    if (!rows.Load(ViewOf(bundle_, frame, c),
                   bundle_.markers[static_cast<size_t>(first.marker)].position,
                   observations,
                   {options_.loss, options_.loss_width})) {
      return false;
    }
    const Eigen::Index count = rows.Count();
    Eigen::Map<Eigen::VectorXd>(residuals, count) = rows.Residual();
    if (!derive) return true;
    ForEachDerivative(bundle_, layout_, c, rows, [&](int unknown, const auto& by) {
      J<std::decay_t<decltype(by)>::ColsAtCompileTime>(unknown, count) += by;
    });
    const ViewCharts charts = ChartsOf(bundle_, frame, c);
    if (start_.fixed_frame != frame) J<6>(Pose(frame), count) = rows.Pose() * charts.pose;
    if (start_.EstimatesJitter()) {
      J<6>(Jitter(start_.View(frame, c)), count) = rows.Pose() * charts.jitter;
    }
    const auto target = start_.FreeTarget(first.marker);
    if (target && layout_.markers) {
      // Markers are where they were at the start before the target has moved.
      auto of_marker = J<3>(layout_.Marker(first.marker), count);
      of_marker = (of_marker * bundle_.targets[*target].T_target_own.R *
                   start_.targets[*target].T_target_own.R.transpose())
                      .eval();
    }
    return true;
  }

  // Those of unused blocks are left out, so that the rows are the same ones at each point.
  std::vector<SparseRow> Priors() {
    std::vector<SparseRow> rows = RowsOfPriors(bundle_, layout_);
    const auto position = [&](int marker) {
      const int first = layout_.Marker(marker);
      return BlockOf(first).is_used ? first : -1;
    };
    std::ranges::move(RowsOfDistances(bundle_, layout_, position, start_),
                      std::back_inserter(rows));
    const auto add = [&](int first, const auto& weight, const auto& value) {
      const auto residual = (weight * value).eval();
      for (Eigen::Index r = 0; BlockOf(first).is_used && r < residual.size(); ++r) {
        rows.push_back({.J = {}, .residual = residual[r]});
        for (int i = 0; i < residual.size(); ++i) rows.back().J[first + i] = weight(r, i);
      }
    };
    for (size_t m = 0; start_.marker_freedom.HasTolerance() && m < start_.markers.size(); ++m) {
      const int first = layout_.Marker(static_cast<int>(m));
      add(first,
          Eigen::Matrix3d(Eigen::Matrix3d::Identity() / start_.marker_freedom.Sigma()),
          Eigen::Vector3d(start_.markers[m].position + x_.segment<3>(first) -
                          start_.Expected(static_cast<int>(m))));
    }
    for (size_t view = 0; view < start_.jitter.delta.size(); ++view) {
      const size_t frame = view / start_.cameras.size(), c = view % start_.cameras.size();
      add(Jitter(view), JitterWeight(start_, frame, c), bundle_.jitter.delta[view]);
    }
    return rows;
  }

  // Sets the bundle to `x_`.
  void SetBundle() {
    static_cast<BundleState&>(bundle_) = start_;
    const Eigen::VectorXd step = x_ - x_start_;
    Move(layout_, step, &bundle_);
    for (size_t frame = 0; frame < start_.T_rig_target.size(); ++frame) {
      RigidTransform& T_rig_target = bundle_.T_rig_target[frame];
      T_rig_target = Retract(T_rig_target, step.segment<6>(Pose(frame)));
    }
    for (size_t view = 0; view < start_.jitter.delta.size(); ++view) {
      bundle_.jitter.delta[view] += step.segment<6>(Jitter(view));
    }
    within_domain_ = WithinDomain(bundle_, has_data_);
    priors_ = Priors();
  }

  int CountUsed(int begin, int end) {
    int count = 0;
    for (const Block& block : blocks_) {
      if (block.is_used && block.first >= begin && block.first < end) count += block.size;
    }
    return count;
  }

  ceres::Solver::Options SolverOptions() {
    // The blocks that are eliminated first must not share residuals: the jitter of the views when
    // there is any, else the poses; or the markers, where they are more unknowns. The rest is small
    // and dense.
    const int end = static_cast<int>(x_.size());
    std::pair eliminated =
        start_.EstimatesJitter() ? std::pair{Jitter(0), end} : std::pair{Pose(0), Jitter(0)};
    if (CountUsed(layout_.head, layout_.total) > CountUsed(eliminated.first, eliminated.second)) {
      eliminated = {layout_.head, layout_.total};
    }
    ceres::Solver::Options solver;
    solver.linear_solver_ordering = std::make_shared<ceres::ParameterBlockOrdering>();
    for (const Block& block : blocks_) {
      if (!block.is_used) continue;
      const bool first =
          block.first >= eliminated.first && block.first < eliminated.second && !block.is_shared;
      solver.linear_solver_ordering->AddElementToGroup(x_.data() + block.first, first ? 0 : 1);
    }
    const int dense = CountUsed(0, end) - CountUsed(eliminated.first, eliminated.second);
    solver.linear_solver_type =
        dense <= (start_.HasLandmarks() ? kMaxDensePoses : kMaxDenseUnknowns) ? ceres::DENSE_SCHUR
                                                                              : ceres::SPARSE_SCHUR;
    // On which parameters of a local model a point depends changes during the solve, so that no
    // blocks of unknowns can state it.
    if (EstimatesLocalModel(bundle_)) {
      solver.linear_solver_type = ceres::SPARSE_NORMAL_CHOLESKY;
      solver.dynamic_sparsity = true;
    }
    solver.logging_type = ceres::SILENT;
    solver.max_num_iterations = options_.max_iterations;
    solver.function_tolerance = options_.cost_tolerance;
    solver.gradient_tolerance = kGradientTolerance;
    solver.parameter_tolerance = kStepTolerance;
    solver.initial_trust_region_radius = FirstTrustRegion(options_);
    return solver;
  }

  Bundle& bundle_;
  const BundleState start_;
  const AdjustOptions& options_;
  const std::vector<bool> has_data_;  // per camera
  UnknownLayout layout_;
  std::vector<Block> blocks_;
  std::vector<size_t> block_of_;  // per unknown
  Eigen::VectorXd x_, x_start_;
  std::vector<MarkerRows> residuals_, derivatives_;  // per camera
  bool within_domain_ = false;                       // at `x_`
  std::vector<SparseRow> priors_;                    // likewise
  std::optional<ceres::Problem> problem_;
};

}  // namespace

AdjustSummary MinimiseAllUnknowns(const AdjustOptions& options, Bundle* bundle) {
  const BundleState before = *bundle;
  for (BundleCamera& camera : bundle->cameras) camera.at_bound.clear();
  AdjustSummary summary;
  // Parameters that have come to a bound, along which Ceres converges slowly, are fixed there.
  for (int unknowns = MakeLayout(*bundle, true).head, last = unknowns + 1; unknowns < last;) {
    AllUnknowns(options, bundle).Solve(&summary);
    if (!summary.usable) {
      static_cast<BundleState&>(*bundle) = before;
      break;
    }
    SetAtBounds(bundle);
    last = std::exchange(unknowns, MakeLayout(*bundle, true).head);
  }
  return summary;
}

}  // namespace plenocal::internal
