// SPDX-License-Identifier: Apache-2.0
#include "calib/own_noise.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "calib/median.h"

namespace plenocal {

void AddPoints(std::span<const Observation> observations, std::vector<SeenPoint>* points) {
  std::map<int, SeenPoint> by_marker;
  for (const Observation& seen : observations) by_marker[seen.marker].push_back(&seen);
  for (auto& [marker, seen] : by_marker) points->push_back(std::move(seen));
}

std::map<int, KindNoise> NoiseByKind(std::span<const SeenPoint> points, OwnFit fit) {
  constexpr int kIterations = 10;
  constexpr double kWidth = 5;  // sigmas of one coordinate; of Gaussian noise one in a million
  std::map<int, KindNoise> noise;
  std::vector<double> weights;
  std::vector<OwnResidual> residuals;
  for (int iteration = 0; iteration < kIterations; ++iteration) {
    struct Sums {
      double squared = 0, redundancy = 0;
      std::vector<double> relative;  // squared residual for its redundancy
    };
    std::map<int, Sums> sums;
    for (const SeenPoint& point : points) {
      weights.clear();
      for (const Observation* seen : point) {
        const auto known = noise.find(seen->kind);
        weights.push_back(known == noise.end() ? 1 : 1 / std::pow(known->second.sigma, 2));
      }
      residuals.resize(point.size());
      fit(point, weights, residuals.data());
      for (size_t i = 0; i < point.size(); ++i) {
        const auto& [squared, redundancy] = residuals[i];
        if (!(redundancy > 0)) continue;
        Sums& of_kind = sums[point[i]->kind];
        const auto known = noise.find(point[i]->kind);
        if (known == noise.end()) {
          of_kind.relative.push_back(squared / redundancy);
        } else if (squared > kWidth * kWidth * redundancy * std::pow(known->second.sigma, 2)) {
          continue;
        }
        of_kind.squared += squared;
        of_kind.redundancy += redundancy;
      }
    }
    for (auto& [kind, of_kind] : sums) {
      // First a scale that outliers do not move: nearly the median of chi-square with two degrees
      // of freedom, over two.
      const double variance = iteration == 0 ? Median(of_kind.relative) / std::log(2.0)
                                             : of_kind.squared / of_kind.redundancy;
      if (variance > 0) noise[kind] = {std::sqrt(variance), of_kind.redundancy};
    }
  }
  return noise;
}

double Floor::Coordinate() const { return std::sqrt(squared / redundancy); }
double Floor::Length() const { return std::sqrt(dimension) * Coordinate(); }

Floor FloorOf(const Bundle& bundle,
              size_t camera,
              const std::function<bool(const BundleObservation&)>& include) {
  const CameraModel& model = *bundle.cameras[camera].model;
  Floor floor{.dimension = static_cast<int>(model.measured.size())};
  if (model.own_fit == nullptr) return floor;
  SeenPoint point;
  std::vector<OwnResidual> residuals;
  const auto& observations = bundle.observations;
  for (size_t begin = 0, end = 0; begin < observations.size(); begin = end) {
    const BundleObservation& first = observations[begin];
    point.clear();
    end = EndOfMarker(observations, begin);
    for (size_t i = begin; i < end; ++i) {
      if (include(observations[i])) point.push_back(&observations[i].seen);
    }
    if (first.camera != static_cast<int>(camera) || point.empty()) continue;
    residuals.resize(point.size());
    model.own_fit(point, std::vector<double>(point.size(), 1.0), residuals.data());
    for (const OwnResidual& residual : residuals) {
      floor.squared += residual.squared;
      floor.redundancy += residual.redundancy;
    }
  }
  return floor;
}

}  // namespace plenocal
