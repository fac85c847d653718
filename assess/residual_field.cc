// SPDX-License-Identifier: Apache-2.0
#include "assess/residual_field.h"

#include <algorithm>
#include <cmath>

namespace plenocal {

ResidualField MakeResidualField(const CalibratedCamera& camera) {
  constexpr int kCells = 20;
  ResidualField field{.grid = {camera.image_size, kCells},
                      .points = {},
                      .mean = {},
                      .square = {},
                      .variance_of_mean = {}};
  const size_t cells = field.grid.Cells();
  field.points.resize(cells, 0);
  field.mean.resize(cells, Eigen::Vector2d::Zero());
  field.square.resize(cells, 0);
  field.variance_of_mean.resize(cells, 0);
  for (const ResidualRow& row : camera.residuals) {
    if (!row.used) continue;
    const size_t cell = field.grid.Cell(row.values[0], row.values[1]);
    const double sigma = row.noise_sigma > 0 ? row.noise_sigma : camera.fit.noise_sigma;
    ++field.points[cell];
    field.mean[cell] += row.Error();
    field.square[cell] += row.Error().squaredNorm();
    field.variance_of_mean[cell] += sigma * sigma;
  }
  for (size_t cell = 0; cell < cells; ++cell) {
    const double n = field.points[cell];
    if (n == 0) continue;
    field.mean[cell] /= n;
    field.square[cell] /= n;
    field.variance_of_mean[cell] /= n * n;
  }
  return field;
}

double ResidualField::Pattern() const {
  double pattern = 0, all = 0;
  for (size_t cell = 0; cell < grid.Cells(); ++cell) {
    const double n = points[cell];
    pattern += n * (mean[cell].squaredNorm() / 2 - variance_of_mean[cell]);
    all += n;
  }
  return all > 0 ? std::sqrt(std::max(0.0, pattern / all)) : 0;
}

}  // namespace plenocal
