// SPDX-License-Identifier: Apache-2.0
#include "calib/files/checks/correlation_check.h"

#include <fmt/format.h>

#include <Eigen/Cholesky>
#include <cmath>

#include "calib/base/linear_algebra.h"

namespace plenocal {

std::optional<std::string> CorrelationDefect(const Eigen::MatrixXd& matrix,
                                             std::span<const std::string> names,
                                             double rounding) {
  const auto of = [&](Eigen::Index i, Eigen::Index j) {
    return fmt::format("the correlation of {} and {}",
                       names[static_cast<size_t>(i)],
                       names[static_cast<size_t>(j)]);
  };
  const Eigen::Index count = matrix.rows();
  for (Eigen::Index i = 0; i < count; ++i) {
    if (!(std::abs(matrix(i, i) - 1) <= rounding) && !matrix.row(i).isZero(0)) {
      return fmt::format("{} is {}, not 1", of(i, i), matrix(i, i));
    }
    for (Eigen::Index j = 0; j < count; ++j) {
      if (i != j && !(std::abs(matrix(i, j)) <= 1 + rounding)) {
        return fmt::format("{} is {}, which is not from -1 to 1", of(i, j), matrix(i, j));
      }
      if (std::abs(matrix(i, j) - matrix(j, i)) > 3 * rounding) {
        return fmt::format(
            "{} is {} in one place and {} in the other", of(i, j), matrix(i, j), matrix(j, i));
      }
    }
  }
  // Errors of the numbers change an eigenvalue by no more than those of one row together.
  const double least = -rounding * static_cast<double>(count);
  const Eigen::LLT<Eigen::MatrixXd> root(matrix - least * Eigen::MatrixXd::Identity(count, count));
  if (root.info() == Eigen::Success) return std::nullopt;
  const SymmetricEigen spectrum = DecomposeSymmetric(matrix);
  if (!(spectrum.values[0] < least)) return std::nullopt;
  // The pair that makes the variance of this combination of unknowns negative.
  const Eigen::VectorXd v = spectrum.vectors.col(0);
  Eigen::MatrixXd parts = v.asDiagonal() * matrix * v.asDiagonal();
  parts.diagonal().setZero();
  Eigen::Index i = 0, j = 0;
  parts.minCoeff(&i, &j);
  return fmt::format(
      "{} contradicts those with others: a combination of the unknowns would have a "
      "negative variance ({:.3g})",
      of(i, j),
      spectrum.values[0]);
}

}  // namespace plenocal
