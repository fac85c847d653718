// SPDX-License-Identifier: Apache-2.0
#include "detectors/images/orientation_tag.h"

#include <algorithm>
#include <string_view>

namespace plenocal::internal {
namespace {

using namespace std::string_view_literals;

constexpr int kAsRecorded = 1;

/// `tiff`: what follows "Exif\0\0", a TIFF header with its first directory.
int TagOfExif(ByteView tiff) {
  const bool little = StartsWith(tiff, "II*\0"sv);
  if (tiff.size() < 8 || !(little || StartsWith(tiff, "MM\0*"sv))) return kAsRecorded;
  const auto read = little ? LittleEndian : BigEndian;
  const std::size_t directory = read(tiff, 4, 4);
  if (directory + 2 > tiff.size()) return kAsRecorded;
  constexpr std::size_t kEntry = 12;  // tag, type, count, value
  constexpr std::uint32_t kOrientation = 0x0112, kShort = 3;
  const std::size_t end = directory + 2 + kEntry * read(tiff, directory, 2);
  for (std::size_t at = directory + 2; at < end && at + kEntry <= tiff.size(); at += kEntry) {
    if (read(tiff, at, 2) != kOrientation || read(tiff, at + 2, 2) != kShort) continue;
    const auto value = static_cast<int>(read(tiff, at + 8, 2));
    return value <= 8 ? std::max(value, kAsRecorded) : kAsRecorded;
  }
  return kAsRecorded;
}

}  // namespace

int OrientationTag(ByteView file) {
  if (!StartsWith(file, "\xff\xd8"sv)) return kAsRecorded;
  // Segments: 0xff, type, length with its own two bytes, content.
  constexpr std::uint8_t kApp1 = 0xe1, kScan = 0xda;
  std::size_t at = 2;
  while (at + 4 <= file.size() && file[at] == 0xff) {
    const std::uint8_t type = file[at + 1];
    if (type == 0xff) {  // a fill byte
      ++at;
      continue;
    }
    const std::size_t length = BigEndian(file, at + 2, 2);
    if (type == kScan || length < 2 || at + 2 + length > file.size()) break;
    const ByteView content = file.subspan(at + 4, length - 2);
    constexpr std::string_view kExif = "Exif\0\0"sv;
    if (type == kApp1 && StartsWith(content, kExif))
      return TagOfExif(content.subspan(kExif.size()));
    at += 2 + length;
  }
  return kAsRecorded;
}

}  // namespace plenocal::internal
