// SPDX-License-Identifier: Apache-2.0
#include "calib/traits/lattice_shift.h"

#include <fmt/format.h>

#include <algorithm>

namespace plenocal {

std::optional<LatticeShift> SignificantShift(std::span<const LatticeShift> images) {
  LatticeShift mean;
  Eigen::Array4d weights = Eigen::Array4d::Zero(), scatter = weights;
  int count = 0;
  for (const LatticeShift& image : images) {
    if (image.corner == 0) continue;
    const Eigen::Array4d weight = image.sigma.array().square().inverse();
    mean.value.array() += weight * image.value.array();
    weights += weight;
    mean.corner = image.corner;
    ++count;
  }
  if (count == 0) return std::nullopt;
  mean.value.array() /= weights;
  for (const LatticeShift& image : images) {
    if (image.corner == 0) continue;
    scatter += ((image.value - mean.value).array() / image.sigma.array()).square();
  }
  mean.sigma = ((scatter / std::max(count - 1, 1)).max(1) / weights).sqrt();
  constexpr double kSignificant = 5;  // standard errors
  const bool chance = (mean.value.array().abs() < kSignificant * mean.sigma.array()).all();
  if (chance || mean.Largest() < kLeastLatticeShift) return std::nullopt;
  return mean;
}

std::string ShiftText(const LatticeShift& shift) {
  return fmt::format(
      "the micro images lie up to {:.2f} px beside those of the white images (relative change of "
      "the pitch {:+.1e} +- {:.1e}, rotation {:+.1e} rad, displacement {:+.2f}, {:+.2f} px, each +- {:.2f}): the "
      "white images or the grid are of another focus or zoom, or the sensor has moved",
      shift.Largest(),
      shift.value[2] / shift.corner,
      shift.sigma[2] / shift.corner,
      shift.value[3] / shift.corner,
      shift.value[0],
      shift.value[1],
      shift.sigma.head<2>().maxCoeff());
}

}  // namespace plenocal
