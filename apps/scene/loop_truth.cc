// SPDX-License-Identifier: Apache-2.0
#include "apps/scene/loop_truth.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <optional>
#include <set>

#include "apps/scene/scene_start.h"
#include "calib/base/error.h"
#include "calib/base/number_text.h"
#include "calib/solve.h"

namespace plenocal {
namespace {

// Markers that each frame shows.
std::vector<std::set<int>> MarkersOfFrames(const Bundle& bundle) {
  std::vector<std::set<int>> markers(bundle.T_rig_target.size());
  for (const BundleObservation& observation : bundle.observations) {
    markers[static_cast<size_t>(observation.frame)].insert(observation.marker);
  }
  return markers;
}

// The frame of `frames` whose pose most of the points known so far agree with.
struct Registration {
  size_t frame = 0;
  PoseSearch pose;
};

std::optional<Registration> Register(const SceneState& state,
                                     const std::vector<size_t>& frames,
                                     size_t* most_known) {
  constexpr size_t kTried = 20;
  const std::vector<std::set<int>> markers = MarkersOfFrames(*state.bundle);
  std::vector<std::pair<size_t, size_t>> known;  // number of known points, frame
  for (const size_t frame : frames) {
    const auto count = std::ranges::count_if(
        markers[frame], [&](int m) { return state.has_point[static_cast<size_t>(m)]; });
    known.emplace_back(count, frame);
  }
  std::ranges::stable_sort(known, std::greater<>(), &std::pair<size_t, size_t>::first);
  *most_known = known.empty() ? 0 : known[0].first;
  std::optional<Registration> best;
  for (size_t i = 0; i < std::min(kTried, known.size()); ++i) {
    const std::optional<PoseSearch> pose = FindPose(state, known[i].second);
    if (!pose || (best && pose->inliers <= best->pose.inliers)) continue;
    best = Registration{known[i].second, *pose};
  }
  return best;
}

class LoopEstimation {
 public:
  explicit LoopEstimation(const LoopTruthInput& input) : input_(input), state_(MakeState()) {}

  LoopTruthResult Run() {
    Enter("start segment");
    FollowFrames(input_.segments.start, &state_);
    result_.start = Posed(input_.segments.start);
    if (result_.start.frames.size() < kFewestFrames) {
      throw Error(ErrorKind::kJob,
                  fmt::format("start segment: poses for {} of {} only; the images overlap too "
                              "little, or the calibration does not fit them",
                              result_.start.frames.size(),
                              Counted(input_.segments.start.size(), "frame")));
    }
    Enter("end segment");
    RegisterEnd();
    Enter("bundle adjustment");
    Adjust();
    Enter("uncertainty");
    result_.covariance = EstimateLoopCovariance(
        result_.bundle, 0, result_.start.frames, result_.end.frames);
    Measure();
    return std::move(result_);
  }

 private:
  // A similarity needs three positions.
  static constexpr size_t kFewestFrames = 3;

  SceneState MakeState() {
    result_.bundle = MakeSceneBundle(*input_.tracks, input_.rig->cameras);
    result_.bundle.prior = input_.rig->prior;
    return MakeSceneState(&result_.bundle);
  }

  void Enter(const char* stage) const {
    if (input_.progress && !input_.progress(stage)) throw Stopped();
  }

  SegmentTruth Posed(const std::vector<size_t>& frames) const {
    SegmentTruth segment;
    for (const size_t frame : frames) {
      (state_.has_pose[frame] ? segment.frames : segment.left_out).push_back(frame);
    }
    return segment;
  }

  void RegisterEnd() {
    size_t most_known = 0;
    const std::vector<size_t>& frames = input_.segments.end;
    const std::optional<Registration> found = Register(state_, frames, &most_known);
    if (!found) {
      throw Error(
          ErrorKind::kJob,
          fmt::format("start and end do not see the same scene: {} in common in any frame of the "
                      "end, {}; give --start and --end",
                      Counted(most_known, "point"),
                      most_known < kFewestLandmarks ? "too few for a pose"
                                                    : "which contradict each other"));
    }
    result_.bundle.T_rig_target[found->frame] = found->pose.T_rig_target;
    state_.has_pose[found->frame] = true;
    const auto at = std::ranges::find(frames, found->frame);
    FollowFrames({at, frames.end()}, &state_);
    FollowFrames({std::make_reverse_iterator(std::next(at)), frames.rend()}, &state_);
    result_.end = Posed(frames);
    if (result_.end.frames.size() >= kFewestFrames) return;
    throw Error(ErrorKind::kJob,
                fmt::format("end segment: poses for {} of {} only; the images overlap too little",
                            result_.end.frames.size(),
                            Counted(frames.size(), "frame")));
  }

  void Adjust() {
    KeepStarted(state_, &result_.bundle);
    result_.bundle.held_frame = result_.start.frames.front();
    SolveOptions options;
    options.typical_sigmas = TypicalSigmas(result_.bundle);
    options.estimate_uncertainty = false;
    options.go_on = [&] { return !input_.progress || input_.progress("bundle adjustment"); };
    const Solution solution = Solve(options, &result_.bundle);
    result_.converged = solution.converged;
    result_.iterations = solution.iterations;
    DropUnused(&result_.start);
    DropUnused(&result_.end);
  }

  // The adjustment may have rejected all of a frame's points.
  void DropUnused(SegmentTruth* segment) const {
    std::set<size_t> used;
    for (const BundleObservation& observation : result_.bundle.observations) {
      if (observation.used) used.insert(static_cast<size_t>(observation.frame));
    }
    std::erase_if(segment->frames, [&](size_t frame) {
      if (used.contains(frame)) return false;
      segment->left_out.push_back(frame);
      return true;
    });
    std::ranges::sort(segment->left_out);
    if (segment->frames.size() >= kFewestFrames) return;
    throw Error(ErrorKind::kJob,
                "most points contradict each other; does the calibration belong to this rig, and "
                "are the images of a frame taken at one time?");
  }

  void Measure() {
    const Bundle& bundle = result_.bundle;
    const std::set<size_t> start(result_.start.frames.begin(), result_.start.frames.end());
    std::vector<bool> in_start(bundle.markers.size(), false), in_end(in_start);
    std::vector<double> squares(bundle.cameras.size(), 0), counts(squares);
    for (const BundleObservation& observation : bundle.observations) {
      double residual[kMaxObservationSize];
      if (!observation.used || !Residual(bundle, observation, residual)) continue;
      ++result_.observations;
      const auto c = static_cast<size_t>(observation.camera);
      const bool of_start = start.contains(static_cast<size_t>(observation.frame));
      (of_start ? in_start : in_end)[static_cast<size_t>(observation.marker)] = true;
      for (size_t r = 0; r < bundle.cameras[c].model->measured.size(); ++r) {
        squares[c] += residual[r] * residual[r];
      }
      counts[c] += 1;
    }
    for (size_t m = 0; m < in_start.size(); ++m) {
      result_.points += in_start[m] || in_end[m] ? 1 : 0;
      result_.common += in_start[m] && in_end[m] ? 1 : 0;
    }
    for (size_t c = 0; c < squares.size(); ++c) {
      result_.rms.push_back(std::sqrt(squares[c] / std::max(1.0, counts[c])));
    }
    MeasurePriorChange();
  }

  void MeasurePriorChange() {
    if (!result_.bundle.prior) return;
    const CalibrationPrior& prior = *result_.bundle.prior;
    const Eigen::VectorXd deviation = DeviationFromPrior(result_.bundle);
    result_.prior_unknowns = static_cast<int>(prior.unknowns.size());
    result_.prior_change = (prior.weight * deviation).squaredNorm();
    const Eigen::MatrixXd covariance =
        (prior.weight.transpose() * prior.weight).ldlt().solve(
            Eigen::MatrixXd::Identity(deviation.size(), deviation.size()));
    for (Eigen::Index i = 0; i < deviation.size(); ++i) {
      const double sigmas = std::abs(deviation[i]) / std::sqrt(covariance(i, i));
      if (sigmas <= result_.most_changed_sigmas) continue;
      result_.most_changed_sigmas = sigmas;
      result_.most_changed = NameOfPriorUnknown(result_.bundle, static_cast<size_t>(i));
    }
  }

  const LoopTruthInput& input_;
  LoopTruthResult result_;
  SceneState state_;
};

}  // namespace

LoopTruthResult EstimateLoopTruth(const LoopTruthInput& input) {
  return LoopEstimation(input).Run();
}

}  // namespace plenocal
