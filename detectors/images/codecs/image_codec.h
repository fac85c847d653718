// SPDX-License-Identifier: Apache-2.0
//
// Interface of the image file formats. A file x_y.cc in this folder defines
// `ImageCodec XYCodec()`; it needs no other edit (cmake/table.cmake).
#pragma once

#include <cstdint>
#include <opencv2/core/mat.hpp>
#include <span>
#include <stdexcept>
#include <string>
#include <string_view>

#include "detectors/images/codecs/bytes.h"

namespace plenocal {

/// Message about an image file without its name: what is wrong with it and what to do.
class ImageDefect : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

/// What an image file states before its pixels.
struct ImageHeader {
  std::uint64_t width = 0, height = 0;  ///< px
  std::uint64_t bits = 0;               ///< of one pixel, all channels
  int orientation = 1;                  ///< of EXIF, 1 to 8; the pixels are not turned by it
};

enum class Channels {
  kAsStored,  ///< one, or three (BGR); alpha is left out
  kGrey,      ///< one
};

struct ImageCodec {
  std::string_view name;       ///< of the format, for messages
  std::string_view extension;  ///< of files that `encode` writes
  bool (*is_format)(internal::ByteView content);
  /// Of a file or its first part. Throws `ImageDefect`.
  ImageHeader (*read_header)(internal::ByteView content);
  /// Pixels of 8 or 16 bits, or a single channel of floats. With `kGrey` a codec that has no rule
  /// of its own for grey may return colours. Throws `ImageDefect`.
  cv::Mat (*decode)(internal::ByteView content, Channels channels);
  /// A file's content; null for formats that are not written. `quality`: of lossy formats, per
  /// cent. Throws `ImageDefect`.
  std::string (*encode)(const cv::Mat& image, int quality);
};

std::span<const ImageCodec> ImageCodecs();

namespace internal {

constexpr const char* kOtherDepth = "expected 8 or 16 bits a channel; convert it";

ImageDefect TruncatedImage(std::string_view format);
/// `reason`: of the library that reads the format.
ImageDefect DamagedImage(std::string_view format, std::string_view reason);

/// Weights of red and green, in units of 2^-bits; that of blue is the rest.
struct GreyWeights {
  std::uint32_t red = 4899, green = 9617;  // of OpenCV's imgcodecs
  int bits = 14;
  bool round = true;  // else cut
};

/// One channel of three (BGR, 8 or 16 bits).
cv::Mat GreyOfBgr(const cv::Mat& bgr, const GreyWeights& weights = {});

}  // namespace internal
}  // namespace plenocal
