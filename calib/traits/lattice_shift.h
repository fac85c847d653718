// SPDX-License-Identifier: Apache-2.0
//
// Displacement of the micro images of raw images from the lattice of their white images: another
// focus or zoom, or a sensor that has moved.
#pragma once

#include <Eigen/Core>
#include <optional>
#include <span>
#include <string>

namespace plenocal {

/// Displacement of the micro images of a raw image from the lattice of the white images, px: common
/// to all in x and y, in the corners by a larger pitch, and there by a rotation.
struct LatticeShift {
  Eigen::Vector4d value{0, 0, 0, 0}, sigma{0, 0, 0, 0};
  double corner = 0;  ///< px from the middle to the corners; 0: not measured

  /// In the corner that is displaced most, px.
  [[nodiscard]] double Largest() const { return value.head<2>().norm() + value.tail<2>().norm(); }
};

/// Least displacement in the corners that matters, px: twice the noise of a good point.
inline constexpr double kLeastLatticeShift = 0.05;

/// The mean of images of one camera, where it is at least `kLeastLatticeShift` and by five standard
/// errors not chance; else nothing.
std::optional<LatticeShift> SignificantShift(std::span<const LatticeShift> images);

/// What such a displacement is and where it comes from: one sentence.
std::string ShiftText(const LatticeShift& shift);

}  // namespace plenocal
