// SPDX-License-Identifier: Apache-2.0
#include "assess/views/optimal_design.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>
#include <vector>

namespace plenocal {

Eigen::VectorXd Packed(const Eigen::MatrixXd& symmetric) {
  const Eigen::Index size = symmetric.rows();
  Eigen::VectorXd packed(size * (size + 1) / 2);
  for (Eigen::Index i = 0, k = 0; i < size; ++i) {
    for (Eigen::Index j = 0; j <= i; ++j) packed[k++] = symmetric(j, i);
  }
  return packed;
}

Eigen::VectorXd PackedTwice(const Eigen::MatrixXd& symmetric) {
  Eigen::MatrixXd twice = 2 * symmetric;
  twice.diagonal() /= 2;
  return Packed(twice);
}

Eigen::MatrixXd Unpacked(const Eigen::VectorXd& packed) {
  // n (n + 1) is between the squares of n and n + 1.
  const auto size = static_cast<Eigen::Index>(std::sqrt(2.0 * static_cast<double>(packed.size())));
  Eigen::MatrixXd symmetric(size, size);
  for (Eigen::Index i = 0, k = 0; i < size; ++i) {
    for (Eigen::Index j = 0; j <= i; ++j) symmetric(i, j) = symmetric(j, i) = packed[k++];
  }
  return symmetric;
}

double OptimalDesign::FewestViews(double goal) const {
  const double missing = trace * trace / goal - of_so_far;
  if (missing <= 0) return 0;
  return steepest > 0 ? missing / steepest : std::numeric_limits<double>::infinity();
}

OptimalDesign SolveDesign(const Eigen::MatrixXd& M,
                          const Eigen::MatrixXd& so_far,
                          const Eigen::Ref<const Eigen::MatrixXd>& views,
                          double count,
                          const Eigen::VectorXd& start) {
  constexpr double kGap = 0.003;  // of the trace
  constexpr int kMostSteps = 100, kSteps = 50;
  constexpr size_t kMoreViews = 30;  // that get a weight at once
  OptimalDesign design;
  design.weights = Eigen::VectorXd::Zero(views.cols());
  design.weights.head(start.size()) = start;
  bool has_weights = start.size() > 0;
  if (has_weights) design.weights *= count / start.sum();
  // Sets all but the weights and returns the loss of f per view.
  const auto evaluate = [&](const Eigen::Ref<const Eigen::MatrixXd>& columns,
                            const Eigen::VectorXd& weights) {
    const Eigen::LLT<Eigen::MatrixXd> factor(so_far + Unpacked(columns * weights));
    design.covariance = factor.solve(Eigen::MatrixXd::Identity(M.rows(), M.rows()));
    design.slope = design.covariance * M * design.covariance;
    design.trace = design.covariance.cwiseProduct(M).sum();
    design.of_so_far = design.slope.cwiseProduct(so_far).sum();
    Eigen::VectorXd losses = columns.transpose() * PackedTwice(design.slope);
    design.steepest = losses.maxCoeff();
    return losses;
  };
  for (int step = 0;; ++step) {
    const Eigen::VectorXd losses = evaluate(views, design.weights);
    if (has_weights && (step == kMostSteps || design.Gap(count) < kGap)) return design;
    // Only the steepest views and those with a weight are weighted anew.
    std::vector<Eigen::Index> chosen(static_cast<size_t>(views.cols()));
    std::iota(chosen.begin(), chosen.end(), Eigen::Index{0});
    std::ranges::sort(chosen, std::ranges::greater{}, [&](Eigen::Index i) { return losses[i]; });
    const double least = count / 1e4;
    size_t rank = 0;
    std::erase_if(
        chosen, [&](Eigen::Index i) { return rank++ >= kMoreViews && design.weights[i] < least; });
    const Eigen::MatrixXd columns = views(Eigen::all, chosen);
    Eigen::VectorXd weights = design.weights(chosen).cwiseMax(least);
    for (int i = 0; i < kSteps; ++i) {
      weights *= count / weights.sum();
      const Eigen::VectorXd of_chosen = evaluate(columns, weights);
      if (design.Gap(count) < kGap / 2) break;
      // Never raises f (Torsney 1983).
      weights.array() *= of_chosen.array().max(0).sqrt();
    }
    weights *= count / weights.sum();
    design.weights.setZero();
    design.weights(chosen) = weights;
    has_weights = true;
  }
}

}  // namespace plenocal
