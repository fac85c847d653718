// SPDX-License-Identifier: Apache-2.0
#include "apps/groundtruth/loop_truth.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <optional>
#include <set>
#include <utility>

#include "calib/base/format_error.h"
#include "calib/base/number_text.h"
#include "calib/estimate/solve.h"
#include "calib/estimate/start_bundle.h"
#include "engine/scene/scene_start.h"
#include "engine/scene/scene_views.h"
#include "engine/scene/virtual_camera.h"

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
                                     std::optional<double> limit,
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
    const std::optional<PoseSearch> pose = FindPose(state, known[i].second, limit);
    if (!pose || (best && pose->inliers <= best->pose.inliers)) continue;
    best = Registration{known[i].second, *pose};
  }
  return best;
}

// A similarity needs three positions.
constexpr size_t kFewestFrames = 3;

// The frames that follow from `first` by enough points in common with those that have followed.
std::set<int> GrowGroup(int first, const std::map<int, std::set<int>>& landmarks) {
  std::set<int> group{first}, known = landmarks.at(first);
  for (bool grows = true; grows;) {
    grows = false;
    for (const auto& [frame, own] : landmarks) {
      if (group.contains(frame)) continue;
      const auto common = std::ranges::count_if(own, [&](int m) { return known.contains(m); });
      if (static_cast<size_t>(common) < kFewestLandmarks) continue;
      group.insert(frame);
      known.insert(own.begin(), own.end());
      grows = true;
    }
  }
  return group;
}

// Rejection can leave frames, or a whole stretch of them, that have fewer points in common with
// the others than a pose needs: their pose against these is not determined.
void LeaveOutLooseFrames(Bundle* bundle) {
  std::map<int, std::set<int>> landmarks;  // used ones, by frame
  for (const BundleObservation& seen : bundle->observations) {
    if (seen.used) landmarks[seen.frame].insert(seen.marker);
  }
  std::set<int> best, placed;
  for (const auto& [frame, own] : landmarks) {
    if (placed.contains(frame)) continue;
    const std::set<int> group = GrowGroup(frame, landmarks);
    placed.insert(group.begin(), group.end());
    if (group.size() > best.size()) best = group;
  }
  for (BundleObservation& seen : bundle->observations) {
    seen.used = seen.used && best.contains(seen.frame);
  }
}

// Poses and points relative to the first frame's pose.
void MoveToFirstFrame(Bundle* bundle) {
  const RigidTransform T_first_world = bundle->T_rig_target[*bundle->fixed_frame];
  for (RigidTransform& T : bundle->T_rig_target) T = T * T_first_world.Inverse();
  for (BundleMarker& marker : bundle->markers) marker.position = T_first_world * marker.position;
}

[[noreturn]] void RefuseContradiction() {
  throw JobError(
      "most points contradict each other; does the calibration belong to this rig, and "
      "are the images of a frame taken at one time?");
}

// The adjustment may have rejected all of a frame's points.
void DropUnused(const Bundle& bundle, SegmentTruth* segment) {
  std::set<size_t> used;
  for (const BundleObservation& observation : bundle.observations) {
    if (observation.used) used.insert(static_cast<size_t>(observation.frame));
  }
  std::erase_if(segment->frames, [&](size_t frame) {
    if (used.contains(frame)) return false;
    segment->left_out.push_back(frame);
    return true;
  });
  std::ranges::sort(segment->left_out);
  if (segment->frames.size() < kFewestFrames) RefuseContradiction();
}

void MeasurePriorChange(LoopTruthResult* result) {
  if (!result->bundle.prior) return;
  const CalibrationPrior& prior = *result->bundle.prior;
  const Eigen::VectorXd deviation = DeviationFromPrior(result->bundle);
  result->prior_unknowns = static_cast<int>(prior.unknowns.size());
  result->prior_change = (prior.weight * deviation).squaredNorm();
  const Eigen::MatrixXd covariance =
      (prior.weight.transpose() * prior.weight)
          .ldlt()
          .solve(Eigen::MatrixXd::Identity(deviation.size(), deviation.size()));
  for (Eigen::Index i = 0; i < deviation.size(); ++i) {
    const double sigmas = std::abs(deviation[i]) / std::sqrt(covariance(i, i));
    if (sigmas <= result->most_changed_sigmas) continue;
    result->most_changed_sigmas = sigmas;
    result->most_changed = NameOfPriorUnknown(result->bundle, static_cast<size_t>(i));
  }
}

void Measure(LoopTruthResult* result) {
  const Bundle& bundle = result->bundle;
  const std::set<size_t> start(result->start.frames.begin(), result->start.frames.end());
  std::vector<bool> in_start(bundle.markers.size(), false), in_end(in_start);
  std::vector<double> squares(bundle.cameras.size(), 0), counts(squares);
  for (const BundleObservation& observation : bundle.observations) {
    double residual[kMaxObservationSize];
    if (!observation.used || !Residual(bundle, observation, residual)) continue;
    ++result->observations;
    const auto c = static_cast<size_t>(observation.camera);
    const bool of_start = start.contains(static_cast<size_t>(observation.frame));
    (of_start ? in_start : in_end)[static_cast<size_t>(observation.marker)] = true;
    for (size_t r = 0; r < bundle.cameras[c].model->measured.size(); ++r) {
      squares[c] += residual[r] * residual[r];
    }
    counts[c] += 1;
  }
  for (size_t m = 0; m < in_start.size(); ++m) {
    result->points += in_start[m] || in_end[m] ? 1 : 0;
    result->common += in_start[m] && in_end[m] ? 1 : 0;
  }
  for (size_t c = 0; c < squares.size(); ++c) {
    result->rms.push_back(std::sqrt(squares[c] / std::max(1.0, counts[c])));
    // Directions wrong by about half a degree are no noise: the poses are not those of the
    // frames.
    constexpr double kMostRms = 0.01;  // of the image's diagonal
    const ImageSize size = bundle.cameras[c].image_size;
    if (result->rms.back() > kMostRms * std::hypot(size[0], size[1])) RefuseContradiction();
  }
  MeasurePriorChange(result);
}

class LoopEstimation {
 public:
  explicit LoopEstimation(const LoopTruthInput& input) : input_(input), state_(MakeState()) {}

  LoopTruthResult Run() {
    Enter("start segment");
    if (HasOnlyPlenopticCameras()) {
      StartFromVirtualImage();
    } else {
      StartFromRays();
    }
    Enter("bundle adjustment");
    Adjust();
    Enter("uncertainty");
    result_.covariance =
        EstimateLoopCovariance(result_.bundle, 0, result_.start.frames, result_.end.frames);
    Measure(&result_);
    return std::move(result_);
  }

 private:
  // A fifth of it is a pixel's error of a usual camera.
  static constexpr double kLeastParallax = 1.0 / 200;

  bool HasOnlyPlenopticCameras() const {
    return std::ranges::all_of(input_.rig->cameras,
                               [](const BundleCamera& camera) { return camera.model->plenoptic; });
  }

  // Points from the cameras of one frame, then frame by frame.
  void StartFromRays() {
    FollowBothWays(input_.segments.start, FrameWithMostPoints(input_.segments.start));
    result_.start = Posed(input_.segments.start);
    CheckStart();
    Enter("end segment");
    RegisterEnd();
  }

  // A plenoptic camera's own distances are too noisy to place points by one view: with them a
  // narrow image cannot tell translation from rotation. Its virtual image is an ordinary camera's,
  // whose poses and points follow up to scale; the median of all distances is the scale.
  void StartFromVirtualImage() {
    Bundle& bundle = result_.bundle;
    const BundleCamera& camera = bundle.cameras[0];
    const std::map<int, int> start_number(input_.tracks->matches.begin(),
                                          input_.tracks->matches.end());
    const auto number_of = [&](int number) {
      const auto found = start_number.find(number);
      return found == start_number.end() ? number : found->second;
    };
    CameraInput input{
        .name = camera.name,
        .model = camera.model,
        .config = camera.config,
        .initial = {camera.params.begin(), camera.params.begin() + camera.model->params.size()},
        .fixed = std::vector<bool>(camera.ModelParams(), false),
        .image_size = camera.image_size,
        .views = ViewsOfSegments()};
    for (View& view : input.views) {
      for (Observation& seen : view.observations) seen.marker = number_of(seen.marker);
    }
    const CameraInput image = VirtualCamera(input);
    const ReconstructedScene scene =
        ReconstructScene({.frames = input_.tracks->frames, .times = {}, .views = {image.views}},
                         {MakeBundleCamera(image, OrdinaryStart(image, image.image_size[0]))},
                         std::nullopt);
    const RigidTransform T_rig_camera = camera.T_camera_rig.Inverse();
    for (size_t frame = 0; frame < scene.T_rig_target.size(); ++frame) {
      if (!scene.T_rig_target[frame]) continue;
      bundle.T_rig_target[frame] = T_rig_camera * *scene.T_rig_target[frame];
      state_.has_pose[frame] = true;
    }
    for (size_t m = 0; m < bundle.markers.size(); ++m) {
      const auto found = scene.points.find(number_of(bundle.markers[m].number));
      if (found == scene.points.end()) continue;
      bundle.markers[m].position = found->second;
      state_.has_point[m] = true;
    }
    Rescale(ScaleByOwnDistances(state_).value_or(1));
    limit_ = ResidualLimit(state_);
    result_.start = Posed(input_.segments.start);
    CheckStart();
    result_.end = Posed(input_.segments.end);
    CheckEnd();
    MergeMatches(FindMatches());
    AdjustStarted(false, &state_);
  }

  std::vector<View> ViewsOfSegments() const {
    std::set<std::string> frames;
    for (const auto* segment : {&input_.segments.start, &input_.segments.end}) {
      for (const size_t frame : *segment) frames.insert(input_.tracks->frames[frame]);
    }
    std::vector<View> views = input_.tracks->views[0];
    std::erase_if(views, [&](const View& view) { return !frames.contains(view.frame); });
    return views;
  }

  void Rescale(double factor) {
    for (RigidTransform& T : result_.bundle.T_rig_target) T.t *= factor;
    for (BundleMarker& marker : result_.bundle.markers) marker.position *= factor;
  }

  void CheckStart() const {
    if (result_.start.frames.size() >= kFewestFrames) return;
    throw JobError(
        "start segment: poses for {} of {} only; the images overlap too "
        "little, or the calibration does not fit them",
        result_.start.frames.size(),
        Counted(input_.segments.start.size(), "frame"));
  }

  void CheckEnd() const {
    if (result_.end.frames.size() >= kFewestFrames) return;
    throw JobError("end segment: poses for {} of {} only; the images overlap too little",
                   result_.end.frames.size(),
                   Counted(input_.segments.end.size(), "frame"));
  }

  SceneState MakeState() {
    result_.bundle = MakeSceneBundle(*input_.tracks, input_.rig->cameras);
    result_.bundle.prior = input_.rig->prior;
    SceneState state = MakeSceneState(&result_.bundle);
    state.least_parallax = kLeastParallax;
    return state;
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

  // The frame whose cameras show most points from two sides.
  size_t FrameWithMostPoints(const std::vector<size_t>& frames) const {
    std::map<std::pair<size_t, int>, std::set<int>> cameras;  // of a frame's marker
    for (const BundleObservation& observation : result_.bundle.observations) {
      cameras[{static_cast<size_t>(observation.frame), observation.marker}].insert(
          observation.camera);
    }
    std::map<size_t, size_t> points;
    for (const auto& [place, seen_by] : cameras) points[place.first] += seen_by.size() > 1 ? 1 : 0;
    return *std::ranges::max_element(frames, {}, [&](size_t frame) { return points[frame]; });
  }

  // From a frame that has a pose, or is to be the first.
  void FollowBothWays(const std::vector<size_t>& frames, size_t from) {
    const auto at = std::ranges::find(frames, from);
    limit_ = std::max(limit_, FollowFrames({at, frames.end()}, &state_));
    FollowFrames({std::make_reverse_iterator(std::next(at)), frames.rend()}, &state_);
  }

  void RegisterEnd() {
    size_t most_known = 0;
    const std::vector<size_t>& frames = input_.segments.end;
    const std::vector<Match> matches = FindMatches();
    for (const Match& match : matches) Place(match);
    const std::optional<Registration> found =
        Register(state_,
                 frames,
                 matches.empty() ? std::nullopt : std::optional(kMatchLimits * limit_),
                 &most_known);
    if (!found) {
      throw JobError(
          "start and end do not see the same scene: {} in common in any frame of the "
          "end, {}; give --start and --end",
          Counted(most_known, "point"),
          most_known < kFewestLandmarks ? "too few for a pose" : "which contradict each other");
    }
    result_.bundle.T_rig_target[found->frame] = found->pose.T_rig_target;
    state_.has_pose[found->frame] = true;
    // Matched points that the pose confirms lead to the other frames.
    for (const Match& match : matches) {
      if (!AgreesIn(found->frame, match.end)) state_.has_point[match.end] = false;
    }
    FollowBothWays(frames, found->frame);
    result_.end = Posed(frames);
    MergeMatches(matches);
    CheckEnd();
  }

  // Indices of markers with like descriptors.
  struct Match {
    size_t start = 0, end = 0;
  };
  // Points of the end are where the start's are up to the error of the path between its frames.
  static constexpr double kMatchLimits = 2;

  // Markers of the end whose descriptor is that of one of the start with a position.
  std::vector<Match> FindMatches() const {
    std::map<int, size_t> index;
    for (size_t m = 0; m < result_.bundle.markers.size(); ++m) {
      index.emplace(result_.bundle.markers[m].number, m);
    }
    std::vector<Match> matches;
    for (const auto& [end, start] : input_.tracks->matches) {
      const auto of_end = index.find(end), of_start = index.find(start);
      if (of_end == index.end() || of_start == index.end()) continue;
      if (state_.has_point[of_start->second]) matches.push_back({of_start->second, of_end->second});
    }
    return matches;
  }

  void Place(const Match& match) {
    result_.bundle.markers[match.end].position = result_.bundle.markers[match.start].position;
    state_.has_point[match.end] = true;
  }

  // True where a frame shows a marker near its projection.
  bool AgreesIn(size_t frame, size_t marker) const {
    for (const size_t i : state_.observations_of[marker]) {
      const BundleObservation& observation = result_.bundle.observations[i];
      if (observation.frame != static_cast<int>(frame)) continue;
      if (ResidualLength(result_.bundle, observation) <= kMatchLimits * limit_) return true;
    }
    return false;
  }

  // The end's observations of a point that agree with the start's become observations of this.
  void MergeMatches(const std::vector<Match>& matches) {
    Bundle& bundle = result_.bundle;
    for (const Match& match : matches) {
      const Eigen::Vector3d own = bundle.markers[match.end].position;
      bundle.markers[match.end].position = bundle.markers[match.start].position;
      size_t shown = 0, agree = 0;
      for (const size_t i : state_.observations_of[match.end]) {
        const BundleObservation& observation = bundle.observations[i];
        if (!state_.has_pose[static_cast<size_t>(observation.frame)]) continue;
        ++shown;
        agree += ResidualLength(bundle, observation) <= kMatchLimits * limit_ ? 1 : 0;
      }
      bundle.markers[match.end].position = own;
      if (2 * agree <= shown) continue;
      for (const size_t i : state_.observations_of[match.end]) {
        bundle.observations[i].marker = static_cast<int>(match.start);
      }
    }
    SortObservations(&bundle);
    state_.observations_of = MakeSceneState(&bundle).observations_of;
  }

  // A frame whose start followed a moving object contradicts the others afterwards: it is looked
  // for again among the points that the adjustment has kept.
  void Adjust() {
    constexpr int kRevisions = 3;
    std::vector<BundleObservation> all = result_.bundle.observations;
    for (int i = 0;; ++i) {
      result_.start = Posed(input_.segments.start);
      result_.end = Posed(input_.segments.end);
      KeepStarted(state_, &result_.bundle);
      SolveOnce();
      if (i == kRevisions || !ReviseFrames(all)) break;
    }
    LeaveOutLooseFrames(&result_.bundle);
    DropUnused(result_.bundle, &result_.start);
    DropUnused(result_.bundle, &result_.end);
    result_.bundle.fixed_frame = result_.start.frames.front();
    FindRivalEnd(std::move(all));
    MoveToFirstFrame(&result_.bundle);
  }

  // Points that the end shows elsewhere than the start may agree on another pose of the end. Where
  // they are follows from the start alone. `all`: the observations before any was left out.
  void FindRivalEnd(std::vector<BundleObservation> all) {
    Bundle& bundle = result_.bundle;
    SceneState adjusted = MakeSceneState(&bundle);
    adjusted.has_pose.assign(bundle.T_rig_target.size(), true);
    adjusted.has_point.assign(bundle.markers.size(), true);
    const double limit = ResidualLimit(adjusted);  // of good points; `limit_` had the wrong ones
    const std::vector<BundleMarker> markers = bundle.markers;
    std::vector<BundleObservation> kept = std::exchange(bundle.observations, std::move(all));
    std::map<int, int> start_of;
    for (const Match& match : FindMatches()) start_of.emplace(match.end, match.start);
    for (BundleObservation& seen : bundle.observations) {
      const auto found = start_of.find(seen.marker);
      if (found != start_of.end()) seen.marker = found->second;
    }
    SortObservations(&bundle);
    SceneState state = MakeSceneState(&bundle);
    state.least_parallax = kLeastParallax;
    for (const size_t frame : result_.start.frames) state.has_pose[frame] = true;
    for (const BundleObservation& seen : kept) {
      if (!seen.used || !state.has_pose[static_cast<size_t>(seen.frame)]) continue;
      state.has_point[static_cast<size_t>(seen.marker)] = true;
    }
    for (const size_t frame : result_.start.frames) Triangulate(frame, limit, &state);
    result_.rival = FindAlternativePose(state, result_.end.frames, kMatchLimits * limit);
    bundle.observations = std::move(kept);
    bundle.markers = markers;
    if (!result_.rival || !result_.rival->IsAmbiguous()) return;
    throw JobError(
        "the end fits the start in two ways: {}; the scene repeats itself "
        "(windows, tiles, shelves) or has moved; give --start and --end that "
        "show another part of it",
        result_.rival->Text());
  }

  void SolveOnce() {
    result_.bundle.fixed_frame = result_.start.frames.front();
    SolveOptions options;
    options.typical_sigmas = TypicalSigmas(result_.bundle);
    options.estimate_uncertainty = false;
    options.go_on = [&] { return !input_.progress || input_.progress("bundle adjustment"); };
    const Solution solution = Solve(options, &result_.bundle);
    result_.converged = solution.converged;
    result_.iterations += solution.iterations;
  }

  // Landmarks that a frame shows and those of them that are used.
  struct FrameCount {
    std::set<int> shown, used;
  };

  // False when no frame has a better pose; the bundle is as before then. `all`: the observations
  // before any was left out.
  bool ReviseFrames(const std::vector<BundleObservation>& all) {
    Bundle& bundle = result_.bundle;
    std::vector<BundleObservation> kept = bundle.observations;
    std::vector<FrameCount> counts(bundle.T_rig_target.size());
    state_.has_point.assign(bundle.markers.size(), false);
    for (const BundleObservation& observation : kept) {
      if (!observation.used) continue;
      state_.has_point[static_cast<size_t>(observation.marker)] = true;
      counts[static_cast<size_t>(observation.frame)].used.insert(observation.marker);
    }
    for (const BundleObservation& observation : all) {
      if (!state_.has_point[static_cast<size_t>(observation.marker)]) continue;
      counts[static_cast<size_t>(observation.frame)].shown.insert(observation.marker);
    }
    bundle.observations = all;
    bool changed = false;
    for (const std::vector<size_t>* segment : {&input_.segments.start, &input_.segments.end}) {
      for (const size_t frame : *segment) changed = ReviseFrame(frame, counts[frame]) || changed;
    }
    if (!changed) {
      bundle.observations = std::move(kept);
      return false;
    }
    for (size_t frame = 0; frame < counts.size(); ++frame) {
      if (state_.has_pose[frame]) Triangulate(frame, limit_, &state_);
    }
    return true;
  }

  bool ReviseFrame(size_t frame, const FrameCount& count) {
    if (2 * count.used.size() >= count.shown.size()) return false;
    const std::optional<PoseSearch> found = FindPose(state_, frame, limit_);
    if (!found || found->inliers <= count.used.size()) return false;
    result_.bundle.T_rig_target[frame] = found->T_rig_target;
    state_.has_pose[frame] = true;
    return true;
  }

  const LoopTruthInput& input_;
  LoopTruthResult result_;
  SceneState state_;
  double limit_ = 0;  // of the residuals of good points, px
};

}  // namespace

LoopTruthResult EstimateLoopTruth(const LoopTruthInput& input) {
  return LoopEstimation(input).Run();
}

}  // namespace plenocal
