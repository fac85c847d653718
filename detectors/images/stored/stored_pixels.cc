// SPDX-License-Identifier: Apache-2.0
#include "detectors/images/stored/stored_pixels.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <bit>
#include <cstring>
#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>
#include <string>

#include "calib/base/format_error.h"
#include "detectors/images/codecs/image_codec.h"

namespace plenocal::internal {
namespace {

namespace fs = std::filesystem;

constexpr int kAsIs = -1;

/// An encoding of sensor_msgs/image_encodings.hpp.
struct Encoding {
  std::string_view name;
  int type;    // of OpenCV, as stored
  int to_bgr;  // cv::ColorConversionCodes; kAsIs: it is grey, a mosaic or BGR
};

constexpr std::array kEncodings{Encoding{"mono8", CV_8UC1, kAsIs},
                                Encoding{"8UC1", CV_8UC1, kAsIs},
                                Encoding{"bayer_rggb8", CV_8UC1, kAsIs},
                                Encoding{"bayer_bggr8", CV_8UC1, kAsIs},
                                Encoding{"bayer_gbrg8", CV_8UC1, kAsIs},
                                Encoding{"bayer_grbg8", CV_8UC1, kAsIs},
                                Encoding{"mono16", CV_16UC1, kAsIs},
                                Encoding{"16UC1", CV_16UC1, kAsIs},
                                Encoding{"bayer_rggb16", CV_16UC1, kAsIs},
                                Encoding{"bayer_bggr16", CV_16UC1, kAsIs},
                                Encoding{"bayer_gbrg16", CV_16UC1, kAsIs},
                                Encoding{"bayer_grbg16", CV_16UC1, kAsIs},
                                Encoding{"bgr8", CV_8UC3, kAsIs},
                                Encoding{"8UC3", CV_8UC3, kAsIs},
                                Encoding{"bgr16", CV_16UC3, kAsIs},
                                Encoding{"16UC3", CV_16UC3, kAsIs},
                                Encoding{"rgb8", CV_8UC3, cv::COLOR_RGB2BGR},
                                Encoding{"rgb16", CV_16UC3, cv::COLOR_RGB2BGR},
                                Encoding{"bgra8", CV_8UC4, cv::COLOR_BGRA2BGR},
                                Encoding{"8UC4", CV_8UC4, cv::COLOR_BGRA2BGR},
                                Encoding{"rgba8", CV_8UC4, cv::COLOR_RGBA2BGR},
                                Encoding{"bgra16", CV_16UC4, cv::COLOR_BGRA2BGR},
                                Encoding{"rgba16", CV_16UC4, cv::COLOR_RGBA2BGR},
                                Encoding{"yuv422", CV_8UC2, cv::COLOR_YUV2BGR_UYVY},
                                Encoding{"uyvy", CV_8UC2, cv::COLOR_YUV2BGR_UYVY},
                                Encoding{"yuv422_yuy2", CV_8UC2, cv::COLOR_YUV2BGR_YUY2},
                                Encoding{"yuyv", CV_8UC2, cv::COLOR_YUV2BGR_YUY2}};

[[noreturn]] void RefusePixels(const fs::path& place, const std::string& reason) {
  throw InputError("{}: {}", place.string(), reason);
}

const Encoding& EncodingOf(const StoredImage& stored, const fs::path& place) {
  const auto found = std::ranges::find(kEncodings, stored.encoding, &Encoding::name);
  if (found != kEncodings.end()) return *found;
  std::string known;
  for (const Encoding& encoding : kEncodings) {
    known += (known.empty() ? "" : ", ") + std::string(encoding.name);
  }
  RefusePixels(place,
               fmt::format("pixels of encoding '{}' cannot be read; let the driver publish one of "
                           "{}, or convert the topic with image_transport",
                           stored.encoding.substr(0, 32),
                           known));
}

/// The pixels as they are stored, in the byte order of this machine.
cv::Mat Copied(const StoredImage& stored, int type, const fs::path& place) {
  const auto [width, height] = stored.size;
  if (width <= 0 || height <= 0) {
    RefusePixels(place, fmt::format("the message states {} x {} pixels", width, height));
  }
  const size_t row = static_cast<size_t>(width) * CV_ELEM_SIZE(type);
  if (stored.step < row || stored.step > stored.bytes.size() ||
      stored.step * (static_cast<size_t>(height) - 1) + row > stored.bytes.size()) {
    RefusePixels(place,
                 fmt::format("{} x {} pixels of {} and a step of {} bytes do not fit into its {} "
                             "bytes; the driver writes damaged messages",
                             width,
                             height,
                             stored.encoding,
                             stored.step,
                             stored.bytes.size()));
  }
  cv::Mat image(height, width, type);
  for (int y = 0; y < height; ++y) {
    std::memcpy(image.ptr(y), stored.bytes.data() + static_cast<size_t>(y) * stored.step, row);
  }
  if (CV_MAT_DEPTH(type) != CV_16U ||
      stored.big_endian == (std::endian::native == std::endian::big)) {
    return image;
  }
  for (int y = 0; y < height; ++y) {
    auto* const values = image.ptr<std::uint16_t>(y);
    const int count = width * image.channels();
    std::transform(values, values + count, values, [](std::uint16_t value) {
      return static_cast<std::uint16_t>(value << 8 | value >> 8);
    });
  }
  return image;
}

}  // namespace

cv::Mat ImageOfPixels(const StoredImage& stored, const fs::path& place) {
  const Encoding& encoding = EncodingOf(stored, place);
  cv::Mat image = Copied(stored, encoding.type, place);
  if (encoding.to_bgr == kAsIs) return image;
  if (image.channels() == 2 && image.cols % 2 != 0) {
    RefusePixels(place, "pixels of yuv422 come in pairs, but the image's width is odd");
  }
  cv::Mat bgr;
  cv::cvtColor(image, bgr, encoding.to_bgr);
  return bgr;
}

cv::Mat GrayOfPixels(const StoredImage& stored, const fs::path& place) {
  cv::Mat image = ImageOfPixels(stored, place);
  if (image.channels() == 1) return image;
  // libpng's png_do_rgb_to_gray rounds 16 bits and cuts 8.
  return GreyOfBgr(image,
                   {.red = 9797, .green = 19234, .bits = 15, .round = image.depth() == CV_16U});
}

}  // namespace plenocal::internal
