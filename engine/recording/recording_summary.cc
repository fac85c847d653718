// SPDX-License-Identifier: Apache-2.0
#include "engine/recording/recording_summary.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cctype>
#include <cmath>

#include "calib/base/number_text.h"
#include "calib/base/statistics.h"
#include "calib/files/calibration_file.h"
#include "engine/recording/frames/time_pairs.h"

namespace plenocal {
namespace {

/// Times of the images; without times their numbers, if all names are numbers.
std::vector<double> PlacesOf(const RecordedCamera& camera) {
  std::vector<double> places;
  for (const RecordedImage& image : camera.images) {
    const bool number =
        std::ranges::all_of(image.frame, [](unsigned char c) { return std::isdigit(c) != 0; });
    if (!image.time && !number) return {};
    places.push_back(image.time ? *image.time : ParseDouble(image.frame).value_or(0));
  }
  return places;
}

std::optional<std::vector<Gap>> GapsOf(const RecordedCamera& camera) {
  const std::vector<double> places = PlacesOf(camera);
  if (places.empty()) return std::nullopt;
  const double usual = UsualInterval(places);
  std::vector<Gap> gaps;
  if (!(usual > 0)) return gaps;
  for (size_t i = 1; i < places.size(); ++i) {
    const double missing = std::round((places[i] - places[i - 1]) / usual) - 1;
    if (missing >= 1) gaps.push_back({camera.images[i - 1].frame, static_cast<size_t>(missing)});
  }
  return gaps;
}

std::optional<ExposureSummary> ExposuresOf(const RecordedCamera& camera) {
  if (!camera.images.front().exposure) return std::nullopt;
  const double first = *camera.images.front().exposure;
  ExposureSummary summary{.least = first, .largest = first};
  double before = first;
  for (const RecordedImage& image : camera.images) {
    const double exposure = *image.exposure;
    summary.least = std::min(summary.least, exposure);
    summary.largest = std::max(summary.largest, exposure);
    if (exposure != before) ++summary.changes;
    summary.largest_step = std::max({summary.largest_step, exposure / before, before / exposure});
    before = exposure;
  }
  return summary;
}

PairSummary PairOf(const Recording& recording, size_t camera) {
  PairSummary pair{.camera = recording.cameras[camera].name};
  std::vector<double> differences;
  for (const RecordedFrame& frame : recording.frames) {
    if (!frame.image[0] || !frame.image[camera]) continue;
    ++pair.frames;
    const auto first = recording.cameras[0].images[*frame.image[0]].time;
    const auto other = recording.cameras[camera].images[*frame.image[camera]].time;
    if (first && other) differences.push_back(std::abs(*other - *first));
  }
  if (differences.empty()) return pair;
  pair.largest = *std::ranges::max_element(differences);
  pair.median = Median(std::move(differences));
  return pair;
}

// ---- what commands lack

/// Missing parts of a calibration of all cameras.
std::vector<std::string> CalibrationLacks(const Recording& recording,
                                          std::span<const CameraModel> models) {
  if (recording.calibration.empty()) {
    for (const ForeignCalibration& foreign : recording.foreign) {
      if (foreign.format.empty()) continue;
      return {fmt::format("a calibration: plenocal import {} --format {} -o {}",
                          foreign.path.string(),
                          foreign.format,
                          (foreign.path.parent_path() / "calibration.yaml").string())};
    }
    return {"a calibration ('calibration' in recording.yaml, or calibration.yaml in the folder)"};
  }
  std::vector<std::string> lacks;
  const CalibrationRecord record = ReadCalibration(recording.calibration, models);
  for (const RecordedCamera& camera : recording.cameras) {
    const auto found = std::ranges::find(record.cameras, camera.name, &CalibratedCamera::name);
    if (found == record.cameras.end()) {
      lacks.push_back(fmt::format("camera {} in {}", camera.name, recording.calibration.string()));
    } else if (found->image_size != camera.image_size) {
      lacks.push_back(fmt::format("a calibration of {} for {} px; {} has {}",
                                  camera.name,
                                  fmt::join(camera.image_size, " x "),
                                  recording.calibration.string(),
                                  fmt::join(found->image_size, " x ")));
    }
  }
  return lacks;
}

std::vector<std::string> ExposureLacks(const RecordingSummary& summary) {
  std::vector<std::string> lacks;
  for (const CameraSummary& camera : summary.cameras) {
    if (!camera.exposure) {
      lacks.push_back(
          fmt::format("exposure times of {} (third column of its 'times')", camera.name));
    } else if (camera.exposure->changes == 0) {
      lacks.push_back(fmt::format("exposures of {} that differ", camera.name));
    }
  }
  return lacks;
}

std::vector<CommandNeeds> NeedsOf(const Recording& recording,
                                  const RecordingSummary& summary,
                                  std::span<const CameraModel> models) {
  const std::vector<std::string> calibration = CalibrationLacks(recording, models);
  CommandNeeds ground_truth{"groundtruth", calibration}, vignette{"vignette", calibration};
  const bool plenoptic = std::ranges::any_of(
      recording.cameras, [](const auto& camera) { return !camera.white_images.empty(); });
  if (recording.cameras.size() > 1 && summary.complete == 0) {
    ground_truth.lacks.emplace_back("frames that all cameras have");
  } else if (recording.cameras.size() == 1 && !plenoptic) {
    ground_truth.lacks.emplace_back(
        "a second camera, or white images of a plenoptic one: nothing gives the scale");
  }
  for (const RecordedCamera& camera : recording.cameras) {
    if (!camera.response.empty()) continue;
    vignette.lacks.push_back(fmt::format("the response of {} ('response')", camera.name));
  }
  return {{"calibrate", {"a session with the target (plenocal init)"}},
          std::move(ground_truth),
          {"response", ExposureLacks(summary)},
          std::move(vignette),
          {"evaluate",
           recording.truth.empty() ? std::vector<std::string>{"the true trajectory ('truth')"}
                                   : std::vector<std::string>{}}};
}

}  // namespace

size_t CameraSummary::Missing() const {
  size_t missing = 0;
  for (const Gap& gap : gaps.value_or(std::vector<Gap>())) missing += gap.missing;
  return missing;
}

RecordingSummary Summarise(const Recording& recording, std::span<const CameraModel> models) {
  RecordingSummary summary;
  for (const RecordedFrame& frame : recording.frames) {
    const bool all =
        std::ranges::all_of(frame.image, [](const auto& image) { return image.has_value(); });
    summary.complete += all ? 1 : 0;
  }
  if (recording.HasTimes()) {
    std::vector<double> times;
    for (const RecordedFrame& frame : recording.frames) times.push_back(frame.time);
    summary.duration = times.back() - times.front();
    const double usual = UsualInterval(times);
    if (usual > 0) summary.rate = 1 / usual;
  }
  for (const RecordedCamera& camera : recording.cameras) {
    summary.cameras.push_back(
        {.name = camera.name, .gaps = GapsOf(camera), .exposure = ExposuresOf(camera)});
  }
  for (size_t c = 1; c < recording.cameras.size(); ++c) {
    summary.pairs.push_back(PairOf(recording, c));
  }
  summary.needs = NeedsOf(recording, summary, models);
  return summary;
}

}  // namespace plenocal
