// SPDX-License-Identifier: Apache-2.0
#include "detectors/depth_shift.h"

#include <Eigen/Dense>
#include <cmath>

namespace plenocal::internal {
namespace {

/// What the micro images of one marker say of ln v, less what the drawing had.
struct Growth {
  Eigen::Vector2d weights;  ///< as of `DepthLine`
  double value, precision;
};

Growth GrowthOf(std::span<const MicroObservation> run, const DepthLine& line) {
  // About the means, which are the marker's place.
  Eigen::Vector2d place(0, 0), slope(0, 0);
  double weights = 0;
  for (const MicroObservation& o : run) {
    const double weight = 1 / (o.seen.sigma * o.seen.sigma);
    place += weight * o.U0();
    slope += weight * o.U0ByInverseDepth();
    weights += weight;
  }
  double information = 0, right = 0;
  for (const MicroObservation& o : run) {
    const Eigen::Vector2d by = (o.U0ByInverseDepth() - slope / weights) / o.seen.sigma;
    information += by.squaredNorm();
    right += by.dot(o.U0() - place / weights) / o.seen.sigma;
  }
  const double z = run.front().inverse_depth;
  return {line.At(z), -right / (information * z), information * z * z};
}

/// ln v less what the drawings had, at the nearest and at the farthest marker.
Eigen::Vector2d FindGrowth(const std::vector<Growth>& of_markers) {
  constexpr int kRounds = 6;  // of reweighting
  // Matching is right to some parts in a hundred, also where few micro images say anything.
  constexpr double kPrior = 0.02;
  Eigen::Vector2d growth(0, 0);
  double mean_square = 1;  // of the residuals, in sigmas
  for (int round = 0; round < kRounds; ++round) {
    Eigen::Matrix2d information = Eigen::Matrix2d::Identity() / (kPrior * kPrior);
    Eigen::Vector2d right(0, 0);
    double squares = 0, weights = 0;
    for (const Growth& one : of_markers) {
      const double rest = std::sqrt(one.precision) * (one.value - one.weights.dot(growth));
      const double robust = round == 0 ? 1 : CauchyWeight(rest, mean_square);
      information += robust * one.precision * one.weights * one.weights.transpose();
      right += robust * one.precision * one.value * one.weights;
      squares += robust * rest * rest;
      weights += robust;
    }
    growth = information.ldlt().solve(right);
    if (squares > 0) mean_square = squares / weights;
  }
  return growth;
}

}  // namespace

void RemoveDepthShifts(std::vector<MicroView>* views) {
  const DepthLine line(*views);
  std::vector<Growth> of_markers;
  for (const auto& run : RunsOf(*views)) of_markers.push_back(GrowthOf(run, line));
  const Eigen::Vector2d growth = FindGrowth(of_markers);
  if (!growth.allFinite()) return;
  for (MicroView& view : *views) {
    for (MicroObservation& o : view) o.Move(line.At(o.inverse_depth).dot(growth) * o.by_depth);
  }
}

}  // namespace plenocal::internal
