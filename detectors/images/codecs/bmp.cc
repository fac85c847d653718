// SPDX-License-Identifier: Apache-2.0
//
// BMP files without compression.
#include <algorithm>
#include <array>
#include <cstdlib>
#include <opencv2/core.hpp>

#include "detectors/images/codecs/image_codec.h"

namespace plenocal {
namespace {

using internal::ByteView, internal::LittleEndian;

constexpr const char* kBmp = "BMP";

struct BmpLayout {
  std::uint32_t pixels;   // place in the file
  std::uint32_t palette;  // place in the file
  std::uint32_t entry;    // bytes of a colour of the palette
  std::uint32_t colours;  // of the palette
  std::int64_t width, height;
  std::uint32_t bits;
  bool upward;      // rows from the lower end on
  bool long_green;  // 16 bits: green has six of them, else five
  bool is_os2;
};

BmpLayout ReadBmpLayout(ByteView in) {
  constexpr std::size_t kFileHeader = 14;
  constexpr std::uint32_t kOs2 = 12, kWindows = 40;  // bytes of the second header
  const auto number = [in](std::size_t at, int size) {
    if (at + size > in.size()) throw internal::TruncatedImage(kBmp);
    return LittleEndian(in, at, size);
  };
  BmpLayout layout{};
  const std::uint32_t header = number(kFileHeader, 4);
  layout.pixels = number(10, 4);
  layout.is_os2 = header == kOs2;
  if (layout.is_os2) {
    layout.width = number(18, 2);
    layout.height = number(20, 2);
    layout.bits = number(24, 2);
    layout.entry = 3;
  } else if (header >= kWindows) {
    layout.width = static_cast<std::int32_t>(number(18, 4));
    layout.height = static_cast<std::int32_t>(number(22, 4));
    layout.bits = number(28, 2);
    layout.entry = 4;
    layout.colours = number(46, 4);
    constexpr std::uint32_t kMasks = 3;
    const std::uint32_t compression = number(30, 4);
    if (compression != 0 && compression != kMasks) {
      throw ImageDefect("is a compressed BMP, which is not read; convert it to PNG");
    }
    constexpr std::uint32_t kRedOf555 = 0x7c00, kRedOf565 = 0xf800;
    const std::uint32_t red = compression == kMasks ? number(54, 4) : kRedOf555;
    layout.long_green = red == kRedOf565;
    if (layout.bits == 16 && red != kRedOf555 && red != kRedOf565) {
      throw internal::DamagedImage(kBmp, "expected 5, 5, 5 or 5, 6, 5 bits of the colours");
    }
  } else {
    throw internal::DamagedImage(kBmp, "unknown header");
  }
  layout.palette = kFileHeader + header;
  if (layout.colours == 0) layout.colours = layout.bits <= 8 ? 1u << layout.bits : 0;
  layout.upward = layout.height > 0;
  layout.height = std::abs(layout.height);
  constexpr std::array kBits{1, 4, 8, 16, 24, 32};
  if (std::ranges::count(kBits, static_cast<int>(layout.bits)) == 0) {
    throw internal::DamagedImage(kBmp, "expected 1, 4, 8, 16, 24 or 32 bits a pixel");
  }
  if (layout.width <= 0) throw internal::DamagedImage(kBmp, "its width is not positive");
  return layout;
}

bool IsBmp(ByteView content) { return internal::StartsWith(content, "BM"); }

ImageHeader ReadBmpHeader(ByteView content) {
  const BmpLayout layout = ReadBmpLayout(content);
  return {.width = static_cast<std::uint64_t>(layout.width),
          .height = static_cast<std::uint64_t>(layout.height),
          .bits = layout.bits};
}

cv::Mat DecodeBmp(ByteView content, Channels /*channels*/) {
  const BmpLayout layout = ReadBmpLayout(content);
  const std::uint64_t row = (layout.width * layout.bits + 31) / 32 * 4;
  if (content.size() < layout.pixels + row * layout.height) throw internal::TruncatedImage(kBmp);
  using Colour = cv::Vec3b;
  std::array<Colour, 256> palette{};
  if (layout.bits <= 8) {
    const std::uint32_t colours = std::min(layout.colours, 1u << layout.bits);
    if (content.size() < layout.palette + std::uint64_t{layout.entry} * colours) {
      throw internal::TruncatedImage(kBmp);
    }
    for (std::uint32_t k = 0; k < colours; ++k) {
      std::copy_n(&content[layout.palette + layout.entry * k], 3, palette[k].val);
    }
  }
  constexpr std::uint32_t kUpperFive = 0xf8, kUpperSix = 0xfc;
  cv::Mat image(static_cast<int>(layout.height), static_cast<int>(layout.width), CV_8UC3);
  for (int y = 0; y < image.rows; ++y) {
    const std::uint8_t* const in =
        &content[layout.pixels + row * (layout.upward ? image.rows - 1 - y : y)];
    auto* const out = image.ptr<Colour>(y);
    for (int x = 0; x < image.cols; ++x) {
      if (layout.bits <= 8) {
        const std::uint32_t at = x * layout.bits;
        const std::uint32_t shift = 8 - layout.bits - at % 8;
        out[x] = palette[in[at / 8] >> shift & ((1u << layout.bits) - 1)];
      } else if (layout.bits == 16) {
        const std::uint32_t value = in[2 * x] | in[2 * x + 1] << 8;
        const std::uint32_t green =
            layout.long_green ? value >> 3 & kUpperSix : value >> 2 & kUpperFive;
        const std::uint32_t red = value >> (layout.long_green ? 8 : 7) & kUpperFive;
        out[x] = Colour(value << 3 & kUpperFive, green, red);
      } else {
        std::copy_n(in + static_cast<std::size_t>(x) * (layout.bits / 8), 3, out[x].val);
      }
    }
  }
  const auto is_grey = [](const Colour& c) { return c[0] == c[1] && c[0] == c[2]; };
  // OpenCV, the peer of the tests, reads OS/2's files as grey too.
  return layout.is_os2 || (layout.bits <= 8 && std::ranges::all_of(palette, is_grey))
             ? internal::GreyOfBgr(image)
             : image;
}

}  // namespace

ImageCodec BmpCodec() { return {kBmp, {}, &IsBmp, &ReadBmpHeader, &DecodeBmp, nullptr}; }

}  // namespace plenocal
