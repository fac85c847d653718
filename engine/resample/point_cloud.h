// SPDX-License-Identifier: Apache-2.0
//
// Point clouds as PLY files.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <string>

namespace plenocal {

struct CloudPoint {
  std::array<float, 3> p;  ///< m
  float sigma;             ///< of the distance, m
  std::array<std::uint8_t, 3> rgb;
};

/// The points as a PLY file: binary, little endian; x, y, z, sigma (float), red, green, blue
/// (uchar). `comment` goes into the header, one line.
std::string PlyText(std::span<const CloudPoint> points, const std::string& comment);

}  // namespace plenocal
