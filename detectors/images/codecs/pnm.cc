// SPDX-License-Identifier: Apache-2.0
//
// PBM, PGM and PPM files, of bytes or of digits.
#include <algorithm>
#include <cctype>
#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>

#include "detectors/images/codecs/image_codec.h"

namespace plenocal {
namespace {

using internal::ByteView;

constexpr const char* kPnm = "PNM";

/// A file from its header's end on.
struct PnmFile {
  ByteView rest;
  bool is_bitmap, has_digits;
  int channels;
  std::uint32_t width, height, largest = 1;
};

/// The next number of digits, of which there may be `most`, after spaces and comments.
std::uint32_t ReadPnmNumber(ByteView* rest, int most = 10) {
  const auto next = [rest] { return rest->empty() ? 0 : rest->front(); };
  const auto skip = [rest] { *rest = rest->subspan(1); };
  while (std::isspace(next()) != 0 || next() == '#') {
    const bool comment = next() == '#';
    while (comment && !rest->empty() && next() != '\n') skip();
    if (!rest->empty()) skip();
  }
  if (rest->empty()) throw internal::TruncatedImage(kPnm);
  if (std::isdigit(next()) == 0) throw internal::DamagedImage(kPnm, "expected a number");
  std::uint64_t number = 0;
  for (int k = 0; k < most && std::isdigit(next()) != 0; ++k, skip()) {
    number = number * 10 + (next() - '0');
  }
  constexpr std::uint64_t kMost = 1u << 31;
  return static_cast<std::uint32_t>(std::min(number, kMost));
}

bool IsPnm(ByteView content) {
  return content.size() >= 3 && content[0] == 'P' && content[1] >= '1' && content[1] <= '6' &&
         std::isspace(content[2]) != 0;
}

PnmFile ReadPnmStart(ByteView content) {
  const int kind = content[1] - '0';
  PnmFile file{.rest = content.subspan(2),
               .is_bitmap = kind % 3 == 1,
               .has_digits = kind <= 3,
               .channels = kind % 3 == 0 ? 3 : 1,
               .width = 0,
               .height = 0};
  file.width = ReadPnmNumber(&file.rest);
  file.height = ReadPnmNumber(&file.rest);
  if (!file.is_bitmap) file.largest = ReadPnmNumber(&file.rest);
  if (file.largest == 0 || file.largest > 0xffff) {
    throw internal::DamagedImage(kPnm, "expected a largest value from 1 to 65535");
  }
  if (!file.rest.empty()) file.rest = file.rest.subspan(1);
  return file;
}

ImageHeader ReadPnmHeader(ByteView content) {
  const PnmFile file = ReadPnmStart(content);
  const std::uint64_t bits = file.is_bitmap ? 1 : file.largest > 255 ? 16 : 8;
  return {.width = file.width, .height = file.height, .bits = bits * file.channels};
}

cv::Mat DecodePnm(ByteView content, Channels /*channels*/) {
  PnmFile file = ReadPnmStart(content);
  const int depth = file.largest > 255 ? CV_16U : CV_8U;
  cv::Mat image(static_cast<int>(file.height),
                static_cast<int>(file.width),
                CV_MAKETYPE(depth, file.channels));
  const int count = image.cols * image.channels(), size = static_cast<int>(image.elemSize1());
  const std::size_t row = file.is_bitmap ? (count + 7) / 8 : std::size_t{1} * count * size;
  if (!file.has_digits && file.rest.size() < row * image.rows) {
    throw internal::TruncatedImage(kPnm);
  }
  const auto value = [&](int k) -> std::uint32_t {
    if (file.is_bitmap) {
      const bool black = file.has_digits ? ReadPnmNumber(&file.rest, 1) != 0
                                         : (file.rest[k / 8] >> (7 - k % 8) & 1) != 0;
      return black ? 0 : 255;
    }
    if (!file.has_digits) return internal::BigEndian(file.rest, std::size_t{1} * k * size, size);
    const std::uint32_t number = std::min(ReadPnmNumber(&file.rest), file.largest);
    return depth == CV_8U ? number * 255 / file.largest : number;
  };
  for (int y = 0; y < image.rows; ++y) {
    for (int k = 0; k < count; ++k) {
      if (depth == CV_8U) {
        image.ptr(y)[k] = static_cast<std::uint8_t>(value(k));
      } else {
        image.ptr<std::uint16_t>(y)[k] = static_cast<std::uint16_t>(value(k));
      }
    }
    if (!file.has_digits) file.rest = file.rest.subspan(row);
  }
  if (file.channels == 3) cv::cvtColor(image, image, cv::COLOR_RGB2BGR);
  return image;
}

}  // namespace

ImageCodec PnmCodec() { return {kPnm, {}, &IsPnm, &ReadPnmHeader, &DecodePnm, nullptr}; }

}  // namespace plenocal
