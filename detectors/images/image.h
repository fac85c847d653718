// SPDX-License-Identifier: Apache-2.0
//
// Reading of images from files and stores, and writing of image files.
#pragma once

#include <cstdint>
#include <filesystem>
#include <opencv2/core/mat.hpp>
#include <optional>
#include <string>
#include <vector>

#include "calib/files/frame_images.h"
#include "calib/files/image_store.h"

namespace plenocal {

/// Reads an image file, or an image of a store (8 or 16 bit; gray, colour), as single-channel 8-bit
/// gray; pixels of a store become grey as those of a PNG do. Sixteen-bit images are scaled by their
/// own largest value's next power of two, so that 12-bit data keep their contrast. Throws `Error`
/// of kind `kInput` that names the file for one that is missing, not an image, corrupt or truncated
/// (a truncated PNG or JPEG must be refused, not filled with gray).
cv::Mat ReadGray(const FrameImage& image);
inline cv::Mat ReadGray(const std::filesystem::path& file) {
  return ReadGray(FrameImage{.frame = {}, .path = file});
}

/// A single-channel image of 8 or 16 bits in 8 bits, as `ReadGray` scales it.
cv::Mat ScaledTo8Bits(const cv::Mat& image);

/// Reads an image as it is: 8 or 16 bits, raw values, one channel or three (BGR). Throws as
/// `ReadGray` does.
cv::Mat ReadImage(const FrameImage& image);
inline cv::Mat ReadImage(const std::filesystem::path& file) {
  return ReadImage(FrameImage{.frame = {}, .path = file});
}

/// The same in one channel: colours weighted as the eye does.
cv::Mat ToGray(const cv::Mat& image);

/// The image of a file's content as single-channel gray of the file's own depth: 8 or 16 bits, raw
/// values. `place` names the file in messages. Throws as `ReadGray` does.
cv::Mat DecodeRawGray(std::vector<std::uint8_t> content, const std::filesystem::path& place);
/// The same of an image that may lie in a store.
cv::Mat ReadRawGray(const FrameImage& image);

/// The image of a file's content, a TIFF of one 32-bit channel. Throws as `ReadGray` does.
cv::Mat DecodeFloat(std::vector<std::uint8_t> content, const std::filesystem::path& place);

/// The orientation tag (EXIF, 1 to 8) of a JPEG file, by which viewers turn it and the functions
/// here do not; 1 where there is none. Throws as `ReadGray` does for a file that is missing.
int ReadOrientation(const FrameImage& image);

/// Differs for images that differ, wherever they lie; empty when the image cannot be read.
std::string HashImage(const FrameImage& image);

/// An image of which `ReadGray`, `HashImage` and `ReadOrientation` are needed: its bytes are read
/// once.
class ImageContent {
 public:
  explicit ImageContent(const FrameImage& image) : image_(image) {}
  [[nodiscard]] std::string Hash();
  [[nodiscard]] cv::Mat Gray();
  [[nodiscard]] int Orientation();

 private:
  const StoredImage& Read();

  const FrameImage& image_;
  std::optional<StoredImage> content_;
};

/// Reads an attenuation image: TIFF of one 32-bit channel, values from 0 to 1.
cv::Mat ReadAttenuation(const std::filesystem::path& path);

/// A message of `ReadImage` or `ReadGray` without "path: " at its beginning, for lists that have
/// the file in a place of its own.
std::string WithoutPath(const std::string& message, const std::filesystem::path& path);

/// The content of an image file of this format: ".png" of 8 or 16 bits or ".jpg" of 8 bits, with
/// one channel or three (BGR); ".tiff" of one channel of floats. `quality`: of JPEG, per cent.
std::string EncodeImage(const std::string& format, const cv::Mat& image, int quality = 95);

}  // namespace plenocal
