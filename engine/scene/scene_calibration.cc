// SPDX-License-Identifier: Apache-2.0
#include "engine/scene/scene_calibration.h"

#include <fmt/format.h>

#include <algorithm>
#include <iterator>
#include <map>
#include <set>
#include <utility>

#include "calib/base/format_error.h"
#include "calib/base/statistics.h"
#include "calib/estimate/common_errors.h"
#include "calib/estimate/solve.h"
#include "calib/estimate/start_rig.h"
#include "engine/scene/scene_findings.h"
#include "engine/scene/scene_start.h"
#include "engine/scene/scene_views.h"
#include "engine/scene/virtual_camera.h"

namespace plenocal {
namespace {

SceneTracks TracksOf(const std::vector<CameraInput>& cameras) {
  SceneTracks tracks;
  std::set<std::string> frames;
  for (const CameraInput& camera : cameras) {
    tracks.views.push_back(camera.views);
    for (const View& view : camera.views) frames.insert(view.frame);
  }
  tracks.frames.assign(frames.begin(), frames.end());
  return tracks;
}

// Known distances between positions of a scene, in its bundle.
class SceneDistances {
 public:
  SceneDistances(const SceneCalibrationInput& input,
                 const SceneTracks& tracks,
                 Calibration* calibration)
      : input_(input), tracks_(tracks), calibration_(*calibration) {}

  // A point that has no position takes its distance with it, if others are left.
  void Add() {
    for (const SceneDistance& distance : input_.distances) {
      if (!IsTracked(distance.a)) FailWithoutPosition(distance.a, distance);
      if (!IsTracked(distance.b)) FailWithoutPosition(distance.b, distance);
      if (AddDistance(distance)) continue;
      calibration_.left_out.push_back(
          {.where = fmt::format("distance of {} and {}", distance.a.name, distance.b.name),
           .reason =
               fmt::format("no two views that agree show {}",
                           MarkersAt(distance.a).empty() ? distance.a.name : distance.b.name)});
    }
    if (input_.tags) AddTags(*input_.tags);
    if (!calibration_.bundle.distances.empty() || input_.distances.empty()) return;
    const SceneDistance& first = input_.distances.front();
    FailWithoutPosition(MarkersAt(first.a).empty() ? first.a : first.b, first);
  }

 private:
  // The other tags give the scale for a tag that was not seen.
  void AddTags(const SceneTags& tags) {
    for (const int id : tags.ids) {
      const ScenePosition tag{fmt::format("tag {}", id), CornersOfTag(id)};
      if (!MarkersAt(tag).empty()) {
        for (const SceneDistance& size : SizesOfTag(tags, id)) AddDistance(size);
        continue;
      }
      const char* const not_tracked = input_.from_images ? "no image of an ordinary camera shows it"
                                                         : "not all of its corners have tracks";
      calibration_.left_out.push_back(
          {.where = tag.name,
           .reason =
               IsTracked(tag) ? "no two views that agree show each of its corners" : not_tracked,
           .marker = std::to_string(id)});
    }
  }

  // False where an end has no position.
  bool AddDistance(const SceneDistance& distance) {
    std::vector<int> a = MarkersAt(distance.a), b = MarkersAt(distance.b);
    if (a.empty() || b.empty()) return false;
    calibration_.bundle.distances.push_back({.markers_a = std::move(a),
                                             .markers_b = std::move(b),
                                             .length = distance.length,
                                             .sigma = distance.sigma,
                                             .common_sigma = distance.common_sigma});
    return true;
  }

  // True if some view shows each of its points; a number that no view has is a slip of the user.
  [[nodiscard]] bool IsTracked(const ScenePosition& position) const {
    const auto tracked = [&](int number) {
      const auto same = [&](const Observation& seen) { return seen.marker == number; };
      const auto shows = [&](const View& view) {
        return std::ranges::any_of(view.observations, same);
      };
      return std::ranges::any_of(tracks_.views, [&](const std::vector<View>& views) {
        return std::ranges::any_of(views, shows);
      });
    };
    return std::ranges::all_of(position.points, tracked);
  }

  [[noreturn]] static void FailWithoutPosition(const ScenePosition& position,
                                               const SceneDistance& distance) {
    distance.place.Fail(
        fmt::format("{} has no position: no two views that agree show it; "
                    "name another point, or remove this distance",
                    position.name));
  }

  // The landmarks of a position; empty where one of them has no position.
  std::vector<int> MarkersAt(const ScenePosition& position) const {
    std::vector<int> markers;
    for (const int number : position.points) {
      const std::optional<int> marker = MarkerIndex(number);
      if (!marker) return {};
      markers.push_back(*marker);
    }
    return markers;
  }

  std::optional<int> MarkerIndex(int number) const {
    const std::vector<BundleMarker>& markers = calibration_.bundle.markers;
    const auto found = std::ranges::find(markers, number, &BundleMarker::number);
    if (found == markers.end()) return std::nullopt;
    return static_cast<int>(found - markers.begin());
  }

  const SceneCalibrationInput& input_;
  const SceneTracks& tracks_;
  Calibration& calibration_;
};

class SceneCalibration {
 public:
  SceneCalibration(const SceneCalibrationInput& input, const CalibrationOptions& options)
      : input_(input),
        options_(options),
        start_number_(input.alike.begin(), input.alike.end()),
        cameras_(WithStartNumbers(input.cameras.inputs)),
        tracks_(TracksOf(input.cameras.inputs)) {}

  Calibration Run() {
    ChooseFirstCameras();
    Reconstruct();
    ScaleByDistances();
    GuessCameras();
    Assemble();
    Enter("bundle adjustment");
    const Solution solution = SolveBundle();
    SetByOthers(&calibration_.bundle);
    calibration_.uncertainty = solution.uncertainty;
    AddLatticeErrors(input_.cameras.inputs, calibration_.bundle, &calibration_.uncertainty);
    calibration_.converged = solution.converged;
    calibration_.iterations = solution.iterations;
    calibration_.rejection_threshold = solution.rejection_threshold;
    for (size_t c = 0; c < cameras_.size(); ++c) {
      calibration_.fits.push_back(
          MeasureFit(calibration_.bundle, c, {.typical = typical_[c], .stated = StatesSigma(c)}));
    }
    Append(FindingsOfScene(calibration_), &calibration_.findings);
    if (input_.from_images) calibration_.findings.push_back(FindingOfPatches());
    return std::move(calibration_);
  }

 private:
  bool GoOn(const char* stage) const { return !options_.progress || options_.progress(stage); }
  void Enter(const char* stage) const {
    if (!GoOn(stage)) throw Stopped();
  }

  [[nodiscard]] int StartNumber(int number) const {
    const auto found = start_number_.find(number);
    return found == start_number_.end() ? number : found->second;
  }

  [[nodiscard]] std::vector<CameraInput> WithStartNumbers(std::vector<CameraInput> cameras) const {
    for (CameraInput& camera : cameras) {
      for (View& view : camera.views) {
        for (Observation& seen : view.observations) seen.marker = StartNumber(seen.marker);
      }
    }
    return cameras;
  }

  [[nodiscard]] bool StatesSigma(size_t c) const {
    for (const View& view : cameras_[c].views) {
      for (const Observation& seen : view.observations) {
        if (seen.detector_sigma > 0) return true;
      }
    }
    return false;
  }

  // Ordinary cameras with known parameters and extrinsics; else the first ordinary camera, or the
  // virtual image of the first plenoptic one.
  void ChooseFirstCameras() {
    std::vector<size_t> ordinary;
    for (size_t c = 0; c < cameras_.size(); ++c) {
      if (cameras_[c].model->plenoptic) continue;
      ordinary.push_back(c);
      const bool known = std::ranges::none_of(cameras_[c].initial,
                                              [](const auto& value) { return !value.has_value(); });
      if (known && input_.cameras.T_camera_rig[c]) first_.push_back(c);
    }
    if (first_.size() < 2) first_.assign(1, ordinary.empty() ? 0 : ordinary[0]);
    metric_ = first_.size() > 1;
    for (const size_t c : first_) {
      first_inputs_.push_back(cameras_[c].model->plenoptic ? VirtualCamera(cameras_[c])
                                                           : cameras_[c]);
    }
  }

  // Bundle cameras of the first cameras with focal length `factor` image widths where none is
  // given.
  std::vector<BundleCamera> FirstCameras(double factor) const {
    std::vector<BundleCamera> cameras;
    for (size_t i = 0; i < first_.size(); ++i) {
      const CameraInput& input = first_inputs_[i];
      CameraInput alone = input;
      alone.rules.clear();
      cameras.push_back(
          MakeBundleCamera(alone, OrdinaryStart(input, factor * input.image_size[0])));
      // The first one's frame is the rig's here.
      cameras.back().is_master = i == 0 || input_.cameras.fixed_extrinsics[first_[i]];
      if (metric_) {
        cameras.back().T_camera_rig = *input_.cameras.T_camera_rig[first_[i]] *
                                      input_.cameras.T_camera_rig[first_[0]]->Inverse();
      }
      // Known well enough to place the points.
      if (metric_) cameras.back().fixed.assign(cameras.back().params.size(), true);
      if (metric_) cameras.back().is_master = true;
    }
    return cameras;
  }

  // Takes the focal length that places most frames with the smallest residuals, if none is given.
  void Reconstruct() {
    const CameraInput& first = first_inputs_[0];
    bool given = true;
    for (size_t k = 0; k < first.initial.size(); ++k) {
      given = given && (!IsFocal(first.model->params[k]) || first.initial[k].has_value());
    }
    const std::vector<double> factors = given ? std::vector{1.0} : std::vector{0.6, 0.9, 1.4, 2.2};
    SceneTracks tracks = TracksOf(first_inputs_);
    tracks.frames = tracks_.frames;
    for (const double factor : factors) {
      Enter("initial guess");
      ReconstructedScene scene = ReconstructScene(tracks, FirstCameras(factor), {});
      const bool better =
          scene.frames > scene_.frames ||
          (scene.frames == scene_.frames && scene.median_residual < scene_.median_residual);
      if (better) scene_ = std::move(scene);
    }
    if (scene_.frames >= kFewestFrames) return;
    throw JobError(
        "{}: poses for {} of {} frames only; record frames that overlap more, "
        "or give better start values ('initial', 'from')",
        first.name,
        scene_.frames,
        tracks.frames.size());
  }

  void Rescale(double factor) {
    for (auto& T : scene_.T_rig_target) {
      if (T) T->t *= factor;
    }
    for (auto& [number, position] : scene_.points) position *= factor;
    metric_ = true;
  }

  std::optional<Eigen::Vector3d> StartOf(const ScenePosition& of) const {
    Eigen::Vector3d sum = Eigen::Vector3d::Zero();
    for (const int number : of.points) {
      const auto found = scene_.points.find(StartNumber(number));
      if (found == scene_.points.end()) return std::nullopt;
      sum += found->second;
    }
    return sum / static_cast<double>(of.points.size());
  }

  void ScaleByDistances() {
    std::vector<double> factors;
    std::vector<SceneDistance> distances = input_.distances;
    if (input_.tags) {
      for (const int id : input_.tags->ids) {
        std::ranges::move(SizesOfTag(*input_.tags, id), std::back_inserter(distances));
      }
    }
    for (const SceneDistance& distance : distances) {
      const std::optional<Eigen::Vector3d> a = StartOf(distance.a), b = StartOf(distance.b);
      if (a && b) factors.push_back(distance.length / (*a - *b).norm());
    }
    if (!metric_ && !factors.empty()) Rescale(Median(factors));
  }

  // Lengths inside of a plenoptic camera, which the present scale of the points may contradict.
  static CameraInput WithoutLengths(const CameraInput& camera) {
    CameraInput free = camera;
    for (size_t k = 0; k < free.initial.size(); ++k) {
      if (free.model->params[k].unit != "m") continue;
      free.initial[k].reset();
      free.fixed[k] = false;
    }
    return free;
  }

  // A camera from the points as its target.
  CameraGuess GuessFromPoints(const CameraInput& camera) const {
    CameraInput alone = camera;
    alone.rules.clear();
    for (View& view : alone.views) {
      std::erase_if(view.observations,
                    [&](const Observation& seen) { return !scene_.points.contains(seen.marker); });
    }
    std::optional<CameraGuess> best;
    for (const bool with_lengths : {false, true}) {
      if (with_lengths && !camera.model->plenoptic) continue;
      try {
        CameraGuess guess =
            GuessCamera(with_lengths ? alone : WithoutLengths(alone), scene_.points);
        if (!best || guess.median_error < best->median_error) best = std::move(guess);
      } catch (const Error& error) {
        if (error.kind() != ErrorKind::kJob) throw;
      }
    }
    if (!best) {
      throw JobError(
          "{}: no start values from the scene points; give 'initial' values, an "
          "earlier calibration ('from'), or frames with more depth",
          camera.name);
    }
    return *best;
  }

  // T_camera_target of each view from the reconstructed poses of the rig.
  std::vector<std::optional<RigidTransform>> Poses(const std::vector<View>& views,
                                                   const RigidTransform& T_camera_rig) const {
    std::vector<std::optional<RigidTransform>> poses;
    for (const View& view : views) {
      const auto frame = std::ranges::lower_bound(tracks_.frames, view.frame);
      const auto& T = scene_.T_rig_target[static_cast<size_t>(frame - tracks_.frames.begin())];
      poses.push_back(T ? std::optional(T_camera_rig * *T) : std::nullopt);
    }
    return poses;
  }

  // One of the first cameras, as it was adjusted.
  CameraGuess GuessOfFirst(size_t i) const {
    CameraGuess guess;
    guess.params = scene_.cameras[i].params;
    guess.T_camera_target = Poses(first_inputs_[i].views, scene_.cameras[i].T_camera_rig);
    return guess;
  }

  // Poses by cameras of known extrinsics place a camera that is known too.
  bool IsKnown(size_t c) const {
    return first_.size() > 1 && input_.cameras.T_camera_rig[c] &&
           std::ranges::all_of(cameras_[c].initial,
                               [](const auto& value) { return value.has_value(); });
  }

  CameraGuess GuessOfKnown(size_t c) const {
    CameraGuess guess;
    for (const auto& value : cameras_[c].initial) guess.params.push_back(*value);
    const RigidTransform T_camera_first = *input_.cameras.T_camera_rig[c] *
                                          input_.cameras.T_camera_rig[first_[0]]->Inverse() *
                                          scene_.cameras[0].T_camera_rig;
    guess.T_camera_target = Poses(cameras_[c].views, T_camera_first);
    return guess;
  }

  void GuessCameras() {
    const auto guess_all = [&] {
      guesses_.clear();
      for (size_t c = 0; c < cameras_.size(); ++c) {
        const auto i = static_cast<size_t>(std::ranges::find(first_, c) - first_.begin());
        const bool as_it_is = i < first_.size() && !cameras_[c].model->plenoptic;
        guesses_.push_back(as_it_is     ? GuessOfFirst(i)
                           : IsKnown(c) ? GuessOfKnown(c)
                                        : GuessFromPoints(cameras_[c]));
      }
      T_camera_rig_ = GuessRig(cameras_, guesses_);
    };
    guess_all();
    if (metric_) return;
    // The lengths inside of a plenoptic camera do not quite follow the scale.
    constexpr int kScaleSteps = 3;
    for (int step = 0; step < kScaleSteps; ++step) {
      const std::optional<double> factor = ScaleByCameras();
      if (!factor) return;
      Rescale(*factor);
      guess_all();
    }
  }

  // From known extrinsics, or from a known distance between micro lenses and sensor.
  std::optional<double> ScaleByCameras() const {
    for (size_t c = 1; c < cameras_.size(); ++c) {
      const auto& known = input_.cameras.T_camera_rig[c];
      if (known && known->t.norm() > 0 && T_camera_rig_[c].t.norm() > 0) {
        return known->t.norm() / T_camera_rig_[c].t.norm();
      }
    }
    for (size_t c = 0; c < cameras_.size(); ++c) {
      if (!cameras_[c].model->plenoptic) continue;
      const size_t sensor = ParamOf(*cameras_[c].model, "B");
      const auto& known = cameras_[c].initial[sensor];
      // B falls by the part by which lengths grow.
      if (known && guesses_[c].params[sensor] > 0) return guesses_[c].params[sensor] / *known;
    }
    return std::nullopt;
  }

  void Assemble() {
    std::vector<BundleCamera> cameras;
    for (size_t c = 0; c < cameras_.size(); ++c) {
      std::vector<double> params = guesses_[c].params;
      for (size_t k = 0; k < params.size(); ++k) {
        if (cameras_[c].fixed[k]) params[k] = cameras_[c].initial[k].value_or(params[k]);
      }
      cameras.push_back(MakeBundleCamera(cameras_[c], std::move(params)));
      cameras.back().T_camera_rig = input_.cameras.T_camera_rig[c].value_or(T_camera_rig_[c]);
      cameras.back().is_master = c == 0 || input_.cameras.fixed_extrinsics[c];
    }
    Bundle& bundle = calibration_.bundle;
    bundle = MakeSceneBundle(tracks_, cameras);
    TakeRootValues(&bundle);
    bundle.prior = input_.cameras.prior;
    typical_ = TypicalSigmas(bundle);
    SceneState state = MakeSceneState(&bundle);
    const RigidTransform T_rig_first = cameras[first_[0]].T_camera_rig.Inverse();
    std::vector<size_t> posed;
    for (size_t frame = 0; frame < scene_.T_rig_target.size(); ++frame) {
      if (!scene_.T_rig_target[frame]) continue;
      bundle.T_rig_target[frame] =
          T_rig_first * scene_.cameras[0].T_camera_rig * *scene_.T_rig_target[frame];
      state.has_pose[frame] = true;
      posed.push_back(frame);
    }
    for (size_t m = 0; m < bundle.markers.size(); ++m) {
      const auto found = scene_.points.find(StartNumber(bundle.markers[m].number));
      if (found == scene_.points.end()) continue;
      bundle.markers[m].position = found->second;
      state.has_point[m] = true;
    }
    FollowFrames(posed, &state);
    FollowByOverlap([](size_t) {}, &state);
    KeepStarted(state, &bundle);
    DropUnseen(state);
    SceneDistances(input_, tracks_, &calibration_).Add();
    bundle.fixed_frame = 0;
    if (!HasScale(bundle)) HoldScale(&bundle);
  }

  static void TakeRootValues(Bundle* bundle) {
    for (size_t c = 0; c < bundle->cameras.size(); ++c) {
      for (size_t k = 0; k < bundle->cameras[c].params.size(); ++k) {
        const ParamIndex root = bundle->Root(c, k);
        bundle->cameras[c].params[k] = bundle->cameras[root.camera].params[root.param];
      }
    }
  }

  // Takes frames without a pose and points without a position out of the bundle.
  void DropUnseen(const SceneState& state) {
    Bundle& bundle = calibration_.bundle;
    std::vector<int> frame_index, marker_index;
    std::vector<RigidTransform> poses;
    for (size_t frame = 0; frame < tracks_.frames.size(); ++frame) {
      frame_index.push_back(static_cast<int>(poses.size()));
      if (!state.has_pose[frame]) {
        calibration_.left_out.push_back({.where = "frame " + tracks_.frames[frame],
                                         .reason = "too few of its points agree with other frames",
                                         .whole = true,
                                         .frame = tracks_.frames[frame]});
        continue;
      }
      calibration_.frames.push_back(tracks_.frames[frame]);
      poses.push_back(bundle.T_rig_target[frame]);
    }
    std::vector<BundleMarker> markers;
    for (size_t m = 0; m < bundle.markers.size(); ++m) {
      marker_index.push_back(static_cast<int>(markers.size()));
      if (state.has_point[m]) markers.push_back(bundle.markers[m]);
    }
    for (BundleObservation& seen : bundle.observations) {
      seen.frame = frame_index[static_cast<size_t>(seen.frame)];
      seen.marker = marker_index[static_cast<size_t>(seen.marker)];
    }
    bundle.T_rig_target = std::move(poses);
    bundle.markers = std::move(markers);
  }

  Solution SolveBundle() {
    SolveOptions solve;
    solve.loss = input_.loss;
    solve.typical_sigmas = typical_;
    solve.go_on = [&] { return GoOn("bundle adjustment"); };
    return Solve(solve, &calibration_.bundle);
  }

  static constexpr size_t kFewestFrames = 3;

  const SceneCalibrationInput& input_;
  const CalibrationOptions& options_;
  std::map<int, int> start_number_;   // of points that look alike: that of the first camera's
  std::vector<CameraInput> cameras_;  // with these numbers
  SceneTracks tracks_;
  std::vector<size_t> first_;              // cameras from which poses and points start
  std::vector<CameraInput> first_inputs_;  // of these
  bool metric_ = false;
  ReconstructedScene scene_;
  std::vector<CameraGuess> guesses_;
  std::vector<RigidTransform> T_camera_rig_;
  std::vector<double> typical_;
  Calibration calibration_;
};

}  // namespace

Calibration CalibrateScene(const SceneCalibrationInput& input, const CalibrationOptions& options) {
  for (const CameraInput& camera : input.cameras.inputs) {
    if (!camera.views.empty()) continue;
    throw InputError("{}: has no observations", camera.name);
  }
  return SceneCalibration(input, options).Run();
}

std::string ScenePointsPly(const Calibration& calibration) {
  const Bundle& bundle = calibration.bundle;
  std::vector<size_t> seen(bundle.markers.size(), 0);
  for (const BundleObservation& observation : bundle.observations) {
    if (observation.used) ++seen[static_cast<size_t>(observation.marker)];
  }
  std::string rows;
  size_t count = 0;
  for (size_t m = 0; m < seen.size(); ++m) {
    if (seen[m] == 0) continue;
    const Eigen::Vector3d& p = bundle.markers[m].position;
    rows += fmt::format(
        "{:.9g} {:.9g} {:.9g} {} {}\n", p.x(), p.y(), p.z(), bundle.markers[m].number, seen[m]);
    ++count;
  }
  return fmt::format(
             "ply\nformat ascii 1.0\ncomment scene points, m, in the frame of the first frame's rig\n"
             "element vertex {}\nproperty double x\nproperty double y\nproperty double z\n"
             "property int point\nproperty int observations\nend_header\n",
             count) +
         rows;
}

}  // namespace plenocal
