// SPDX-License-Identifier: Apache-2.0
#include "calib/adjust/all_unknowns/minimise.h"

#include <ceres/ceres.h>
#include <ceres/normal_prior.h>

#include <algorithm>
#include <cmath>
#include <memory>
#include <optional>
#include <vector>

#include "calib/adjust/all_unknowns/costs.h"
#include "calib/adjust/all_unknowns/parameter_blocks.h"
#include "calib/adjust/layout.h"

namespace plenocal::internal {
namespace {

// Above this many unknowns a dense reduced system costs more than a sparse one. Where landmarks
// are eliminated, few poses have none in common.
constexpr size_t kMaxDenseUnknowns = 3000, kMaxDensePoses = 7000;

// Below rounding: `AdjustOptions::cost_tolerance` decides.
constexpr double kGradientTolerance = 1e-14, kStepTolerance = 1e-13;

class IterationReport : public ceres::IterationCallback {
 public:
  explicit IterationReport(const AdjustOptions& options) : options_(options) {}
  ceres::CallbackReturnType operator()(const ceres::IterationSummary& summary) override {
    if (!options_.on_iteration) return ceres::SOLVER_CONTINUE;
    return options_.on_iteration(summary.iteration, summary.cost) ? ceres::SOLVER_CONTINUE
                                                                  : ceres::SOLVER_ABORT;
  }

 private:
  const AdjustOptions& options_;
};

size_t CountTrue(const std::vector<bool>& flags) {
  return static_cast<size_t>(std::count(flags.begin(), flags.end(), true));
}

using Matrix = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

// The solver's problem for one bundle.
class AdjustProblem {
 public:
  AdjustProblem(const AdjustOptions& options, Bundle* bundle)
      : bundle_(*bundle),
        options_(options),
        unknowns_(*bundle),
        write_(unknowns_, bundle),
        problem_(ProblemOptions()),
        marker_block_used_(unknowns_.MarkerBlocks(), false),
        camera_used_(CamerasWithData(*bundle)),
        view_used_(bundle->jitter.delta.size(), false),
        frame_used_(bundle->T_rig_target.size(), false),
        target_used_(bundle->targets.size(), false),
        has_distance_(unknowns_.MarkerBlocks(), false) {
    for (const BundleCamera& camera : bundle->cameras) rows_.emplace_back(camera);
    FindUsed();
    AddParamPriors();
    AddCalibrationPrior();
    AddObservations();
    AddJitterPriors();
    AddMarkerPriors();
    AddDistances();
    HoldFrame();
  }

  /// Leaves the bundle as it is if the result is not usable.
  AdjustSummary Solve();

 private:
  ceres::Problem::Options ProblemOptions() {
    ceres::Problem::Options options;
    options.enable_fast_removal = false;
    options.disable_all_safety_checks = true;
    options.evaluation_callback = &write_;
    return options;
  }

  void FindUsed();
  void AddObservations();
  // Observations of one view and one block of markers.
  void AddGroup(std::span<const BundleObservation> group);
  void AddJitterPriors();
  void AddParamPriors();
  void AddMarkerPriors();
  void AddDistances();
  void AddCalibrationPrior();
  void HoldFrame();
  // Lets the solver estimate the parameters of a block that are not fixed, within their bounds.
  void EstimateFree(const IntrinsicsBlock& block);
  // Fixes parameters that have come to a bound, along which Ceres converges slowly; false where
  // there is none.
  bool FixAtBounds();
  [[nodiscard]] bool EliminatesMarkersFirst() const;
  [[nodiscard]] size_t DenseUnknowns() const;
  [[nodiscard]] ceres::ParameterBlockOrdering Ordering();
  [[nodiscard]] ceres::Solver::Options SolverOptions() const;

  Bundle& bundle_;
  const AdjustOptions& options_;
  Unknowns unknowns_;
  WriteUnknowns write_;
  std::vector<RowMemory> rows_;  // per camera
  ceres::Problem problem_;
  std::vector<bool> marker_block_used_, camera_used_, view_used_, frame_used_, target_used_;
  std::vector<bool> has_distance_;  // per marker block: shares a residual with another
  std::vector<IntrinsicsBlock*> blocks_used_;
};

void AdjustProblem::FindUsed() {
  const auto per_block = static_cast<size_t>(MarkersPerBlock(bundle_));
  for (const BundleObservation& observation : bundle_.observations) {
    if (!observation.used) continue;
    const auto frame = static_cast<size_t>(observation.frame);
    const auto camera = static_cast<size_t>(observation.camera);
    frame_used_[frame] = true;
    if (bundle_.EstimatesJitter()) view_used_[bundle_.View(frame, camera)] = true;
    if (bundle_.EstimatesMarkers()) {
      marker_block_used_[static_cast<size_t>(observation.marker) / per_block] = true;
    }
    const std::optional<size_t> target = bundle_.FreeTarget(observation.marker);
    if (target) target_used_[*target] = true;
  }
}

void AdjustProblem::AddObservations() {
  const std::span<const BundleObservation> observations = bundle_.observations;
  const int per_block = MarkersPerBlock(bundle_);
  for (size_t begin = 0, end = 0; begin < observations.size(); begin = end) {
    const BundleObservation& first = observations[begin];
    bool any = false;
    for (; end < observations.size(); ++end) {
      const BundleObservation& next = observations[end];
      if (next.frame != first.frame || next.camera != first.camera ||
          next.marker / per_block != first.marker / per_block ||
          bundle_.FreeTarget(next.marker) != bundle_.FreeTarget(first.marker)) {
        break;
      }
      any |= next.used;
    }
    if (any) AddGroup(observations.subspan(begin, end - begin));
  }
}

void AdjustProblem::AddGroup(std::span<const BundleObservation> group) {
  const auto frame = static_cast<size_t>(group[0].frame);
  const auto camera = static_cast<size_t>(group[0].camera);
  const auto marker_block = static_cast<size_t>(group[0].marker / MarkersPerBlock(bundle_));
  const ViewUnknowns view{
      .intrinsics = &unknowns_.intrinsics[camera],
      .extrinsics = bundle_.cameras[camera].is_master ? nullptr : &unknowns_.extrinsics[camera],
      .pose = &unknowns_.poses[frame],
      .target = bundle_.FreeTarget(group[0].marker)};
  std::vector<double*> blocks{view.intrinsics->block->values};
  if (view.extrinsics != nullptr) blocks.push_back(view.extrinsics->delta);
  blocks.push_back(view.pose->delta);
  if (bundle_.EstimatesJitter()) {
    blocks.push_back(unknowns_.Jitter(bundle_.View(frame, camera)));
  }
  if (view.target) blocks.push_back(unknowns_.targets[*view.target].delta);
  if (bundle_.EstimatesMarkers()) blocks.push_back(unknowns_.MarkerBlock(marker_block));
  problem_.AddResidualBlock(
      new ViewCost(
          bundle_, unknowns_, view, group, {options_.loss, options_.loss_width}, &rows_[camera]),
      nullptr,
      blocks);
}

void AdjustProblem::AddJitterPriors() {
  if (!bundle_.EstimatesJitter()) return;
  for (size_t frame = 0; frame < frame_used_.size(); ++frame) {
    for (size_t c = 0; frame_used_[frame] && c < bundle_.cameras.size(); ++c) {
      const size_t view = bundle_.View(frame, c);
      if (!view_used_[view]) continue;
      problem_.AddResidualBlock(
          new ceres::NormalPrior(JitterWeight(bundle_, frame, c), Vector6d::Zero()),
          nullptr,
          unknowns_.Jitter(view));
    }
  }
}

void AdjustProblem::AddParamPriors() {
  for (size_t c = 0; c < bundle_.cameras.size(); ++c) {
    if (!camera_used_[c]) continue;
    IntrinsicsBlock& block = *unknowns_.intrinsics[c].block;
    if (std::find(blocks_used_.begin(), blocks_used_.end(), &block) != blocks_used_.end()) continue;
    blocks_used_.push_back(&block);
    for (const SlotPrior& prior : block.priors) {
      Matrix A = Matrix::Zero(1, static_cast<Eigen::Index>(block.Size()));
      for (const auto& [slot, weight] : prior.terms) {
        A(0, static_cast<Eigen::Index>(slot)) += weight / prior.sigma;
      }
      const Eigen::VectorXd b = prior.value / (prior.sigma * A.squaredNorm()) * A.transpose();
      problem_.AddResidualBlock(new ceres::NormalPrior(A, b), nullptr, block.values);
    }
  }
}

void AdjustProblem::AddMarkerPriors() {
  if (bundle_.HasLandmarks()) return;
  const size_t block_size = unknowns_.marker_block_size, per_block = block_size / 3;
  for (size_t block = 0; block < marker_block_used_.size(); ++block) {
    if (!marker_block_used_[block]) continue;
    const size_t in_block = std::min(per_block, bundle_.markers.size() - block * per_block);
    const Eigen::Map<const Eigen::VectorXd> nominal(
        unknowns_.nominal_markers.data() + block * block_size,
        static_cast<Eigen::Index>(block_size));
    problem_.AddResidualBlock(
        new ceres::NormalPrior(
            Matrix(Matrix::Identity(static_cast<Eigen::Index>(3 * in_block), nominal.size()) /
                   bundle_.marker_freedom.Sigma()),
            nominal),
        nullptr,
        unknowns_.MarkerBlock(block));
    if (in_block == per_block) continue;
    std::vector<int> spare;
    for (size_t i = 3 * in_block; i < block_size; ++i) spare.push_back(static_cast<int>(i));
    problem_.SetManifold(unknowns_.MarkerBlock(block),
                         new ceres::SubsetManifold(static_cast<int>(block_size), spare));
  }
}

void AdjustProblem::AddDistances() {
  const auto used = [&](int marker) { return marker_block_used_[static_cast<size_t>(marker)]; };
  for (const DistanceRows& rows : RowsOfDistances(bundle_, used)) {
    std::vector<double*> blocks;
    for (const int marker : rows.Markers()) {
      has_distance_[static_cast<size_t>(marker)] = true;
      blocks.push_back(unknowns_.MarkerBlock(static_cast<size_t>(marker)));
    }
    problem_.AddResidualBlock(new DistanceCost(rows), nullptr, blocks);
  }
}

// Cameras without used observations keep the prior's values, since nothing moves them.
void AdjustProblem::AddCalibrationPrior() {
  if (!bundle_.prior) return;
  auto* const cost = new CalibrationPriorCost(bundle_, unknowns_);
  problem_.AddResidualBlock(cost, nullptr, cost->Blocks());
  for (const CalibrationPrior::Unknown& unknown : bundle_.prior->unknowns) {
    camera_used_[unknown.camera] = true;
    IntrinsicsBlock* const block = unknowns_.intrinsics[unknown.camera].block;
    if (!unknown.param || std::ranges::find(blocks_used_, block) != blocks_used_.end()) continue;
    blocks_used_.push_back(block);
  }
}

void AdjustProblem::HoldFrame() {
  if (!bundle_.fixed_frame || !frame_used_[*bundle_.fixed_frame]) return;
  problem_.SetParameterBlockConstant(unknowns_.poses[*bundle_.fixed_frame].delta);
}

void AdjustProblem::EstimateFree(const IntrinsicsBlock& block) {
  std::vector<int> fixed;
  for (size_t slot = 0; slot < block.Size(); ++slot) {
    const int i = static_cast<int>(slot);
    if (block.fixed[slot]) {
      fixed.push_back(i);
      continue;
    }
    if (std::isfinite(block.lower[slot])) {
      problem_.SetParameterLowerBound(block.values, i, block.lower[slot]);
    }
    if (std::isfinite(block.upper[slot])) {
      problem_.SetParameterUpperBound(block.values, i, block.upper[slot]);
    }
  }
  if (fixed.size() == block.Size()) {
    problem_.SetParameterBlockConstant(block.values);
  } else if (!fixed.empty()) {
    problem_.SetManifold(block.values,
                         new ceres::SubsetManifold(static_cast<int>(block.Size()), fixed));
  }
}

bool AdjustProblem::FixAtBounds() {
  bool any = false;
  for (IntrinsicsBlock* block : blocks_used_) {
    for (size_t slot = 0; slot < block->Size(); ++slot) {
      const double value = block->values[slot];
      if (block->fixed[slot] || (value > block->lower[slot] && value < block->upper[slot]))
        continue;
      block->fixed[slot] = any = true;
    }
  }
  return any;
}

// The blocks that are eliminated first must not share residuals: the jitter of the views when there
// is any, else the poses; or the markers, where they are more unknowns. The rest is small and
// dense.
bool AdjustProblem::EliminatesMarkersFirst() const {
  const size_t views = 6 * CountTrue(bundle_.EstimatesJitter() ? view_used_ : frame_used_);
  return unknowns_.marker_block_size * CountTrue(marker_block_used_) > views;
}

size_t AdjustProblem::DenseUnknowns() const {
  const size_t poses = 6 * CountTrue(frame_used_), jitter = 6 * CountTrue(view_used_);
  const size_t markers = unknowns_.marker_block_size * CountTrue(marker_block_used_);
  const size_t eliminated =
      EliminatesMarkersFirst() ? markers : (bundle_.EstimatesJitter() ? jitter : poses);
  size_t dense = poses + jitter + markers - eliminated + 6 * CountTrue(camera_used_) +
                 6 * CountTrue(target_used_);
  for (const IntrinsicsBlock* block : blocks_used_) dense += block->Size();
  return dense;
}

ceres::ParameterBlockOrdering AdjustProblem::Ordering() {
  const bool markers_first = EliminatesMarkersFirst(), jitter = bundle_.EstimatesJitter();
  ceres::ParameterBlockOrdering ordering;
  for (size_t frame = 0; frame < frame_used_.size(); ++frame) {
    if (!frame_used_[frame]) continue;
    ordering.AddElementToGroup(unknowns_.poses[frame].delta, jitter || markers_first ? 1 : 0);
  }
  for (size_t view = 0; view < view_used_.size(); ++view) {
    if (!view_used_[view]) continue;
    ordering.AddElementToGroup(unknowns_.Jitter(view), markers_first ? 1 : 0);
  }
  for (const IntrinsicsBlock* block : blocks_used_) ordering.AddElementToGroup(block->values, 1);
  for (size_t c = 0; c < camera_used_.size(); ++c) {
    if (!camera_used_[c] || bundle_.cameras[c].is_master) continue;
    ordering.AddElementToGroup(unknowns_.extrinsics[c].delta, 1);
  }
  for (size_t k = 0; k < target_used_.size(); ++k) {
    if (target_used_[k]) ordering.AddElementToGroup(unknowns_.targets[k].delta, 1);
  }
  for (size_t block = 0; block < marker_block_used_.size(); ++block) {
    if (!marker_block_used_[block]) continue;
    ordering.AddElementToGroup(unknowns_.MarkerBlock(block),
                               markers_first && !has_distance_[block] ? 0 : 1);
  }
  return ordering;
}

ceres::Solver::Options AdjustProblem::SolverOptions() const {
  ceres::Solver::Options solver;
  solver.linear_solver_type =
      DenseUnknowns() <= (bundle_.HasLandmarks() ? kMaxDensePoses : kMaxDenseUnknowns)
          ? ceres::DENSE_SCHUR
          : ceres::SPARSE_SCHUR;
  // On which parameters of a local model a point depends changes during the solve, so that no
  // blocks of unknowns can state it.
  if (EstimatesLocalModel(bundle_)) {
    solver.linear_solver_type = ceres::SPARSE_NORMAL_CHOLESKY;
    solver.dynamic_sparsity = true;
  }
  solver.num_threads = 1;
  solver.logging_type = ceres::SILENT;
  solver.max_num_iterations = options_.max_iterations;
  solver.function_tolerance = options_.cost_tolerance;
  solver.gradient_tolerance = kGradientTolerance;
  solver.parameter_tolerance = kStepTolerance;
  solver.initial_trust_region_radius = FirstTrustRegion(options_);
  return solver;
}

AdjustSummary AdjustProblem::Solve() {
  const BundleState before = bundle_;
  ceres::Solver::Options solver = SolverOptions();
  IterationReport report(options_);
  solver.callbacks.push_back(&report);
  AdjustSummary summary;
  bool again = true;
  for (bool first = true; again; first = false) {
    for (const IntrinsicsBlock* block : blocks_used_) EstimateFree(*block);
    // The solver removes constant blocks from the ordering that it is given.
    solver.linear_solver_ordering = std::make_shared<ceres::ParameterBlockOrdering>(Ordering());
    ceres::Solver::Summary solved;
    ceres::Solve(solver, &problem_, &solved);
    summary.usable = solved.IsSolutionUsable();
    summary.converged = solved.termination_type == ceres::CONVERGENCE;
    summary.stopped = solved.termination_type == ceres::USER_FAILURE;
    summary.iterations += static_cast<int>(solved.iterations.size());
    if (first) summary.cost_before = solved.initial_cost;
    summary.cost = solved.final_cost;
    summary.message = solved.message;
    again = summary.usable && FixAtBounds();
  }
  static_cast<BundleState&>(bundle_) = before;
  if (summary.usable) {
    unknowns_.WriteTo(&bundle_);
    SetAtBounds(&bundle_);
  }
  return summary;
}

}  // namespace

AdjustSummary MinimiseAllUnknowns(const AdjustOptions& options, Bundle* bundle) {
  return AdjustProblem(options, bundle).Solve();
}

}  // namespace plenocal::internal
