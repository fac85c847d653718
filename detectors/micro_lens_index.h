// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <vector>

#include "calib/micro_lens_array.h"

namespace plenocal::internal {

/// A step on the lattice of micro lenses: columns along e_column, rows along e_row.
struct LatticeStep {
  int column = 0, row = 0;
};

/// Finds micro lenses by place: the neighbours of one, and the one nearest to a point.
class MicroLensIndex {
 public:
  explicit MicroLensIndex(const MicroLensArray& array);

  /// The micro lens that lies `step` away from lens `index`, or -1 where the array has none.
  [[nodiscard]] int Neighbour(int index, LatticeStep step) const;
  /// The micro lens whose centre is nearest to a place on the sensor, px (to within two pixels).
  [[nodiscard]] int Nearest(const Eigen::Vector2d& place) const;

 private:
  /// A place in units of the cells of `nearest_`, (0, 0) at the middle of the first.
  static Eigen::Vector2d ToCells(const Eigen::Vector2d& place);

  static constexpr int kCell = 2;  // px

  [[nodiscard]] int At(int row, int column) const;

  const MicroLensArray& array_;
  int first_row_ = 0, first_column_ = 0, rows_ = 0, columns_ = 0;
  std::vector<int> table_;  // rows_ x columns_: index of the micro lens, or -1
  int cells_x_ = 0, cells_y_ = 0;
  std::vector<int>
      nearest_;  // per kCell x kCell px: index of the micro lens nearest to the middle, or -1
};

/// All lattice steps up to `reach` pitches long, without the zero step, shortest first. Steps of
/// one length are complete, so the set has the lattice's six-fold symmetry.
std::vector<LatticeStep> StepsWithin(const MicroLensArray& array, double reach);

}  // namespace plenocal::internal
