// SPDX-License-Identifier: Apache-2.0
#include "assess/target/frame_choice.h"

#include <map>
#include <set>
#include <string>
#include <utility>

namespace plenocal {
namespace {

// What is wrong with a target is the same in all frames; so many show it.
constexpr size_t kMostFrames = 60;

// The time of an adjustment with free markers grows with their third power: 0.3 s for so many.
constexpr size_t kMostMarkers = 500;

size_t StepFor(size_t count, size_t most) { return 1 + (count - 1) / most; }

}  // namespace

std::vector<CameraInput> ChooseFrames(const std::vector<CameraInput>& cameras) {
  std::set<std::string> names, chosen;
  for (const CameraInput& camera : cameras) {
    for (const View& view : camera.views) names.insert(view.frame);
  }
  if (names.size() <= kMostFrames) return cameras;
  size_t index = 0;
  for (const std::string& name : names) {
    if (index++ % StepFor(names.size(), kMostFrames) == 0) chosen.insert(name);
  }
  std::vector<CameraInput> few = cameras;
  for (CameraInput& camera : few) {
    std::erase_if(camera.views, [&](const View& view) { return !chosen.contains(view.frame); });
  }
  return few;
}

Calibration ChooseFrames(const Calibration& calibration) {
  if (calibration.frames.size() <= kMostFrames) return calibration;
  const size_t step = StepFor(calibration.frames.size(), kMostFrames);
  const size_t cameras = calibration.bundle.cameras.size();
  Calibration few;
  few.fits = calibration.fits;
  few.uncertainty = calibration.uncertainty;
  few.converged = calibration.converged;
  few.rejection_threshold = calibration.rejection_threshold;
  Bundle& bundle = few.bundle;
  static_cast<BundleState&>(bundle) = calibration.bundle;
  const Jitter& jitter = calibration.bundle.jitter;
  bundle.T_rig_target.clear();
  bundle.jitter.delta.clear();
  bundle.jitter.misplaced.clear();
  bundle.motion.clear();
  for (size_t f = 0; f < calibration.frames.size(); f += step) {
    few.frames.push_back(calibration.frames[f]);
    bundle.T_rig_target.push_back(calibration.bundle.T_rig_target[f]);
    for (size_t c = 0; c < cameras && !calibration.bundle.motion.empty(); ++c) {
      bundle.motion.push_back(calibration.bundle.motion[calibration.bundle.View(f, c)]);
    }
    for (size_t c = 0; c < cameras && !jitter.delta.empty(); ++c) {
      bundle.jitter.delta.push_back(jitter.delta[calibration.bundle.View(f, c)]);
      bundle.jitter.misplaced.push_back(jitter.misplaced[calibration.bundle.View(f, c)]);
    }
  }
  for (const BundleObservation& observation : calibration.bundle.observations) {
    if (static_cast<size_t>(observation.frame) % step != 0) continue;
    bundle.observations.push_back(observation);
    bundle.observations.back().frame /= static_cast<int>(step);
  }
  return few;
}

Calibration ChooseMarkers(Calibration calibration) {
  Bundle& bundle = calibration.bundle;
  if (bundle.markers.size() <= kMostMarkers) return calibration;
  std::map<int, int> observed;  // by index: index among the chosen ones, -1 for others
  for (const BundleObservation& o : bundle.observations) observed.emplace(o.marker, -1);
  const size_t step = StepFor(observed.size(), kMostMarkers);
  std::vector<BundleMarker> chosen;
  size_t count = 0;
  for (auto& [marker, index] : observed) {
    if (count++ % step != 0) continue;
    index = static_cast<int>(chosen.size());
    chosen.push_back(bundle.markers[static_cast<size_t>(marker)]);
  }
  bundle.markers = std::move(chosen);
  for (BundleObservation& o : bundle.observations) o.marker = observed.at(o.marker);
  std::erase_if(bundle.observations, [](const BundleObservation& o) { return o.marker < 0; });
  return calibration;
}

}  // namespace plenocal
