// SPDX-License-Identifier: Apache-2.0
#include "engine/recording/frames/session_times.h"

#include <fmt/format.h>

#include <algorithm>
#include <optional>

#include "calib/base/format_error.h"
#include "engine/recording/frames/times.h"
#include "engine/recording/stores/image_index.h"

namespace plenocal {
namespace {

namespace fs = std::filesystem;

// The time of each image, by its frame's name and its file.
std::vector<double> ReadTimes(const fs::path& path,
                              const std::string& owner,
                              const std::vector<FrameImage>& images) {
  const ImageTimes times = ReadImageTimes(path, ExposureUnit::kMilliseconds);
  std::vector<double> of_frame;
  if (!times.has_ids) {
    if (times.rows.size() != images.size()) {
      throw InputError(
          "{}: has {} times, but {} has {} frames; times without names must be one "
          "per frame",
          path.string(),
          times.rows.size(),
          owner,
          images.size());
    }
    for (const ImageTime& row : times.rows) of_frame.push_back(row.time);
    return of_frame;
  }
  const ImageIndex index(images);
  std::vector<std::optional<double>> found(images.size());
  for (const ImageTime& row : times.rows) {
    if (const auto image = index.Find(row.id)) found[*image] = row.time;
  }
  for (size_t i = 0; i < images.size(); ++i) {
    if (!found[i]) {
      throw InputError(
          "{}: has no time for frame '{}' of {} (its first row is for '{}'); is it "
          "the right file?",
          path.string(),
          images[i].frame,
          owner,
          times.rows[0].id);
    }
    of_frame.push_back(*found[i]);
  }
  return of_frame;
}

}  // namespace

void TakeTimes(const fs::path& times, const std::string& owner, std::vector<FrameImage>* images) {
  const std::vector<double> of_frame = ReadTimes(times, owner, *images);
  for (size_t i = 0; i < images->size(); ++i) (*images)[i].time = of_frame[i];
  std::ranges::stable_sort(*images, {}, [](const FrameImage& image) { return *image.time; });
}

void TakeTimesOfNames(std::vector<FrameImage>* images) {
  constexpr size_t kDigits = 19;  // from 2001 to 2286
  const auto is_time = [](const FrameImage& image) {
    return !image.store && image.frame.size() == kDigits && image.frame[0] == '1' &&
           std::ranges::all_of(image.frame, [](char c) { return '0' <= c && c <= '9'; });
  };
  if (!std::ranges::all_of(*images, is_time)) return;
  constexpr double kNanosecond = 1e-9;
  for (FrameImage& image : *images) {
    image.time = kNanosecond * static_cast<double>(std::stoll(image.frame));
  }
}

std::map<std::string, double> TimesOfFrames(const fs::path& times,
                                            const std::string& owner,
                                            const std::vector<std::string>& frames) {
  std::vector<FrameImage> images;
  for (const std::string& frame : frames) images.push_back({.frame = frame, .path = frame});
  const std::vector<double> of_frame = ReadTimes(times, owner, images);
  std::map<std::string, double> by_name;
  for (size_t i = 0; i < frames.size(); ++i) by_name[frames[i]] = of_frame[i];
  return by_name;
}

}  // namespace plenocal
