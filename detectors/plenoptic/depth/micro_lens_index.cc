// SPDX-License-Identifier: Apache-2.0
#include "detectors/plenoptic/depth/micro_lens_index.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

namespace plenocal::internal {
namespace {

/// Lattice steps whose lengths differ by less than this ratio have one length; lens distortion
/// changes it a little with the direction.
constexpr double kSameLength = 0.05;

}  // namespace

MicroLensIndex::MicroLensIndex(const MicroLensArray& array) : array_(array) {
  const auto [low_row, high_row] = std::minmax_element(
      array.lenses.begin(), array.lenses.end(), [](const MicroLens& a, const MicroLens& b) {
        return a.row < b.row;
      });
  const auto [low_column, high_column] = std::minmax_element(
      array.lenses.begin(), array.lenses.end(), [](const MicroLens& a, const MicroLens& b) {
        return a.column < b.column;
      });
  first_row_ = low_row->row;
  first_column_ = low_column->column;
  rows_ = high_row->row - first_row_ + 1;
  columns_ = high_column->column - first_column_ + 1;
  table_.assign(static_cast<size_t>(rows_) * columns_, -1);
  for (size_t i = 0; i < array.lenses.size(); ++i) {
    const MicroLens& lens = array.lenses[i];
    table_[static_cast<size_t>(lens.row - first_row_) * columns_ + lens.column - first_column_] =
        static_cast<int>(i);
  }
  FillRaster();
}

void MicroLensIndex::FillRaster() {
  const MicroLensArray& array = array_;
  // A cell without a micro lens within one pitch is outside the lattice.
  cells_x_ = (array.image_size[0] + kCell - 1) / kCell;
  cells_y_ = (array.image_size[1] + kCell - 1) / kCell;
  nearest_.assign(static_cast<size_t>(cells_x_) * cells_y_, -1);
  std::vector<float> distance(nearest_.size(), std::numeric_limits<float>::infinity());
  const double reach = array.Pitch() / kCell;
  for (size_t i = 0; i < array.lenses.size(); ++i) {
    const Eigen::Vector2d c = ToCells(array.lenses[i].centre);
    const int x0 = std::max(0, static_cast<int>(std::floor(c.x() - reach)));
    const int x1 = std::min(cells_x_ - 1, static_cast<int>(std::ceil(c.x() + reach)));
    const int y0 = std::max(0, static_cast<int>(std::floor(c.y() - reach)));
    const int y1 = std::min(cells_y_ - 1, static_cast<int>(std::ceil(c.y() + reach)));
    for (int y = y0; y <= y1; ++y) {
      for (int x = x0; x <= x1; ++x) {
        const auto square = static_cast<float>((c - Eigen::Vector2d(x, y)).squaredNorm());
        const size_t at = static_cast<size_t>(y) * cells_x_ + x;
        if (square < distance[at]) {
          distance[at] = square;
          nearest_[at] = static_cast<int>(i);
        }
      }
    }
  }
}

Eigen::Vector2d MicroLensIndex::ToCells(const Eigen::Vector2d& point) {
  return (point.array() - (kCell - 1) / 2.0) / kCell;
}

int MicroLensIndex::At(int row, int column) const {
  const int r = row - first_row_, c = column - first_column_;
  if (r < 0 || r >= rows_ || c < 0 || c >= columns_) return -1;
  return table_[static_cast<size_t>(r) * columns_ + c];
}

int MicroLensIndex::Neighbour(int index, LatticeStep step) const {
  const MicroLens& lens = array_.lenses[index];
  return At(lens.row + step.row, lens.column + step.column);
}

int MicroLensIndex::Nearest(const Eigen::Vector2d& point) const {
  const Eigen::Vector2d cell = ToCells(point);
  const int x = std::clamp(static_cast<int>(std::lround(cell.x())), 0, cells_x_ - 1);
  const int y = std::clamp(static_cast<int>(std::lround(cell.y())), 0, cells_y_ - 1);
  return nearest_[static_cast<size_t>(y) * cells_x_ + x];
}

std::vector<LatticeStep> StepsWithin(const MicroLensArray& array, double reach) {
  const auto length = [&](const LatticeStep& step) {
    return (step.column * array.e_column + step.row * array.e_row).norm();
  };
  const double limit = reach * array.Pitch() * (1 + kSameLength);
  // |a e_column + b e_row| >= sin 60 * pitch * max(|a|, |b|).
  const int most = static_cast<int>(std::ceil(reach / std::sin(std::numbers::pi / 3))) + 1;
  std::vector<LatticeStep> steps;
  for (int row = -most; row <= most; ++row) {
    for (int column = -most; column <= most; ++column) {
      const LatticeStep step{column, row};
      if ((row != 0 || column != 0) && length(step) <= limit) steps.push_back(step);
    }
  }
  std::stable_sort(steps.begin(), steps.end(), [&](const LatticeStep& a, const LatticeStep& b) {
    return length(a) < length(b) * (1 - kSameLength);
  });
  return steps;
}

}  // namespace plenocal::internal
