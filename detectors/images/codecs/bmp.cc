// SPDX-License-Identifier: Apache-2.0
//
// BMP files of Windows without compression.
#include <algorithm>
#include <array>
#include <cstdlib>
#include <opencv2/core.hpp>

#include "detectors/images/codecs/image_codec.h"

namespace plenocal {
namespace {

using internal::ByteView;

constexpr const char* kBmp = "BMP";

/// The number of `size` bytes at this place of the file.
std::uint32_t BmpNumber(ByteView in, std::size_t at, int size) {
  if (at + size > in.size()) throw internal::TruncatedImage(kBmp);
  return internal::LittleEndian(in, at, size);
}

/// Positive where the rows begin at the lower end.
std::int64_t BmpHeight(ByteView in) { return static_cast<std::int32_t>(BmpNumber(in, 22, 4)); }

bool IsBmp(ByteView content) { return internal::StartsWith(content, "BM"); }

ImageHeader ReadBmpHeader(ByteView in) {
  constexpr std::uint32_t kShortest = 40, kMasks = 3;
  const std::uint32_t bits = BmpNumber(in, 28, 2), compression = BmpNumber(in, 30, 4);
  const bool is_packed = compression != 0 && !(compression == kMasks && bits == 32);
  constexpr std::array kBits{1u, 4u, 8u, 24u, 32u};
  if (BmpNumber(in, 14, 4) < kShortest || is_packed || std::ranges::count(kBits, bits) == 0) {
    throw ImageDefect(
        "expected a BMP of Windows with 1, 4, 8, 24 or 32 bits a pixel, not compressed; convert it "
        "to PNG");
  }
  const auto width = static_cast<std::int32_t>(BmpNumber(in, 18, 4));
  if (width < 0) throw internal::DamagedImage(kBmp, "its width is negative");
  return {.width = static_cast<std::uint64_t>(width),
          .height = static_cast<std::uint64_t>(std::abs(BmpHeight(in))),
          .bits = bits};
}

cv::Mat DecodeBmp(ByteView in, Channels /*channels*/) {
  using Colour = cv::Vec3b;
  const auto [width, height, bits, orientation] = ReadBmpHeader(in);
  const std::uint64_t pixels = BmpNumber(in, 10, 4), row = (width * bits + 31) / 32 * 4;
  if (in.size() < pixels + row * height) throw internal::TruncatedImage(kBmp);
  std::array<Colour, 256> palette{};
  const std::uint32_t used = BmpNumber(in, 46, 4), most = bits <= 8 ? 1u << bits : 0;
  for (std::uint32_t k = 0; k < (used == 0 ? most : std::min(used, most)); ++k) {
    const std::size_t at = std::size_t{14} + BmpNumber(in, 14, 4) + std::size_t{4} * k;
    for (int c = 0; c < 3; ++c) {
      palette[k][c] = static_cast<std::uint8_t>(BmpNumber(in, at + c, 1));
    }
  }
  cv::Mat image(static_cast<int>(height), static_cast<int>(width), CV_8UC3);
  const bool upward = BmpHeight(in) > 0;
  for (int y = 0; y < image.rows; ++y) {
    const std::uint8_t* const from = &in[pixels + row * (upward ? image.rows - 1 - y : y)];
    auto* const out = image.ptr<Colour>(y);
    for (int x = 0; x < image.cols; ++x) {
      const std::uint64_t at = x * bits;
      if (bits <= 8) {
        out[x] = palette[from[at / 8] >> (8 - bits - at % 8) & (most - 1)];
      } else {
        std::copy_n(from + at / 8, 3, out[x].val);
      }
    }
  }
  const bool is_grey = bits <= 8 && std::ranges::all_of(palette, [](const Colour& c) {
                         return c[0] == c[1] && c[0] == c[2];
                       });
  return is_grey ? internal::GreyOfBgr(image) : image;
}

}  // namespace

ImageCodec BmpCodec() { return {kBmp, {}, &IsBmp, &ReadBmpHeader, &DecodeBmp, nullptr}; }

}  // namespace plenocal
