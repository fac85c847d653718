// SPDX-License-Identifier: Apache-2.0
#include "apps/recording/pairing.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <iterator>
#include <limits>
#include <map>
#include <set>

#include "calib/base/error.h"
#include "calib/base/statistics.h"

namespace plenocal {
namespace {

[[noreturn]] void RefusePairing(const Recording& recording, const std::string& message) {
  throw Error(ErrorKind::kInput, fmt::format("{}: {}", recording.path.string(), message));
}

bool AllTimed(const RecordedCamera& camera) {
  return std::ranges::all_of(camera.images,
                             [](const RecordedImage& image) { return image.time.has_value(); });
}

std::vector<double> TimesOf(const RecordedCamera& camera) {
  std::vector<double> times;
  for (const RecordedImage& image : camera.images) times.push_back(*image.time);
  return times;
}

RecordedFrame FrameOf(const Recording& recording, size_t camera, size_t image) {
  const RecordedImage& recorded = recording.cameras[camera].images[image];
  RecordedFrame frame{.name = recorded.name,
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
      const auto [place, is_new] = frame_of_name.emplace(images[i].name, recording->frames.size());
      if (is_new) recording->frames.push_back(FrameOf(*recording, c, i));
      recording->frames[place->second].image[c] = i;
      shared += is_new ? 0 : 1;
    }
    if (c > 0 && shared == 0) {
      const RecordedCamera& first = recording->cameras[0];
      RefusePairing(*recording,
                    fmt::format("images of {} and {} share no frame name ({}, {}); in "
                                "recording.yaml let the last '*' of 'images' stand for what both "
                                "names share, or give times",
                                first.name,
                                recording->cameras[c].name,
                                first.images[0].name,
                                images[0].name));
    }
  }
}

/// Index of the value that is nearest to `time`; of two the earlier one. `sorted` is not empty.
size_t NearestIndex(const std::vector<double>& sorted, double time) {
  const auto after = std::ranges::lower_bound(sorted, time);
  const auto index = static_cast<size_t>(after - sorted.begin());
  if (after == sorted.begin()) return 0;
  if (after == sorted.end()) return index - 1;
  return time - sorted[index - 1] <= sorted[index] - time ? index - 1 : index;
}

void AddCameraByTime(size_t camera, Recording* recording) {
  const std::vector<double> times = TimesOf(recording->cameras[camera]);
  std::vector<double> frame_times;
  for (const RecordedFrame& frame : recording->frames) frame_times.push_back(frame.time);
  std::vector<RecordedFrame> alone;
  for (size_t i = 0; i < times.size(); ++i) {
    const size_t nearest = NearestIndex(frame_times, times[i]);
    const bool pair = std::abs(times[i] - frame_times[nearest]) <= recording->tolerance &&
                      NearestIndex(times, frame_times[nearest]) == i;
    if (pair) {
      recording->frames[nearest].image[camera] = i;
    } else {
      alone.push_back(FrameOf(*recording, camera, i));
    }
  }
  std::ranges::move(alone, std::back_inserter(recording->frames));
  std::ranges::stable_sort(recording->frames, {}, &RecordedFrame::time);
}

void PairByTime(const Pairing& pairing, Recording* recording) {
  for (const RecordedCamera& camera : recording->cameras) {
    if (AllTimed(camera)) continue;
    RefusePairing(*recording,
                  fmt::format("'pairing' is by time, but camera {} has no times; add its 'times'",
                              camera.name));
  }
  const RecordedCamera& first = recording->cameras[0];
  // Beyond half of an interval an image is nearer to another frame's time.
  recording->tolerance = pairing.tolerance.value_or(UsualInterval(TimesOf(first)) / 2);
  for (size_t i = 0; i < first.images.size(); ++i) {
    recording->frames.push_back(FrameOf(*recording, 0, i));
  }
  for (size_t c = 1; c < recording->cameras.size(); ++c) AddCameraByTime(c, recording);
}

/// Without times nothing shows at which place an image is missing.
void CheckCounts(const Recording& recording) {
  for (const RecordedCamera& camera : recording.cameras) {
    const RecordedCamera& first = recording.cameras[0];
    if (camera.images.size() == first.images.size()) continue;
    RefusePairing(
        recording,
        fmt::format("{} has {} images and {} has {}, and no times show which are missing; give "
                    "'times' of each camera in recording.yaml, or write 'pairing: {{by: name}}' "
                    "there if equal names are certain to be one instant",
                    first.name,
                    first.images.size(),
                    camera.name,
                    camera.images.size()));
  }
}

/// Frames that only one camera has can be called as others: by another camera then.
void MakeNamesDiffer(Recording* recording) {
  std::set<std::string> names;
  for (RecordedFrame& frame : recording->frames) {
    const auto has = std::ranges::find_if(frame.image, [](const auto& i) { return i.has_value(); });
    const std::string& camera =
        recording->cameras[static_cast<size_t>(has - frame.image.begin())].name;
    while (!names.insert(frame.name).second) frame.name += "_" + camera;
  }
}

}  // namespace

double UsualInterval(const std::vector<double>& values) {
  std::vector<double> intervals;
  for (size_t i = 1; i < values.size(); ++i) intervals.push_back(values[i] - values[i - 1]);
  return Median(std::move(intervals));
}

void MakeFrames(const Pairing& pairing, Recording* recording) {
  const bool timed = std::ranges::all_of(recording->cameras, AllTimed);
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
