// SPDX-License-Identifier: Apache-2.0
#include "calib/noise/replicate_noise.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <optional>
#include <utility>

#include "calib/base/statistics.h"

namespace plenocal {
namespace {

// Sums over the observations of one lens type.
struct Sums {
  double squared = 0, redundancy = 0;
  std::vector<double> relative;  // squared residual over its redundancy, first iteration only
};

// Variance of an observation by the noise known so far; none in the first iteration.
std::optional<double> KnownVariance(const std::map<int, LensTypeNoise>& noise,
                                    const Observation& seen) {
  const auto known = noise.find(seen.lens_type);
  if (known == noise.end()) return std::nullopt;
  return std::pow(known->second.sigma, 2);
}

// Fits all replicates with weights by `noise` and sums their residuals.
std::map<int, Sums> SumResiduals(std::span<const Replicates> replicates,
                                 const std::map<int, LensTypeNoise>& noise,
                                 ReplicateFit fit) {
  constexpr double kWidth = 5;  // sigmas of one coordinate; of Gaussian noise one in a million
  std::map<int, Sums> sums;
  std::vector<double> weights;
  std::vector<ReplicateResidual> residuals;
  for (const Replicates& of_marker : replicates) {
    weights.clear();
    for (const Observation* seen : of_marker) {
      const std::optional<double> variance = KnownVariance(noise, *seen);
      weights.push_back(variance ? 1 / *variance : 1);
    }
    residuals.resize(of_marker.size());
    fit(of_marker, weights, residuals.data());
    for (size_t i = 0; i < of_marker.size(); ++i) {
      const auto& [squared, redundancy] = residuals[i];
      if (!(redundancy > 0)) continue;
      Sums& of_type = sums[of_marker[i]->lens_type];
      const std::optional<double> variance = KnownVariance(noise, *of_marker[i]);
      if (!variance) {
        of_type.relative.push_back(squared / redundancy);
      } else if (squared > kWidth * kWidth * redundancy * *variance) {
        continue;
      }
      of_type.squared += squared;
      of_type.redundancy += redundancy;
    }
  }
  return sums;
}

}  // namespace

void AddReplicates(std::span<const Observation> observations, std::vector<Replicates>* replicates) {
  std::map<int, Replicates> by_marker;
  for (const Observation& seen : observations) by_marker[seen.marker].push_back(&seen);
  for (auto& [marker, seen] : by_marker) replicates->push_back(std::move(seen));
}

std::map<int, LensTypeNoise> NoiseByLensType(std::span<const Replicates> replicates,
                                             ReplicateFit fit) {
  constexpr int kIterations = 10;
  std::map<int, LensTypeNoise> noise;
  for (int iteration = 0; iteration < kIterations; ++iteration) {
    for (const auto& [lens_type, sums] : SumResiduals(replicates, noise, fit)) {
      // First a scale that outliers do not move: nearly the median of chi-square with two degrees
      // of freedom, over two.
      const double variance =
          iteration == 0 ? Median(sums.relative) / std::log(2.0) : sums.squared / sums.redundancy;
      if (variance > 0) noise[lens_type] = {std::sqrt(variance), sums.redundancy};
    }
  }
  return noise;
}

NoiseFloor EstimateNoiseFloor(const Bundle& bundle,
                              size_t camera,
                              const std::function<bool(const BundleObservation&)>& include) {
  const CameraModel& model = *bundle.cameras[camera].model;
  NoiseFloor floor;
  if (model.replicate_fit == nullptr) return floor;
  double squared = 0;        // sum of the squared residuals of unweighted fits, px^2
  Eigen::MatrixXd products;  // of what the fits leave of coordinates and terms of higher order
  Replicates replicates;
  std::vector<Observation> seen;  // of the replicates
  std::vector<ReplicateResidual> residuals;
  const auto& observations = bundle.observations;
  for (size_t begin = 0, end = 0; begin < observations.size(); begin = end) {
    const BundleObservation& first = observations[begin];
    replicates.clear();
    seen.clear();
    end = EndOfMarker(observations, begin);
    if (first.camera != static_cast<int>(camera)) continue;
    for (size_t i = begin; i < end; ++i) {
      if (!include(observations[i])) continue;
      seen.push_back(WithoutDisplacement(observations[i], bundle.cameras[camera]));
    }
    if (seen.empty()) continue;
    for (const Observation& one : seen) replicates.push_back(&one);
    residuals.resize(replicates.size());
    model.replicate_fit(replicates, std::vector<double>(replicates.size(), 1.0), residuals.data());
    for (const ReplicateResidual& residual : residuals) {
      squared += residual.squared;
      floor.redundancy += residual.redundancy;
    }
    if (model.replicate_terms == nullptr) continue;
    const Eigen::MatrixXd rows =
        model.replicate_terms(bundle.cameras[camera].params.data(), replicates);
    if (products.size() == 0) products.setZero(rows.cols(), rows.cols());
    if (rows.size() > 0) products += rows.transpose() * rows;
  }
  if (!(floor.redundancy > 0)) return floor;
  floor.coordinate = std::sqrt(squared / floor.redundancy);
  const double by_length = std::sqrt(static_cast<double>(model.measured.size()));
  floor.length = by_length * floor.coordinate;
  const Eigen::Index terms = products.cols() - 1;
  if (!(terms > 0 && floor.redundancy > static_cast<double>(terms))) return floor;
  // Their sizes differ by orders of magnitude.
  const Eigen::VectorXd scale = products.diagonal().cwiseMax(1e-300).cwiseSqrt().cwiseInverse();
  products = scale.asDiagonal() * products * scale.asDiagonal();
  const Eigen::VectorXd by_terms = products.col(0).tail(terms);
  const double explained =
      by_terms.dot(products.bottomRightCorner(terms, terms).ldlt().solve(by_terms));
  floor.third_order = by_length * std::sqrt(std::max(0.0, 1 - explained) * squared /
                                            (floor.redundancy - static_cast<double>(terms)));
  return floor;
}

}  // namespace plenocal
