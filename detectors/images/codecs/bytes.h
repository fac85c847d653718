// SPDX-License-Identifier: Apache-2.0
//
// Numbers in the bytes of image files.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <span>
#include <string_view>

namespace plenocal::internal {

using ByteView = std::span<const std::uint8_t>;

/// The unsigned number of `size` bytes at `at`, most significant byte first; `bytes` must have
/// them.
inline std::uint32_t BigEndian(ByteView bytes, std::size_t at, int size) {
  std::uint32_t value = 0;
  for (int k = 0; k < size; ++k) value = value << 8 | bytes[at + k];
  return value;
}

/// The same, least significant byte first.
inline std::uint32_t LittleEndian(ByteView bytes, std::size_t at, int size) {
  std::uint32_t value = 0;
  for (int k = size - 1; k >= 0; --k) value = value << 8 | bytes[at + k];
  return value;
}

inline bool StartsWith(ByteView bytes, std::string_view magic) {
  return bytes.size() >= magic.size() &&
         std::equal(magic.begin(), magic.end(), bytes.begin(), [](char c, std::uint8_t b) {
           return static_cast<std::uint8_t>(c) == b;
         });
}

}  // namespace plenocal::internal
