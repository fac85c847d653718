// SPDX-License-Identifier: Apache-2.0
#include "engine/scene/scene_tracks.h"

#include <algorithm>
#include <limits>
#include <map>
#include <tuple>

#include "calib/base/statistics.h"

namespace plenocal {
namespace {

// Views of each point, by its number.
std::map<int, int> CountViews(const SceneTracks& tracks) {
  std::map<int, int> count;
  for (const std::vector<View>& views : tracks.views) {
    for (const View& view : views) {
      int last = std::numeric_limits<int>::min();  // observations of one marker may follow
      for (const Observation& observation : view.observations) {
        if (observation.marker != last) ++count[observation.marker];
        last = observation.marker;
      }
    }
  }
  return count;
}

}  // namespace

Bundle MakeSceneBundle(const SceneTracks& tracks, const std::vector<BundleCamera>& cameras) {
  Bundle bundle;
  bundle.cameras = cameras;
  bundle.T_rig_target.resize(tracks.frames.size());
  bundle.marker_freedom = MarkerFreedom::Landmarks();
  std::map<int, int> index;  // of a point's number in `markers`
  for (const auto& [number, views] : CountViews(tracks)) {
    if (views < 2) continue;
    index.emplace(number, static_cast<int>(bundle.markers.size()));
    bundle.markers.push_back({.number = number,
                              .position = Eigen::Vector3d::Zero(),
                              .nominal = Eigen::Vector3d::Zero()});
  }
  std::map<std::string, int> frame_index;
  for (size_t i = 0; i < tracks.frames.size(); ++i) {
    frame_index.emplace(tracks.frames[i], static_cast<int>(i));
  }
  for (size_t c = 0; c < tracks.views.size(); ++c) {
    AddSharedErrors(tracks.views[c], &bundle.cameras[c]);
    for (const View& view : tracks.views[c]) {
      const int frame = frame_index.at(view.frame);
      for (size_t i = 0; i < view.observations.size(); ++i) {
        const Observation& seen = view.observations[i];
        const auto found = index.find(seen.marker);
        if (found == index.end()) continue;
        bundle.observations.push_back(
            {.camera = static_cast<int>(c),
             .frame = frame,
             .marker = found->second,
             .seen = seen,
             .by_nuisance = view.by_nuisance.empty() ? std::vector<double>() : view.by_nuisance[i],
             .assumed_sigma = seen.detector_sigma > 0 ? seen.detector_sigma : 1});
      }
    }
  }
  SortObservations(&bundle);
  return bundle;
}

void SortObservations(Bundle* bundle) {
  std::ranges::stable_sort(bundle->observations, {}, [](const BundleObservation& o) {
    return std::tuple(o.frame, o.camera, o.marker);
  });
}

std::vector<double> TypicalSigmas(const Bundle& bundle) {
  std::vector<std::vector<double>> sigmas(bundle.cameras.size());
  for (const BundleObservation& observation : bundle.observations) {
    sigmas[static_cast<size_t>(observation.camera)].push_back(observation.assumed_sigma);
  }
  std::vector<double> typical;
  for (std::vector<double>& of_camera : sigmas) {
    typical.push_back(of_camera.empty() ? 1 : Median(std::move(of_camera)));
  }
  return typical;
}

}  // namespace plenocal
