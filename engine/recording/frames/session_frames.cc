// SPDX-License-Identifier: Apache-2.0
#include "engine/recording/frames/session_frames.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <set>

#include "calib/base/format_error.h"
#include "calib/base/statistics.h"
#include "engine/recording/frames/session_times.h"
#include "engine/recording/frames/time_pairs.h"
#include "engine/recording/stores/image_lister.h"

namespace plenocal {
namespace {

using CameraList = std::vector<std::vector<FrameImage>>;

/// Cameras that have images.
std::vector<size_t> CamerasWithImages(const CameraList& images) {
  std::vector<size_t> cameras;
  for (size_t c = 0; c < images.size(); ++c) {
    if (!images[c].empty()) cameras.push_back(c);
  }
  return cameras;
}

bool IsByTime(const Session& session,
              const std::vector<size_t>& cameras,
              const CameraList& images) {
  const auto untimed =
      std::ranges::find_if(cameras, [&](size_t c) { return !HaveTimes(images[c]); });
  if (session.pairing.by != Pairing::By::kTime)
    return !session.pairing.by && untimed == cameras.end();
  if (untimed == cameras.end()) return true;
  throw InputError(
      "{}: 'pairing' is by time, but the images of camera {} have no times; "
      "give 'times', a recording or a video, or pair by name",
      session.path.string(),
      session.cameras[*untimed].name);
}

/// "right: 40 of 42 images are paired ..."; how far apart they are.
std::string PairingNote(const std::string& first,
                        const std::string& camera,
                        const std::vector<double>& differences,
                        size_t count,
                        double tolerance) {
  constexpr double kMilliseconds = 1e3;
  double largest = 0;
  for (const double difference : differences) largest = std::max(largest, std::abs(difference));
  return fmt::format(
      "{}: {} of {} images are paired by time with those of {}; differences {:.3g} ms in the "
      "median, {:.3g} ms at most, tolerance {:.3g} ms",
      camera,
      differences.size(),
      count,
      first,
      kMilliseconds * std::abs(Median(differences)),
      kMilliseconds * largest,
      kMilliseconds * tolerance);
}

/// Gives the images of one frame one name.
void NameFrames(const Session& session,
                const std::vector<size_t>& cameras,
                const TimePairs& pairs,
                CameraList* images) {
  std::set<std::string> names;
  for (const auto& frame : pairs.frames) {
    const size_t k_first = FirstCamera(frame), first = cameras[k_first];
    std::string name = (*images)[first][*frame[k_first]].frame;
    while (!names.insert(name).second) name += "_" + session.cameras[first].name;
    for (size_t k = 0; k < cameras.size(); ++k) {
      if (frame[k]) (*images)[cameras[k]][*frame[k]].frame = name;
    }
  }
}

void PairByTime(const Session& session, CameraList* images, std::vector<std::string>* notes) {
  const std::vector<size_t> cameras = CamerasWithImages(*images);
  if (cameras.size() < 2 || !IsByTime(session, cameras, *images)) return;
  std::vector<std::vector<double>> times;
  for (const size_t c : cameras) times.push_back(TimesOf((*images)[c]));
  const TimePairs pairs = PairTimes(times, session.pairing.tolerance);
  for (size_t k = 1; k < cameras.size(); ++k) {
    std::vector<double> differences;
    for (const auto& frame : pairs.frames) {
      if (frame[0] && frame[k]) differences.push_back(times[k][*frame[k]] - times[0][*frame[0]]);
    }
    const std::string &first = session.cameras[cameras[0]].name,
                      &own = session.cameras[cameras[k]].name;
    notes->push_back(PairingNote(first, own, differences, times[k].size(), pairs.tolerance));
  }
  NameFrames(session, cameras, pairs, images);
}

}  // namespace

std::vector<std::vector<FrameImage>> ListSessionImages(const Session& session,
                                                       std::vector<std::string>* notes) {
  CameraList images;
  ImageLister lister;
  for (const SessionCamera& camera : session.cameras) {
    images.push_back(camera.images.empty() ? camera.given_images
                                           : lister.List(camera.images, camera.name + ": images"));
    if (camera.images.empty()) continue;
    if (!camera.times.empty()) {
      TakeTimes(camera.times, "camera " + camera.name, &images.back());
    } else {
      TakeTimesOfNames(&images.back());
    }
  }
  *notes = lister.Notes();
  PairByTime(session, &images, notes);
  return images;
}

}  // namespace plenocal
