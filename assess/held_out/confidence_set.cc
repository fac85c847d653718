// SPDX-License-Identifier: Apache-2.0
#include "assess/held_out/confidence_set.h"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <random>

namespace plenocal {
namespace {

// Means over frames that are drawn with replacement: draws x models.
Eigen::MatrixXd BootstrapMeans(const Eigen::MatrixXd& losses) {
  constexpr Eigen::Index kDraws = 2000;
  std::mt19937 random(1);
  Eigen::MatrixXd weights = Eigen::MatrixXd::Zero(kDraws, losses.rows());
  const auto frames = static_cast<unsigned>(losses.rows());
  for (Eigen::Index draw = 0; draw < kDraws; ++draw) {
    for (unsigned i = 0; i < frames; ++i) weights(draw, random() % frames) += 1.0 / frames;
  }
  return weights * losses;
}

}  // namespace

std::vector<double> ConfidenceSetProbabilities(const Eigen::MatrixXd& losses, size_t folds) {
  const auto k = static_cast<double>(folds);
  const double overlap = std::sqrt(1 + k / (k - 1));
  const Eigen::RowVectorXd means = losses.colwise().mean();
  const Eigen::MatrixXd scatter = BootstrapMeans(losses).rowwise() - means;
  std::vector<double> probabilities(static_cast<size_t>(losses.cols()), 1.0);
  std::vector<Eigen::Index> left(probabilities.size());
  std::iota(left.begin(), left.end(), Eigen::Index{0});
  for (double least = 0; left.size() > 1;) {
    const Eigen::RowVectorXd distance = means(left).array() - means(left).mean();
    Eigen::ArrayXXd drawn = scatter(Eigen::all, left);
    drawn.colwise() -= drawn.rowwise().mean().eval();
    const Eigen::ArrayXXd sigma = drawn.square().colwise().mean().sqrt().max(1e-12);
    const Eigen::ArrayXXd t = distance.array() / (overlap * sigma);
    Eigen::Index worst = 0;
    const double largest = t.row(0).maxCoeff(&worst);
    const auto largest_drawn = (drawn.rowwise() / sigma.row(0)).rowwise().maxCoeff().eval();
    least = std::max(least, (largest_drawn >= largest).cast<double>().mean());
    probabilities[static_cast<size_t>(left[static_cast<size_t>(worst)])] = least;
    left.erase(left.begin() + worst);
  }
  return probabilities;
}

}  // namespace plenocal
