// SPDX-License-Identifier: Apache-2.0
//
// Access to micro lenses by position and by lattice step.
#pragma once

#include <Eigen/Core>
#include <vector>

#include "calib/camera/micro_lens_array.h"

namespace plenocal::internal {

/// A step on the lattice of micro lenses: columns along e_column, rows along e_row.
struct LatticeStep {
  int column = 0, row = 0;
};

/// Finds micro lenses by position: the neighbours of a micro lens and the one nearest to a point.
class MicroLensIndex {
 public:
  /// Keeps a reference to the array.
  explicit MicroLensIndex(const MicroLensArray& array);

  [[nodiscard]] const MicroLensArray& Array() const { return array_; }
  /// The micro lens that lies `step` away from micro lens `index`, or -1 where the array has none.
  [[nodiscard]] int Neighbour(int index, LatticeStep step) const;
  /// The micro lens whose centre is nearest to a point of the sensor, px, to within
  /// `kNearestError`; -1 outside of the lattice.
  [[nodiscard]] int Nearest(const Eigen::Vector2d& point) const;

  /// `Nearest` uses the nearest micro lens of the middle of a raster cell. Its distance from the
  /// point exceeds the least distance by up to this, px.
  static constexpr float kNearestError = 2;

 private:
  static constexpr int kCell = 2;  // px, side of a raster cell

  /// A point in units of raster cells, (0, 0) at the middle of the first.
  static Eigen::Vector2d ToCells(const Eigen::Vector2d& point);
  void FillRaster();
  [[nodiscard]] int At(int row, int column) const;

  const MicroLensArray& array_;
  int first_row_ = 0, first_column_ = 0, rows_ = 0, columns_ = 0;
  std::vector<int> table_;  // rows_ x columns_: index of the micro lens, or -1
  int cells_x_ = 0, cells_y_ = 0;
  std::vector<int> nearest_;  // by raster cell: the micro lens nearest to its middle, or -1
};

/// All lattice steps up to `reach` pitches long, without the zero step, shortest first. Steps of
/// one length are complete, so the set has the lattice's six-fold symmetry.
std::vector<LatticeStep> StepsWithin(const MicroLensArray& array, double reach);

}  // namespace plenocal::internal
