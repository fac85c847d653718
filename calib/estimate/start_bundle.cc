// SPDX-License-Identifier: Apache-2.0
#include "calib/estimate/start_bundle.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>
#include <map>

#include "calib/base/format_error.h"
#include "calib/base/parallel.h"
#include "calib/base/statistics.h"
#include "calib/camera/marker_id.h"
#include "calib/estimate/reject.h"
#include "calib/estimate/start_rig.h"
#include "calib/noise/camera_noise.h"
#include "calib/noise/replicate_noise.h"
#include "calib/rig/link_targets.h"

namespace plenocal {
namespace {

// A camera without the parameters that it shares with others.
CameraInput Alone(const CalibrationInput& input, size_t c) {
  CameraInput camera = input.cameras[c];
  for (ParamRule& rule : camera.rules) {
    if (!rule.tied_to) continue;
    if (rule.tied_to->camera == c) {
      rule.tied_to->camera = 0;
    } else {
      rule.tied_to.reset();
    }
  }
  return camera;
}

// The camera with the parameters of the earlier calibration: few images do not give all of them.
// Parameters that do not describe the images, as after refocusing, are estimated from the images.
CameraGuess GuessWithPrior(const CalibrationInput& input, size_t c) {
  const CameraInput alone = Alone(input, c);
  if (!input.prior) return GuessCamera(alone, input.markers, input.marker_freedom);
  CameraInput fixed = alone;
  for (const CalibrationPrior::Unknown& unknown : input.prior->unknowns) {
    if (unknown.camera == c && unknown.param) fixed.fixed[*unknown.param] = true;
  }
  CameraGuess guess = GuessCamera(fixed, input.markers, input.marker_freedom);
  return guess.misfit.empty() || fixed.fixed == alone.fixed
             ? guess
             : GuessCamera(alone, input.markers, input.marker_freedom);
}

CameraGuess GuessFrom(const CalibrationStart& start, const CalibrationInput& input, size_t c) {
  const CameraInput& camera = input.cameras[c];
  CameraGuess guess{.params = start.params[c], .T_camera_target = {}, .misfit = {}};
  const BundleCamera of_guess = MakeBundleCamera(camera, guess.params);
  for (const View& view : camera.views) {
    const auto known = start.T_rig_target.find(view.frame);
    guess.T_camera_target.push_back(known == start.T_rig_target.end()
                                        ? GuessPose(of_guess, view, input.markers)
                                        : start.T_camera_rig[c] * known->second);
  }
  return guess;
}

void AddCameras(const CalibrationInput& input,
                const std::vector<RigidTransform>& T_camera_rig,
                BundleGuess* guess) {
  Bundle& bundle = guess->bundle;
  for (size_t c = 0; c < input.cameras.size(); ++c) {
    bundle.cameras.push_back(MakeBundleCamera(input.cameras[c], guess->cameras[c].params));
    bundle.cameras.back().T_camera_rig = T_camera_rig[c];
    bundle.cameras.back().is_master = c == 0;
  }
  for (size_t c = 0; c < bundle.cameras.size(); ++c) {
    for (size_t k = 0; k < bundle.cameras[c].params.size(); ++k) {
      const ParamIndex root = bundle.Root(c, k);
      bundle.cameras[c].params[k] = guess->cameras[root.camera].params[root.param];
    }
    AddSharedErrors(input.cameras[c].views, &bundle.cameras[c]);
  }
}

// A view of one frame.
struct InFrame {
  size_t camera, view;
};

using Frames = std::map<std::string, std::vector<InFrame>>;

Frames FramesOf(const std::vector<CameraInput>& cameras) {
  Frames frames;
  for (size_t c = 0; c < cameras.size(); ++c) {
    for (size_t v = 0; v < cameras[c].views.size(); ++v) {
      frames[cameras[c].views[v].frame].push_back({c, v});
    }
  }
  return frames;
}

// Median length of a sample of a view's residuals, px.
double MedianError(const BundleCamera& camera,
                   const View& view,
                   const RigidTransform& T_camera_target,
                   const std::map<int, Eigen::Vector3d>& markers) {
  constexpr size_t kSample = 20;
  constexpr double kNotImaged = 1e12;  // squared; larger than any image, but still a finite number
  std::vector<double> errors;
  const size_t stride = view.observations.size() / kSample + 1;
  for (size_t i = 0; i < view.observations.size(); i += stride) {
    const Observation& observation = view.observations[i];
    const auto marker = markers.find(observation.marker);
    if (marker == markers.end()) continue;
    double predicted[kMaxObservationSize];
    double sum = 0;
    if (camera.model->Project(camera.params.data(),
                              camera.config.data(),
                              observation.values.data(),
                              T_camera_target * marker->second,
                              predicted)) {
      for (size_t r = 0; r < camera.model->measured.size(); ++r) {
        sum += std::pow(observation.values[r] - predicted[r], 2);
      }
    } else {
      sum = kNotImaged;
    }
    errors.push_back(std::sqrt(sum));
  }
  return Median(std::move(errors));
}

// T_rig_target by the one of the frame's cameras whose pose explains all of them best.
std::optional<RigidTransform> FramePose(const CalibrationInput& input,
                                        const BundleGuess& guess,
                                        const std::vector<InFrame>& views) {
  const std::vector<BundleCamera>& cameras = guess.bundle.cameras;
  std::optional<RigidTransform> best;
  double best_error = std::numeric_limits<double>::infinity();
  for (const InFrame& in_frame : views) {
    const auto& T_camera_target = guess.cameras[in_frame.camera].T_camera_target[in_frame.view];
    if (!T_camera_target) continue;
    const RigidTransform T_rig_target =
        cameras[in_frame.camera].T_camera_rig.Inverse() * *T_camera_target;
    if (views.size() == 1) return T_rig_target;
    double error = 0;
    for (const InFrame& other : views) {
      error += MedianError(cameras[other.camera],
                           input.cameras[other.camera].views[other.view],
                           cameras[other.camera].T_camera_rig * T_rig_target,
                           input.markers);
    }
    if (!best || error < best_error) {
      best = T_rig_target;
      best_error = error;
    }
  }
  return best;
}

// The observations of one view, by marker.
void AddView(const CameraInput& camera,
             const InFrame& in_frame,
             const std::map<int, int>& marker_index,
             BundleGuess* guess) {
  const View& view = camera.views[in_frame.view];
  std::vector<BundleObservation>& observations = guess->bundle.observations;
  const size_t first = observations.size();
  const int frame = static_cast<int>(guess->frames.size()) - 1;
  for (size_t i = 0; i < view.observations.size(); ++i) {
    const Observation& observation = view.observations[i];
    const auto marker = marker_index.find(observation.marker);
    if (marker == marker_index.end()) {
      guess->left_out.push_back(
          {fmt::format("{} frame {} marker {}", camera.name, view.frame, observation.marker),
           "the target has no such marker",
           false,
           camera.name,
           view.frame,
           fmt::format("{}", observation.marker)});
      continue;
    }
    observations.push_back(
        {static_cast<int>(in_frame.camera), frame, marker->second, observation, true});
    if (!view.by_nuisance.empty()) observations.back().by_nuisance = view.by_nuisance[i];
  }
  std::stable_sort(observations.begin() + static_cast<std::ptrdiff_t>(first),
                   observations.end(),
                   [](const auto& a, const auto& b) { return a.marker < b.marker; });
}

// Markers, frames and the observations that take part, in their order.
void AddFrames(const CalibrationInput& input, BundleGuess* guess) {
  size_t observations = 0;
  for (const CameraInput& camera : input.cameras) {
    for (const View& view : camera.views) observations += view.observations.size();
  }
  guess->bundle.observations.reserve(observations);
  std::map<int, int> marker_index;
  for (const auto& [number, position] : input.markers) {
    marker_index[number] = static_cast<int>(guess->bundle.markers.size());
    const int target =
        guess->bundle.targets.empty() ? 0 : static_cast<int>(MarkerId::FromNumber(number).target);
    guess->bundle.markers.push_back({number, position, position, target});
    if (!input.start) continue;
    const auto known = input.start->markers.find(number);
    if (known != input.start->markers.end()) guess->bundle.markers.back().position = known->second;
  }
  for (const auto& [name, views] : FramesOf(input.cameras)) {
    const std::optional<RigidTransform> T_rig_target = FramePose(input, *guess, views);
    if (!T_rig_target) {
      guess->left_out.push_back(
          {fmt::format("frame {}", name),
           fmt::format("no camera sees {} or more markers from which its pose follows",
                       kMinMarkersInFrame),
           true,
           {},
           name});
      continue;
    }
    guess->frames.push_back(name);
    guess->bundle.T_rig_target.push_back(*T_rig_target);
    for (const InFrame& in_frame : views) {
      AddView(input.cameras[in_frame.camera], in_frame, marker_index, guess);
    }
  }
}

// Distances between markers that images show.
void AddDistances(const CalibrationInput& input, BundleGuess* guess) {
  Bundle& bundle = guess->bundle;
  std::map<int, int> seen;  // by number: index
  for (const BundleObservation& observation : bundle.observations) {
    seen[bundle.markers[static_cast<size_t>(observation.marker)].number] = observation.marker;
  }
  for (MarkerDistance distance : input.distances) {
    std::vector<int> unseen;
    for (std::vector<int>* markers : {&distance.markers_a, &distance.markers_b}) {
      for (int& marker : *markers) {
        const auto found = seen.find(marker);
        if (found == seen.end()) {
          unseen.push_back(marker);
        } else {
          marker = found->second;
        }
      }
    }
    if (unseen.empty()) {
      bundle.distances.push_back(distance);
    } else {
      guess->left_out.push_back({fmt::format("distance {}", distance.name),
                                 fmt::format("no image shows marker {}", unseen[0])});
    }
  }
}

bool StatesSigmas(const CameraInput& camera) {
  for (const View& view : camera.views) {
    for (const Observation& seen : view.observations) {
      if (seen.detector_sigma > 0) return true;
    }
  }
  return false;
}

// Noise of each lens type by replicate fits; empty for models without these.
std::map<int, LensTypeNoise> ReplicateNoise(const CameraInput& camera) {
  const ReplicateFit fit = camera.model->replicate_fit;
  if (fit == nullptr) return {};
  std::vector<Replicates> replicates;
  for (const View& view : camera.views) AddReplicates(view.observations, &replicates);
  return NoiseByLensType(replicates, fit);
}

// Assumed sigmas: the detector's; for cameras whose detector states none, those of replicate fits;
// elsewhere the median of the camera's others, or 1: then the noise that is estimated from the
// residuals is the sigma.
AssumedSigmas AssumeSigmas(const CameraInput& camera,
                           size_t index,
                           std::vector<BundleObservation>* observations) {
  AssumedSigmas assumed{.stated = StatesSigmas(camera)};
  std::map<int, LensTypeNoise> noise;
  if (!assumed.stated) noise = ReplicateNoise(camera);
  std::vector<double> known;
  std::vector<BundleObservation*> unknown;
  for (BundleObservation& observation : *observations) {
    if (observation.camera != static_cast<int>(index)) continue;
    double sigma = observation.seen.detector_sigma;
    const auto own = noise.find(observation.seen.lens_type);
    if (own != noise.end()) sigma = std::max(own->second.sigma, kSmallestNoise);
    if (sigma > 0) {
      observation.assumed_sigma = sigma;
      known.push_back(sigma);
    } else {
      unknown.push_back(&observation);
    }
  }
  assumed.typical = Median(known, 1.0);
  for (BundleObservation* observation : unknown) observation->assumed_sigma = assumed.typical;
  return assumed;
}

// The cameras by views of one target each, then all targets as parts of one; T_camera_rig.
std::vector<RigidTransform> GuessWithTargets(
    const CalibrationInput& input,
    const std::function<void(const CalibrationInput&)>& guess_cameras,
    BundleGuess* guess) {
  CalibrationInput split = input;
  split.cameras = SplitViews(input);
  guess_cameras(split);
  LinkedInput linked = LinkTargets(input, split.cameras, guess->cameras);
  guess->cameras = std::move(linked.guesses);
  guess->linked = std::move(linked.input);
  guess->bundle.targets = std::move(linked.targets);
  guess->findings = std::move(linked.findings);
  return std::move(linked.T_camera_rig);
}

}  // namespace

BundleGuess GuessBundle(const CalibrationInput& given, int threads) {
  BundleGuess guess;
  guess.cameras.resize(given.cameras.size());
  const auto guess_cameras = [&](const CalibrationInput& of) {
    ParallelFor(of.cameras.size(), threads, [&](size_t c) {
      guess.cameras[c] = of.start ? GuessFrom(*of.start, of, c) : GuessWithPrior(of, c);
    });
  };
  std::vector<RigidTransform> T_camera_rig;
  if (given.targets.empty()) {
    guess_cameras(given);
    T_camera_rig = GuessRig(given.cameras, guess.cameras, given.earlier_T_camera_rig);
  } else {
    T_camera_rig = GuessWithTargets(given, guess_cameras, &guess);
  }
  const CalibrationInput& input = guess.linked ? *guess.linked : given;
  AddCameras(input, T_camera_rig, &guess);
  guess.bundle.marker_freedom = input.marker_freedom;
  guess.bundle.prior = input.prior;
  guess.bundle.scales = input.scales;
  AddFrames(input, &guess);
  AddDistances(input, &guess);
  for (size_t c = 0; c < input.cameras.size(); ++c) {
    guess.sigmas.push_back(AssumeSigmas(input.cameras[c], c, &guess.bundle.observations));
  }
  if (guess.frames.empty()) {
    throw JobError("no frame from which the camera's pose follows; nothing to calibrate");
  }
  return guess;
}

}  // namespace plenocal
