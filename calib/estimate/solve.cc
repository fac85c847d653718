// SPDX-License-Identifier: Apache-2.0
#include "calib/estimate/solve.h"

#include <algorithm>
#include <utility>

#include "calib/adjust/poses.h"
#include "calib/adjust/solver/adjust.h"
#include "calib/base/format_error.h"
#include "calib/estimate/reject.h"
#include "calib/estimate/rig_rigidity.h"
#include "calib/noise/camera_noise.h"
#include "calib/noise/landmark_system.h"

namespace plenocal {
namespace {

constexpr int kMaxRounds = 10;
// The optimum moves with the square of a small change of the weights, the sigmas in proportion.
constexpr double kNoiseTolerance = 5e-3;

// Rejections and noise do not depend on the last digits of the optimum. The fine solve waits until
// few observations are rejected any more; where it lowers the cost by less than this part of it, it
// changes neither.
constexpr double kCoarseTolerance = 1e-4;
// For the first frames, whose observations are not chosen yet.
constexpr double kFirstTolerance = 1e-3;

// A step that lowers half the sum of squares (in sigmas) by d moves the unknowns by about sqrt(2 d)
// sigma. The solver does not take the last one, which is a hundredth of a sigma at most.
double FineTolerance(const Bundle& bundle) {
  constexpr double kLastStep = 0.01;
  constexpr double kLeast = 1e-14, kMost = 1e-7;
  return std::clamp(kLastStep * kLastStep / 2 / static_cast<double>(bundle.observations.size() + 1),
                    kLeast,
                    kMost);
}

// Convergence of noise and rejections.
struct Convergence {
  bool at_once = false;  // the last solve has changed neither
  bool calm = false;     // with few rejections in all
};

// One run of the rounds.
class Rounds {
 public:
  Rounds(const SolveOptions& options, Bundle* bundle) : options_(options), bundle_(*bundle) {}

  Solution Run() {
    if (bundle_.HasLandmarks()) {
      StartWithLandmarks();
    } else {
      StartWithSomeFrames();
    }
    RepeatUntilConverged();
    if (options_.estimate_uncertainty) solution_.uncertainty = EstimateUncertainty(bundle_);
    return std::move(solution_);
  }

 private:
  // A part of the frames takes the long steps at a part of the cost.
  void StartWithSomeFrames() {
    constexpr size_t kFirstFrames = 40;
    const std::vector<bool> first = SelectFrames(bundle_, kFirstFrames);
    const std::vector<bool> all(first.size(), true);
    EstimateRobustNoise(first);
    UseProjecting(first, &bundle_);
    AdjustOnce(kFirstTolerance, options_.loss);
    EstimateRobustNoise(first);
    std::vector<bool> others = first;
    others.flip();
    UseProjecting(all, &bundle_);
    AdjustPoses(&bundle_, others);
    UseProjecting(all, &bundle_);
    DropWeakFrames(&bundle_);
  }

  // Few landmarks are seen in some frames only, and their start is good.
  void StartWithLandmarks() {
    const std::vector<bool> all(bundle_.T_rig_target.size(), true);
    EstimateRobustNoise(all);
    UseProjecting(all, &bundle_);
    RejectLandmarks(&bundle_);
    DropWeakFrames(&bundle_);
  }

  Rejection UpdateRejections() {
    return bundle_.HasLandmarks() ? RejectLandmarks(&bundle_) : RejectOutliers(&bundle_);
  }

  void RepeatUntilConverged() {
    Convergence convergence;
    for (int round = 0;; ++round) {
      CheckAllCamerasUsed(bundle_);
      const bool last = convergence.at_once || round == kMaxRounds;
      const bool fine = convergence.calm || last;
      // Landmarks with few observations, all of them in the linear part of a loss, converge slowly.
      const double gain = AdjustOnce(fine ? FineTolerance(bundle_) : kCoarseTolerance,
                                     fine && bundle_.HasLandmarks() ? Loss::kNone : options_.loss);
      if (last || (convergence.calm && gain < kCoarseTolerance)) return;
      // Rejections change the degrees of freedom little.
      if (round == 0 || bundle_.EstimatesJitter() || bundle_.HasLandmarks()) CountUsedDegrees();
      const double jitter_change = UpdateJitter(solution_.uncertainty, &bundle_);
      convergence = UpdateNoiseAndRejections(round == 0);
      if (jitter_change >= kNoiseTolerance) convergence = {};
      DropWeakFrames(&bundle_);
    }
  }

  void EstimateRobustNoise(const std::vector<bool>& frames) {
    const std::vector<size_t> outside =
        EstimateNoiseRobustly(frames, options_.typical_sigmas, &bundle_);
    if (outside.empty()) return;
    throw JobError(
        "{}: most observations lie outside the domain of model {}; does the "
        "model suit the lens?",
        bundle_.cameras[outside[0]].name,
        bundle_.cameras[outside[0]].model->name);
  }

  // Returns the part by which the cost fell.
  double AdjustOnce(double cost_tolerance, Loss loss) {
    AdjustOptions adjust;
    adjust.loss = loss;
    adjust.cost_tolerance = cost_tolerance;
    adjust.near_optimum = solution_.converged;
    adjust.on_iteration = [&](int, double) { return options_.go_on(); };
    const AdjustSummary summary = Adjust(&bundle_, adjust);
    solution_.iterations += summary.iterations;
    solution_.converged = summary.converged;
    if (summary.stopped) throw Stopped();
    if (!summary.usable) {
      throw Error(ErrorKind::kJob, "the bundle adjustment failed: " + summary.message);
    }
    return summary.cost < summary.cost_before ? 1 - summary.cost / summary.cost_before : 0;
  }

  void CountUsedDegrees() {
    const std::vector<double> coordinates = UsedCoordinates(bundle_);
    if (bundle_.HasLandmarks()) {
      used_degrees_.clear();
      for (const double count : DegreesWithLandmarks(bundle_)) {
        used_degrees_.push_back({count, count});
      }
      return;
    }
    solution_.uncertainty = EstimateUncertainty(bundle_);
    used_degrees_.resize(coordinates.size());
    for (size_t c = 0; c < coordinates.size(); ++c) {
      used_degrees_[c] = {coordinates[c] - solution_.uncertainty.redundancy[c],
                          solution_.uncertainty.degrees_used_by_means[c]};
    }
  }

  // Noise and rejections follow from each other, without a solve between them once the worst
  // outliers are out, which took part in the solve before the first round.
  Convergence UpdateNoiseAndRejections(bool first_round) {
    // One observation in a thousand moves the optimum by less than a tenth of a sigma. Of
    // landmarks, which come and go as a whole, more change places without an end.
    constexpr double kFewChange = 1e-3, kFewOfLandmarks = 5e-3;
    const double few = (bundle_.HasLandmarks() ? kFewOfLandmarks : kFewChange) *
                       static_cast<double>(bundle_.observations.size());
    double changed = 0;
    for (int pass = 0; pass < kMaxRounds; ++pass) {
      const double noise_change = UpdateNoise(options_.typical_sigmas, used_degrees_, &bundle_);
      const Rejection rejection = UpdateRejections();
      solution_.rejection_threshold = rejection.threshold;
      const auto changed_now = static_cast<double>(rejection.changed);
      changed += changed_now;
      if (changed_now <= few && noise_change < kNoiseTolerance) {
        return {.at_once = pass == 0, .calm = changed <= few};
      }
      if (first_round && changed_now > few) break;
    }
    return {};
  }

  const SolveOptions& options_;
  Bundle& bundle_;
  Solution solution_;
  std::vector<UsedDegrees> used_degrees_;  // per camera
};

}  // namespace

Solution Solve(const SolveOptions& options, Bundle* bundle) {
  return Rounds(options, bundle).Run();
}

}  // namespace plenocal
