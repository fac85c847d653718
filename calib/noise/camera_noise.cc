// SPDX-License-Identifier: Apache-2.0
#include "calib/noise/camera_noise.h"

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <utility>
#include <vector>

#include "calib/adjust/rows.h"
#include "calib/base/statistics.h"

namespace plenocal {
namespace {

// Fewest differences, and fewest means: their variances are then known to 14 %.
constexpr double kLeastDegrees = 100;

using ResidualVector = Eigen::Matrix<double, kMaxObservationSize, 1>;

struct Row {
  ResidualVector residual = ResidualVector::Zero();
  double sigma2 = 0;  // assumed
};

// The used rows of one marker in one view.
using MarkerRows = std::vector<Row>;

std::vector<MarkerRows> RowsOf(const Bundle& bundle, size_t camera) {
  std::vector<MarkerRows> markers;
  const auto& observations = bundle.observations;
  const auto residuals = Residuals(bundle, camera);
  for (size_t begin = 0, end = 0; begin < observations.size(); begin = end) {
    end = EndOfMarker(observations, begin);
    if (observations[begin].camera != static_cast<int>(camera)) continue;
    MarkerRows rows;
    for (size_t i = begin; i < end; ++i) {
      if (!observations[i].used || std::isnan(residuals[i][0])) continue;
      rows.push_back({.residual = ResidualVector(residuals[i].data()),
                      .sigma2 = std::pow(observations[i].assumed_sigma, 2)});
    }
    if (!rows.empty()) markers.push_back(std::move(rows));
  }
  return markers;
}

// Variance of an observation's own noise by its assumed one.
struct OwnVariance {
  double scale2 = 1, additive2 = 0;

  [[nodiscard]] double Of(double sigma2) const { return scale2 * sigma2 + additive2; }
};

// One squared residual and how much of it the fit has left, 0 to 1.
struct Square {
  double residual2, sigma2, left;
};

// Dependence of the residuals' variance on the assumed one: a weighted regression of residual^2 /
// dimension on [sigma^2, 1], whose weights 1 / variance^2 make it the Gaussian maximum-likelihood
// estimate. Where all sigmas are alike, scale and additive part cannot be separated, and the latter
// is zero. Finally both are brought to the redundancy: sum of residual^2 / variance = redundancy.
OwnVariance FitVariance(const std::vector<Square>& squares, double dimension, double redundancy) {
  constexpr int kIterations = 20;
  constexpr double kAlike = 1e-3;  // relative spread of sigma^2 that separates them
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
    if (variance.additive2 <= 0) variance = {wsy / wss, 0};
  }
  double sum = 0;
  for (const auto& [residual2, sigma2, left] : squares) sum += residual2 / variance.Of(sigma2);
  const double factor = sum > 0 ? sum / redundancy : 0;
  return {variance.scale2 * factor, variance.additive2 * factor};
}

// Weighted mean of a marker's residuals.
struct Mean {
  ResidualVector residual = ResidualVector::Zero();
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

// From the differences between the rows of a marker.
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
    if (!(variance.scale2 + variance.additive2 > 0)) break;
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

// Smallest noise, px, with which the normal equations hold the markers' prior beside the images'
// information. The prior alone determines the target's position and size, and is lost in the
// rounding of the images' information on a marker.
double SmallestNoise(const Bundle& bundle, size_t camera) {
  if (!bundle.marker_freedom.HasTolerance()) return kSmallestNoise;
  // In units of the prior's information: of 16 digits two remain for the prior, one is lost to
  // sums.
  constexpr double kMostInformation = 1e13;
  const std::vector<double> squares = SquaresOfMarkerErrors(bundle, bundle.marker_freedom.Sigma());
  std::vector<double> sums(bundle.markers.size(), 0.0);  // at a noise of 1 px
  for (size_t i = 0; i < squares.size(); ++i) {
    const BundleObservation& observation = bundle.observations[i];
    if (!observation.used || observation.camera != static_cast<int>(camera)) continue;
    sums[static_cast<size_t>(observation.marker)] += squares[i];
  }
  return std::max(kSmallestNoise, std::sqrt(std::ranges::max(sums) / kMostInformation));
}

}  // namespace

std::vector<double> SquaresOfMarkerErrors(const Bundle& bundle, double marker_sigma) {
  std::vector<double> squares;
  for (const BundleObservation& observation : bundle.observations) {
    const auto c = static_cast<size_t>(observation.camera);
    const BundleCamera& camera = bundle.cameras[c];
    double residual[kMaxObservationSize];
    Eigen::Matrix<double, kMaxObservationSize, 3, Eigen::RowMajor> J;  // in standard deviations
    J.setZero();
    const bool projects =
        internal::Linearise(camera,
                            internal::ViewOf(bundle, static_cast<size_t>(observation.frame), c),
                            bundle.markers[static_cast<size_t>(observation.marker)].position,
                            observation,
                            {.residual = residual, .J_marker = J.data()});
    const double moved = marker_sigma * camera.noise.OwnSigma(observation.assumed_sigma);
    squares.push_back(projects ? J.squaredNorm() * moved * moved : 0);
  }
  return squares;
}

NoiseModel EstimateCameraNoise(const Bundle& bundle, size_t camera, const UsedDegrees& used) {
  const auto dimension = static_cast<double>(bundle.cameras[camera].model->measured.size());
  const std::vector<MarkerRows> markers = RowsOf(bundle, camera);
  std::vector<Square> all;
  for (const MarkerRows& rows : markers) {
    for (const Row& row : rows) all.push_back({row.residual.squaredNorm(), row.sigma2, 1});
  }
  const double coordinates = dimension * static_cast<double>(all.size());
  const double of_means = dimension * static_cast<double>(markers.size());
  const double differences = coordinates - of_means - (used.all - used.by_means);
  const double means_left = of_means - used.by_means;
  if (differences >= kLeastDegrees && means_left >= kLeastDegrees) {
    const OwnVariance own = FitDifferences(markers, dimension, differences);
    if (own.scale2 + own.additive2 > 0) {
      std::vector<Mean> means;
      means.reserve(markers.size());
      for (const MarkerRows& rows : markers) means.push_back(MeanOf(rows, own));
      const double common2 = CommonVariance(means, means_left);
      if (common2 > 0) return {std::sqrt(own.scale2), std::sqrt(own.additive2), std::sqrt(common2)};
    }
  }
  const OwnVariance together = FitVariance(all, dimension, coordinates - used.all);
  return {std::sqrt(together.scale2), std::sqrt(together.additive2), 0};
}

NoiseModel NoiseOfSigma(double sigma, double typical_sigma) {
  return {
      .detector_scale = std::clamp(sigma / typical_sigma, kSmallestNoise / typical_sigma, 1.0),
      .additive_sigma = std::sqrt(std::max(0.0, sigma * sigma - typical_sigma * typical_sigma))};
}

std::vector<double> UsedCoordinates(const Bundle& bundle) {
  std::vector<double> coordinates(bundle.cameras.size(), 0.0);
  for (const BundleObservation& observation : bundle.observations) {
    if (!observation.used) continue;
    const auto c = static_cast<size_t>(observation.camera);
    coordinates[c] += static_cast<double>(bundle.cameras[c].model->measured.size());
  }
  return coordinates;
}

std::vector<size_t> EstimateNoiseRobustly(const std::vector<bool>& frames,
                                          std::span<const double> typical_sigmas,
                                          Bundle* bundle) {
  // The unknowns absorb a part of the errors, but not all of them in any camera.
  constexpr double kLeastRedundancy = 0.1;  // part of the coordinates
  const std::vector<double> lengths = WeightedLengths(*bundle);
  std::vector<std::vector<double>> own(bundle->cameras.size());  // px
  double coordinates = 0;
  for (size_t i = 0; i < lengths.size(); ++i) {
    const BundleObservation& observation = bundle->observations[i];
    if (!frames[static_cast<size_t>(observation.frame)]) continue;
    const auto c = static_cast<size_t>(observation.camera);
    own[c].push_back(lengths[i] * bundle->cameras[c].noise.Sigma(observation.assumed_sigma));
    coordinates += static_cast<double>(bundle->cameras[c].model->measured.size());
  }
  double unknowns = 6.0 * static_cast<double>(std::count(frames.begin(), frames.end(), true));
  for (const BundleCamera& camera : bundle->cameras) {
    unknowns += static_cast<double>(camera.params.size());
  }
  if (bundle->EstimatesMarkers()) unknowns += 3.0 * static_cast<double>(bundle->markers.size());
  const double left = std::sqrt(std::max(kLeastRedundancy, 1 - unknowns / coordinates));
  std::vector<size_t> outside;
  for (size_t c = 0; c < own.size(); ++c) {
    if (own[c].empty()) continue;
    const double median = Median(std::move(own[c]));
    if (!std::isfinite(median)) {
      outside.push_back(c);
      continue;
    }
    const int dimension = static_cast<int>(bundle->cameras[c].model->measured.size());
    bundle->cameras[c].noise = NoiseOfSigma(
        median / std::sqrt(ChiSquareQuantile(dimension, 0.5)) / left, typical_sigmas[c]);
  }
  return outside;
}

double UpdateNoise(std::span<const double> typical_sigmas,
                   std::span<const UsedDegrees> used,
                   Bundle* bundle) {
  double change = 0;
  const std::vector<double> coordinates = UsedCoordinates(*bundle);
  for (size_t c = 0; c < bundle->cameras.size(); ++c) {
    if (coordinates[c] == 0) continue;
    NoiseModel& noise = bundle->cameras[c].noise;
    const double typical = typical_sigmas[c];
    const double before = noise.Sigma(typical), common_before = noise.common_sigma;
    constexpr double kLeastLeft = 1;  // degree of freedom, for a variance
    if (coordinates[c] - used[c].all >= kLeastLeft) {
      noise = EstimateCameraNoise(*bundle, c, used[c]);
    } else if (before < typical) {
      noise = NoiseOfSigma(typical, typical);
    }
    constexpr double kAlmostExact = 1e-3;  // px; no floor is as high
    if (noise.Sigma(typical) < kAlmostExact) {
      const double smallest = SmallestNoise(*bundle, c);
      if (noise.Sigma(typical) < smallest) noise = NoiseOfSigma(smallest, typical);
    }
    change = std::max({change,
                       std::abs(noise.Sigma(typical) / before - 1),
                       std::abs(noise.common_sigma - common_before) / before});
  }
  return change;
}

}  // namespace plenocal
