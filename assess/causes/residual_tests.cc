// SPDX-License-Identifier: Apache-2.0
#include "assess/causes/residual_tests.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <span>

#include "calib/base/statistics.h"

namespace plenocal {

std::string FirstNames(const std::vector<std::string>& names) {
  constexpr size_t kMost = 5;
  const auto shown = std::span(names).first(std::min(kMost, names.size()));
  return fmt::format("{}{}", fmt::join(shown, ", "), names.size() > kMost ? ", ..." : "");
}

void ForEachResidual(const Bundle& bundle,
                     size_t camera,
                     const std::function<void(const BundleObservation& observation,
                                              const double* residual)>& visit) {
  const auto residuals = Residuals(bundle, camera);
  for (size_t i = 0; i < residuals.size(); ++i) {
    if (!std::isnan(residuals[i][0])) visit(bundle.observations[i], residuals[i].data());
  }
}

double SequenceSplit::Probability(double variance) const {
  const double degrees = static_cast<double>(all) - 2;
  const double noise = std::max(variance, within / degrees);
  const auto divisions = static_cast<double>(all - 2 * least + 1);
  return noise > 0 ? divisions * FTail(between / noise, 1, degrees) : 0;
}

SequenceSplit LargestSplit(
    const Eigen::MatrixXd& values,
    const Eigen::VectorXd& weights,
    Eigen::Index least,
    const std::function<bool(Eigen::Index, const Eigen::RowVectorXd&)>& accept) {
  const double all = weights.sum();
  const Eigen::MatrixXd centred =
      values.rowwise() - Eigen::RowVectorXd(weights.transpose() * values / all);
  const double squares = centred.rowwise().squaredNorm().dot(weights);
  SequenceSplit best{.within = squares, .step = {}, .all = values.rows(), .least = least};
  Eigen::RowVectorXd sum = Eigen::RowVectorXd::Zero(values.cols());
  double weight = 0;
  for (Eigen::Index k = 1; k + least <= values.rows(); ++k) {
    sum += weights[k - 1] * centred.row(k - 1);
    weight += weights[k - 1];
    // The means of both parts balance each other.
    const Eigen::RowVectorXd step = -sum * (1 / weight + 1 / (all - weight));
    const double between = sum.squaredNorm() * (1 / weight + 1 / (all - weight));
    if (k < least || between <= best.between || (accept && !accept(k, step))) continue;
    best.first = k;
    best.between = between;
    best.within = std::max(0.0, squares - between);
    best.step = step;
  }
  return best;
}

}  // namespace plenocal
