// SPDX-License-Identifier: Apache-2.0
#include "engine/resample/stereo_pairs.h"

#include <fmt/format.h>

#include <algorithm>
#include <filesystem>
#include <map>
#include <opencv2/imgproc.hpp>
#include <optional>
#include <set>

#include "calib/base/format_error.h"
#include "detectors/images/image.h"
#include "detectors/images/image_codecs.h"

namespace plenocal {
namespace {

/// The last run of digits in a name; empty when it has none.
std::string LastNumber(const std::string& name) {
  constexpr const char* kDigits = "0123456789";
  const size_t last = name.find_last_of(kDigits);
  if (last == std::string::npos) return {};
  const size_t before = name.find_last_not_of(kDigits, last);
  const size_t first = before == std::string::npos ? 0 : before + 1;
  return name.substr(first, last - first + 1);
}

std::set<std::string> Frames(const std::vector<FrameImage>& images) {
  std::set<std::string> frames;
  for (const FrameImage& image : images) frames.insert(image.frame);
  return frames;
}

bool HaveCommonFrame(const StereoImages& images) {
  const std::set<std::string> second = Frames(images[1]);
  return std::ranges::any_of(images[0],
                             [&](const FrameImage& image) { return second.contains(image.frame); });
}

/// The images with numbers for frames; nothing when a number is missing or stands twice.
std::optional<StereoImages> Numbered(StereoImages images) {
  for (std::vector<FrameImage>& list : images) {
    for (FrameImage& image : list) image.frame = LastNumber(image.frame);
    const std::set<std::string> frames = Frames(list);
    if (frames.contains("") || frames.size() != list.size()) return std::nullopt;
  }
  return images;
}

void RefuseOneFileTwice(const StereoImages& pairs) {
  for (size_t i = 0; i < pairs[0].size(); ++i) {
    std::error_code error;
    if (!std::filesystem::equivalent(pairs[0][i].path, pairs[1][i].path, error)) continue;
    throw InputError("{} and {} are one file; a pair needs an image of each camera",
                     pairs[0][i].path.string(),
                     pairs[1][i].path.string());
  }
}

cv::Mat Colours8Bit(const std::string& encoded) {
  cv::Mat image =
      DecodeImage(std::vector<std::uint8_t>(encoded.begin(), encoded.end()), Channels::kAsStored);
  constexpr double kTo8Bits = 1.0 / 257;
  if (image.depth() == CV_16U) image.convertTo(image, CV_8U, kTo8Bits);
  if (image.channels() == 1) cv::cvtColor(image, image, cv::COLOR_GRAY2BGR);
  return image;
}

}  // namespace

StereoPairs PairImages(StereoImages images) {
  StereoPairs pairs;
  if (images[0].size() == 1 && images[1].size() == 1) {
    pairs.images = std::move(images);
    RefuseOneFileTwice(pairs.images);
    return pairs;
  }
  if (!HaveCommonFrame(images)) {
    if (auto numbered = Numbered(images); numbered && HaveCommonFrame(*numbered)) {
      images = std::move(*numbered);
      pairs.by_number = true;
    } else if (!images[0].empty() && !images[1].empty()) {
      throw InputError(
          "no image of one camera belongs to one of the other ({} is frame "
          "'{}', {} is '{}'); images of a pair have equal names, equal "
          "numbers at their end, or globs whose last * stands for the same",
          images[0][0].path.string(),
          images[0][0].frame,
          images[1][0].path.string(),
          images[1][0].frame);
    }
  }
  std::array<std::map<std::string, FrameImage>, 2> by_frame;
  for (size_t c = 0; c < 2; ++c) {
    for (const FrameImage& image : images[c]) by_frame[c].emplace(image.frame, image);
  }
  for (size_t c = 0; c < 2; ++c) {
    for (const auto& [frame, image] : by_frame[c]) {
      if (by_frame[1 - c].contains(frame)) {
        pairs.images[c].push_back(image);
      } else {
        pairs.left_out.push_back(
            {image.path.string(),
             fmt::format("the other camera has no image of frame '{}'", frame)});
      }
    }
  }
  RefuseOneFileTwice(pairs.images);
  return pairs;
}

std::string DrawPair(const std::string& first, const std::string& second) {
  constexpr int kLines = 20;
  cv::Mat both;
  cv::hconcat(Colours8Bit(first), Colours8Bit(second), both);
  for (int i = 0; i < kLines; ++i) {
    const int row = (2 * i + 1) * both.rows / (2 * kLines);
    const cv::Scalar colour = i % 2 == 0 ? cv::Scalar(60, 220, 60) : cv::Scalar(60, 160, 255);
    cv::line(both, {0, row}, {both.cols - 1, row}, colour);
  }
  return EncodeImage(".png", both);
}

}  // namespace plenocal
