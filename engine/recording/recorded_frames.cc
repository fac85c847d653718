// SPDX-License-Identifier: Apache-2.0
#include "engine/recording/recorded_frames.h"

#include <fmt/format.h>

#include <algorithm>
#include <limits>
#include <map>
#include <set>

#include "calib/base/format_error.h"
#include "engine/recording/frames/time_pairs.h"
#include "engine/recording/stores/image_index.h"

namespace plenocal {
namespace {

RecordedFrame FrameOf(const Recording& recording, size_t camera, size_t image) {
  const RecordedImage& recorded = recording.cameras[camera].images[image];
  RecordedFrame frame{.name = recorded.frame,
                      .time = recorded.time.value_or(std::numeric_limits<double>::quiet_NaN()),
                      .image = {}};
  frame.image.resize(recording.cameras.size());
  frame.image[camera] = image;
  return frame;
}

void PairByName(Recording* recording) {
  std::map<std::string, size_t> frame_of_name;
  for (size_t c = 0; c < recording->cameras.size(); ++c) {
    const std::vector<RecordedImage>& images = recording->cameras[c].images;
    size_t shared = 0;
    for (size_t i = 0; i < images.size(); ++i) {
      const auto [place, is_new] = frame_of_name.emplace(images[i].frame, recording->frames.size());
      if (is_new) recording->frames.push_back(FrameOf(*recording, c, i));
      recording->frames[place->second].image[c] = i;
      shared += is_new ? 0 : 1;
    }
    if (c > 0 && shared == 0) {
      const RecordedCamera& first = recording->cameras[0];
      throw InputError(
          "{}: images of {} and {} share no frame name ({}, {}); in "
          "recording.yaml let the last '*' of 'images' stand for what both "
          "names share, or give times",
          recording->path.string(),
          first.name,
          recording->cameras[c].name,
          first.images[0].frame,
          images[0].frame);
    }
  }
}

void PairByTime(const Pairing& pairing, Recording* recording) {
  for (const RecordedCamera& camera : recording->cameras) {
    if (HaveTimes(camera.images)) continue;
    throw InputError("{}: 'pairing' is by time, but camera {} has no times; add its 'times'",
                     recording->path.string(),
                     camera.name);
  }
  std::vector<std::vector<double>> times;
  for (const RecordedCamera& camera : recording->cameras) times.push_back(TimesOf(camera.images));
  const TimePairs pairs = PairTimes(times, pairing.tolerance);
  recording->tolerance = pairs.tolerance;
  for (const auto& images : pairs.frames) {
    const size_t first = FirstCamera(images);
    recording->frames.push_back(FrameOf(*recording, first, *images[first]));
    recording->frames.back().image = images;
  }
}

/// Without times nothing shows at which place an image is missing.
void CheckCounts(const Recording& recording) {
  for (const RecordedCamera& camera : recording.cameras) {
    const RecordedCamera& first = recording.cameras[0];
    if (camera.images.size() == first.images.size()) continue;
    throw InputError(
        "{}: {} has {} images and {} has {}, and no times show which are missing; give "
        "'times' of each camera in recording.yaml, or write 'pairing: {{by: name}}' "
        "there if equal names are certain to be one instant",
        recording.path.string(),
        first.name,
        first.images.size(),
        camera.name,
        camera.images.size());
  }
}

/// Frames that only one camera has can be called as others: by another camera then.
void MakeNamesDiffer(Recording* recording) {
  std::set<std::string> names;
  for (RecordedFrame& frame : recording->frames) {
    const std::string& camera = recording->cameras[FirstCamera(frame.image)].name;
    while (!names.insert(frame.name).second) frame.name += "_" + camera;
  }
}

}  // namespace

void MakeFrames(const Pairing& pairing, Recording* recording) {
  const bool timed = std::ranges::all_of(
      recording->cameras, HaveTimes<std::vector<RecordedImage>>, &RecordedCamera::images);
  recording->paired_by = pairing.by.value_or(timed ? Pairing::By::kTime : Pairing::By::kName);
  if (!pairing.by && !timed) CheckCounts(*recording);
  if (recording->paired_by == Pairing::By::kTime) {
    PairByTime(pairing, recording);
  } else {
    PairByName(recording);
  }
  const auto earlier = [&](const RecordedFrame& a, const RecordedFrame& b) {
    return timed ? a.time < b.time : NaturalLess(a.name, b.name);
  };
  std::ranges::stable_sort(recording->frames, earlier);
  MakeNamesDiffer(recording);
}

}  // namespace plenocal
