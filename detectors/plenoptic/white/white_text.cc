// SPDX-License-Identifier: Apache-2.0
#include "detectors/plenoptic/white/white_text.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <numbers>

#include "calib/base/number_text.h"

namespace plenocal {
namespace {

/// A sensor's raw values follow the line to within this, relative.
constexpr double kRawMisfit = 0.1;
constexpr size_t kDefectsShown = 8;

double Degrees(double radians) { return radians * 180 / std::numbers::pi; }

std::string GridText(const MicroLensGrid& grid) {
  const MicroLensArray& array = grid.array;
  const LatticeKind kind = array.Lattice();
  const double angle = kind == LatticeKind::kHexagonal ? 60 : 90;
  std::vector<size_t> by_type(static_cast<size_t>(array.types), 0);
  size_t unusable = 0;
  for (const MicroLens& lens : array.lenses) {
    ++by_type[static_cast<size_t>(lens.type)];
    if (!lens.usable) ++unusable;
  }
  std::string text = fmt::format(
      "  {}, {} unusable, {}\n",
      Counted(array.lenses.size(), "micro lens", "micro lenses"),
      unusable,
      array.types == 1 ? std::string("one type")
                       : fmt::format("{} types: {}", array.types, fmt::join(by_type, ", ")));
  text += fmt::format(
      "  {} lattice, pitch {} px, rotation {:.4f} deg, in the middle; rows {:.0f} deg apart to "
      "{:.3f} deg\n",
      kind == LatticeKind::kHexagonal ? "hexagonal" : "rectangular",
      kind == LatticeKind::kHexagonal
          ? fmt::format("{:.4f}", array.Pitch())
          : fmt::format("{:.4f} x {:.4f}", array.e_column.norm(), array.e_row.norm()),
      Degrees(std::atan2(array.e_column.y(), array.e_column.x())),
      angle,
      std::abs(angle - Degrees(std::acos(array.e_column.dot(array.e_row) /
                                         (array.e_column.norm() * array.e_row.norm())))));
  text += fmt::format(
      "  single centres about the lattice: {:.4f} px RMS, {:.4f} px robust, per coordinate{}\n",
      grid.centre_rms,
      grid.centre_sigma,
      grid.degree > 0 ? fmt::format(" (lattice bent by order {})", grid.degree) : "");
  text += fmt::format(
      "  micro images: brightness varies by {:.2f} % between neighbours, profile fits to {:.2f} "
      "%\n",
      100 * grid.gain_spread,
      100 * grid.misfit);
  return text;
}

std::string NoiseText(const PhotonTransfer& noise) {
  std::string text =
      fmt::format("  noise: variance = ({:.3f} +- {:.3f})^2 + ({:.4f} +- {:.4f}) x grey value\n",
                  noise.read,
                  noise.read_sigma,
                  noise.gain,
                  noise.gain_sigma);
  if (noise.misfit > kRawMisfit) {
    text += fmt::format(
        "  the noise deviates from this line by {:.0f} %: these are no raw values (gamma, JPEG, "
        "noise reduction), or noise below the rounding\n",
        100 * noise.misfit);
  }
  if (noise.defects.empty()) return text;
  text += fmt::format("  {}:", Counted(noise.defects.size(), "defective pixel"));
  for (size_t i = 0; i < std::min(noise.defects.size(), kDefectsShown); ++i) {
    text += fmt::format(" ({}, {})", noise.defects[i].x, noise.defects[i].y);
  }
  return text + (noise.defects.size() > kDefectsShown ? " ...\n" : "\n");
}

}  // namespace

std::string WhiteText(const std::string& name, size_t images, const WhiteCamera& camera) {
  std::string text =
      fmt::format("{}: {} of {} white images, {} x {} px, mean {:.1f} of {:.0f} grey values\n",
                  name,
                  camera.images,
                  images,
                  camera.image_size[0],
                  camera.image_size[1],
                  camera.level,
                  camera.full_scale);
  text += fmt::format(
      "  saturated {:.3f} %, black {:.3f} % of the pixels; illumination uneven by {:.1f} % from "
      "side to side\n",
      100 * camera.saturated,
      100 * camera.black,
      100 * camera.unevenness);
  text += fmt::format("  attenuation from {:.3f} to 1\n", camera.darkest);
  if (camera.noise) text += NoiseText(*camera.noise);
  if (camera.grid) text += GridText(*camera.grid);
  return text;
}

}  // namespace plenocal
