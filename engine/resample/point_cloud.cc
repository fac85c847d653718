// SPDX-License-Identifier: Apache-2.0
#include "engine/resample/point_cloud.h"

#include <fmt/format.h>

#include <bit>

namespace plenocal {

std::string PlyText(std::span<const CloudPoint> points, const std::string& comment) {
  std::string text = fmt::format(
      "ply\nformat binary_little_endian 1.0\ncomment {}\nelement vertex {}\nproperty float x\n"
      "property float y\nproperty float z\nproperty float sigma\nproperty uchar red\nproperty "
      "uchar green\nproperty uchar blue\nend_header\n",
      comment,
      points.size());
  const auto append = [&](float value) {
    const auto bits = std::bit_cast<std::uint32_t>(value);
    for (int byte = 0; byte < 4; ++byte) text += static_cast<char>(bits >> (8 * byte) & 0xff);
  };
  for (const CloudPoint& point : points) {
    for (const float coordinate : point.p) append(coordinate);
    append(point.sigma);
    for (const std::uint8_t channel : point.rgb) text += static_cast<char>(channel);
  }
  return text;
}

}  // namespace plenocal
