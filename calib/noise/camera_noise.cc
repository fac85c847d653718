// SPDX-License-Identifier: Apache-2.0
#include "calib/camera_noise.h"

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <vector>

namespace plenocal {
namespace {

// Of differences and of means: variances are then known to 14 %, or else are not told apart.
constexpr double kLeastDegrees = 100;

struct Row {
  Eigen::Vector4d residual = Eigen::Vector4d::Zero();
  double sigma2 = 0;  // stated
};

// The used rows of one marker in one view.
using MarkerRows = std::vector<Row>;

std::vector<MarkerRows> RowsOf(const Bundle& bundle, size_t camera) {
  static_assert(kMaxObservationSize == 4);
  std::vector<MarkerRows> markers;
  const auto& observations = bundle.observations;
  for (size_t begin = 0, end = 0; begin < observations.size(); begin = end) {
    end = EndOfMarker(observations, begin);
    if (observations[begin].camera != static_cast<int>(camera)) continue;
    MarkerRows rows;
    for (size_t i = begin; i < end; ++i) {
      Row row{.sigma2 = std::pow(observations[i].seen.sigma, 2)};
      if (observations[i].used && Residual(bundle, observations[i], row.residual.data())) {
        rows.push_back(row);
      }
    }
    if (!rows.empty()) markers.push_back(std::move(rows));
  }
  return markers;
}

struct OwnVariance {
  double scale2 = 1, floor2 = 0;

  [[nodiscard]] double Of(double sigma2) const { return scale2 * sigma2 + floor2; }
};

// One squared residual and how much of it the fit has left, 0 to 1.
struct Square {
  double residual2, sigma2, left;
};

// How the residuals' variance follows the stated one: a weighted regression of residual^2 /
// dimension on [sigma^2, 1], whose weights 1 / variance^2 make it the Gaussian maximum-likelihood
// estimate. Sigmas that are all alike cannot tell scale and floor apart; then the floor is zero.
// Finally both are brought to the redundancy: sum of residual^2 / variance = redundancy.
OwnVariance FitVariance(const std::vector<Square>& squares, double dimension, double redundancy) {
  constexpr int kIterations = 20;
  constexpr double kAlike = 1e-3;  // relative spread of sigma^2 that tells them apart
  OwnVariance variance;
  for (int iteration = 0; iteration < kIterations; ++iteration) {
    double w = 0, ws = 0, wss = 0, wy = 0, wsy = 0;
    for (const auto& [residual2, sigma2, left] : squares) {
      const double v = variance.Of(sigma2), weight = left / (v * v);
      const double y = residual2 / (left * dimension);
      w += weight;
      ws += weight * sigma2;
      wss += weight * sigma2 * sigma2;
      wy += weight * y;
      wsy += weight * sigma2 * y;
    }
    const double determinant = w * wss - ws * ws;
    if (determinant <= kAlike * w * wss) {
      variance = {wsy / wss, 0};
      break;
    }
    variance = {(w * wsy - ws * wy) / determinant, (wss * wy - ws * wsy) / determinant};
    if (variance.scale2 <= 0) variance = {0, wy / w};
    if (variance.floor2 <= 0) variance = {wsy / wss, 0};
  }
  double sum = 0;
  for (const auto& [residual2, sigma2, left] : squares) sum += residual2 / variance.Of(sigma2);
  const double factor = sum > 0 ? sum / redundancy : 0;
  return {variance.scale2 * factor, variance.floor2 * factor};
}

// Weighted mean of a marker's residuals.
struct Mean {
  Eigen::Vector4d residual = Eigen::Vector4d::Zero();
  double information = 0;  // of its own noise
};

Mean MeanOf(const MarkerRows& rows, const OwnVariance& variance) {
  Mean mean;
  for (const Row& row : rows) {
    const double weight = 1 / variance.Of(row.sigma2);
    mean.residual += weight * row.residual;
    mean.information += weight;
  }
  mean.residual /= mean.information;
  return mean;
}

// From what the rows of a marker differ by.
OwnVariance FitDifferences(const std::vector<MarkerRows>& markers,
                           double dimension,
                           double redundancy) {
  constexpr int kIterations = 5;  // the weights of the means matter little
  OwnVariance variance;
  std::vector<Square> squares;
  for (int iteration = 0; iteration < kIterations; ++iteration) {
    squares.clear();
    for (const MarkerRows& rows : markers) {
      if (rows.size() < 2) continue;
      const Mean mean = MeanOf(rows, variance);
      for (const Row& row : rows) {
        squares.push_back({(row.residual - mean.residual).squaredNorm(),
                           row.sigma2,
                           1 - 1 / (variance.Of(row.sigma2) * mean.information)});
      }
    }
    variance = FitVariance(squares, dimension, redundancy);
    if (!(variance.scale2 + variance.floor2 > 0)) break;
  }
  return variance;
}

// Variance t^2 with which the squares of the means, over t^2 + 1 / information, sum to their
// redundancy; 0 when they are too small.
double CommonVariance(const std::vector<Mean>& means, double redundancy) {
  double largest = 0;
  const auto squares = [&](double common2) {
    double sum = 0;
    for (const Mean& mean : means) {
      sum += mean.residual.squaredNorm() / (common2 + 1 / mean.information);
      if (common2 == 0) largest += mean.residual.squaredNorm();
    }
    return sum;
  };
  if (squares(0) <= redundancy) return 0;
  double low = 0, high = largest / redundancy;
  for (int i = 0; i < 60; ++i) {
    const double middle = (low + high) / 2;
    (squares(middle) > redundancy ? low : high) = middle;
  }
  return high;
}

}  // namespace

CameraNoise EstimateCameraNoise(const Bundle& bundle, size_t camera, const PaidCoordinates& paid) {
  const auto dimension = static_cast<double>(bundle.cameras[camera].model->measured.size());
  const std::vector<MarkerRows> markers = RowsOf(bundle, camera);
  std::vector<Square> all;
  for (const MarkerRows& rows : markers) {
    for (const Row& row : rows) all.push_back({row.residual.squaredNorm(), row.sigma2, 1});
  }
  const double coordinates = dimension * static_cast<double>(all.size());
  const double of_means = dimension * static_cast<double>(markers.size());
  const double differences = coordinates - of_means - (paid.all - paid.by_means);
  const double means_left = of_means - paid.by_means;
  if (differences >= kLeastDegrees && means_left >= kLeastDegrees) {
    const OwnVariance own = FitDifferences(markers, dimension, differences);
    if (own.scale2 + own.floor2 > 0) {
      std::vector<Mean> means;
      means.reserve(markers.size());
      for (const MarkerRows& rows : markers) means.push_back(MeanOf(rows, own));
      const double common2 = CommonVariance(means, means_left);
      if (common2 > 0) return {std::sqrt(own.scale2), std::sqrt(own.floor2), std::sqrt(common2)};
    }
  }
  const OwnVariance together = FitVariance(all, dimension, coordinates - paid.all);
  return {std::sqrt(together.scale2), std::sqrt(together.floor2), 0};
}

}  // namespace plenocal
