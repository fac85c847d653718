// SPDX-License-Identifier: Apache-2.0
#include "detectors/images/image_header.h"

#include <fmt/format.h>

#include <array>
#include <cctype>
#include <cstddef>
#include <limits>
#include <string_view>

#include "detectors/images/bytes.h"

namespace plenocal {
namespace {

using namespace std::string_view_literals;
using internal::BigEndian, internal::ByteView, internal::LittleEndian, internal::StartsWith;
using HeaderSize = std::optional<ImageSize>;

HeaderSize SizeOf(std::uint64_t width, std::uint64_t height) {
  constexpr std::uint64_t kMost = std::numeric_limits<int>::max();
  if (width == 0 || height == 0 || width > kMost || height > kMost) return std::nullopt;
  return ImageSize{static_cast<int>(width), static_cast<int>(height)};
}

HeaderSize SizeOfPng(ByteView in) {
  constexpr std::size_t kWidth = 16, kHeight = 20;  // after signature, length and "IHDR"
  if (in.size() < kHeight + 4) return std::nullopt;
  return SizeOf(BigEndian(in, kWidth, 4), BigEndian(in, kHeight, 4));
}

// Of the segments the start of frame has the size.
HeaderSize SizeOfJpeg(ByteView in) {
  for (std::size_t at = 2; at + 9 <= in.size() && in[at] == 0xff;) {
    const std::uint8_t marker = in[at + 1];
    if (marker == 0xff) {  // a fill byte
      ++at;
      continue;
    }
    const bool is_frame =
        marker >= 0xc0 && marker <= 0xcf && marker != 0xc4 && marker != 0xc8 && marker != 0xcc;
    if (is_frame) return SizeOf(BigEndian(in, at + 7, 2), BigEndian(in, at + 5, 2));
    at += 2 + BigEndian(in, at + 2, 2);
  }
  return std::nullopt;
}

HeaderSize SizeOfBmp(ByteView in) {
  constexpr std::size_t kWidth = 18, kHeight = 22;
  if (in.size() < kHeight + 4 || LittleEndian(in, 14, 4) < 40) return std::nullopt;
  const std::int64_t rows = static_cast<std::int32_t>(LittleEndian(in, kHeight, 4));
  return SizeOf(LittleEndian(in, kWidth, 4), static_cast<std::uint64_t>(rows < 0 ? -rows : rows));
}

HeaderSize SizeOfPnm(ByteView in) {
  std::size_t at = 2;
  std::array<std::uint64_t, 2> numbers{};
  for (std::uint64_t& number : numbers) {
    while (at < in.size() && (std::isspace(in[at]) != 0 || in[at] == '#')) {
      const bool comment = in[at] == '#';
      while (comment && at < in.size() && in[at] != '\n') ++at;
      if (!comment) ++at;
    }
    for (; at < in.size() && std::isdigit(in[at]) != 0; ++at) {
      number = number * 10 + (in[at] - '0');
      if (number > std::numeric_limits<int>::max()) return std::nullopt;
    }
  }
  return SizeOf(numbers[0], numbers[1]);
}

HeaderSize SizeOfTiff(ByteView in) {
  constexpr std::size_t kEntry = 12;
  constexpr std::uint32_t kWidthTag = 256, kHeightTag = 257, kShort = 3;
  const auto read = [&](std::size_t at, int size) {
    return in[0] == 'M' ? BigEndian(in, at, size) : LittleEndian(in, at, size);
  };
  if (in.size() < 8) return std::nullopt;
  const std::size_t directory = read(4, 4);
  if (directory + 2 > in.size()) return std::nullopt;
  std::uint64_t width = 0, height = 0;
  const std::size_t entries = read(directory, 2);
  for (std::size_t k = 0; k < entries; ++k) {
    const std::size_t at = directory + 2 + kEntry * k;
    if (at + kEntry > in.size()) return std::nullopt;
    const std::uint32_t value = read(at + 8, read(at + 2, 2) == kShort ? 2 : 4);
    if (read(at, 2) == kWidthTag) width = value;
    if (read(at, 2) == kHeightTag) height = value;
  }
  return SizeOf(width, height);
}

bool IsJpeg(ByteView in) { return StartsWith(in, "\xff\xd8"); }

bool IsTiff(ByteView in) { return StartsWith(in, "II*\0"sv) || StartsWith(in, "MM\0*"sv); }

}  // namespace

std::optional<ImageSize> SizeInHeader(std::span<const std::uint8_t> start) {
  if (StartsWith(start, "\x89PNG\r\n\x1a\n")) return SizeOfPng(start);
  if (IsJpeg(start)) return SizeOfJpeg(start);
  if (StartsWith(start, "BM")) return SizeOfBmp(start);
  if (StartsWith(start, "P5") || StartsWith(start, "P6")) return SizeOfPnm(start);
  if (IsTiff(start)) return SizeOfTiff(start);
  return std::nullopt;
}

bool HasSizeFurtherBack(std::span<const std::uint8_t> start) {
  return (IsJpeg(start) || IsTiff(start)) && !SizeInHeader(start);
}

std::string PixelsText(std::uint64_t width, std::uint64_t height) {
  std::string text = fmt::format("{} x {} pixels", width, height);
  constexpr std::uint64_t kMillion = 1'000'000;
  if (width * height > kMostPixels) {
    text += fmt::format("; at most {} million are read", kMostPixels / kMillion);
  }
  return text;
}

}  // namespace plenocal
