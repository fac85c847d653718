// SPDX-License-Identifier: Apache-2.0
//
// PGM and PPM files of bytes.
#include <cctype>
#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>

#include "detectors/images/codecs/image_codec.h"

namespace plenocal {
namespace {

using internal::ByteView;

constexpr const char* kPnm = "PGM or PPM";

struct PnmStart {
  ImageHeader header;
  std::size_t pixels = 0;  // place in the file
};

bool IsPnm(ByteView content) {
  return (internal::StartsWith(content, "P5") || internal::StartsWith(content, "P6")) &&
         content.size() >= 3 && std::isspace(content[2]) != 0;
}

PnmStart ReadPnmStart(ByteView in) {
  std::size_t at = 2;
  std::array<std::uint64_t, 3> numbers{};  // width, height, largest value
  for (std::uint64_t& number : numbers) {
    for (bool comment = false; at < in.size(); ++at) {
      comment = in[at] == '#' || (comment && in[at] != '\n');
      if (!comment && std::isspace(in[at]) == 0) break;
    }
    if (at == in.size()) throw internal::TruncatedImage(kPnm);
    if (std::isdigit(in[at]) == 0) throw internal::DamagedImage(kPnm, "expected a number");
    constexpr std::uint64_t kMost = std::uint64_t{1} << 32;
    for (; at < in.size() && std::isdigit(in[at]) != 0 && number < kMost; ++at) {
      number = number * 10 + (in[at] - '0');
    }
  }
  const auto [width, height, largest] = numbers;
  if (largest == 0 || largest > 0xffff) {
    throw internal::DamagedImage(kPnm, "expected a largest value from 1 to 65535");
  }
  const int channels = in[1] == '6' ? 3 : 1, bits = largest > 0xff ? 16 : 8;
  return {.header = {.width = width, .height = height, .bits = std::uint64_t{1} * channels * bits},
          .pixels = at + 1};
}

ImageHeader ReadPnmHeader(ByteView content) { return ReadPnmStart(content).header; }

cv::Mat DecodePnm(ByteView content, Channels /*channels*/) {
  const auto [header, at] = ReadPnmStart(content);
  const int channels = content[1] == '6' ? 3 : 1;
  cv::Mat image(static_cast<int>(header.height),
                static_cast<int>(header.width),
                CV_MAKETYPE(header.bits / channels == 16 ? CV_16U : CV_8U, channels));
  const std::size_t bytes = image.total() * image.elemSize();
  if (at > content.size() || content.size() - at < bytes) throw internal::TruncatedImage(kPnm);
  std::copy_n(content.begin() + static_cast<std::ptrdiff_t>(at), bytes, image.data);
  if (image.depth() == CV_16U) {
    auto* const values = image.ptr<std::uint16_t>();
    std::transform(values, values + bytes / 2, values, [](std::uint16_t value) {
      return static_cast<std::uint16_t>(value << 8 | value >> 8);
    });
  }
  if (channels == 3) cv::cvtColor(image, image, cv::COLOR_RGB2BGR);
  return image;
}

}  // namespace

ImageCodec PnmCodec() { return {"PGM, PPM", {}, &IsPnm, &ReadPnmHeader, &DecodePnm, nullptr}; }

}  // namespace plenocal
