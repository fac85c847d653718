// SPDX-License-Identifier: Apache-2.0
#include "calib/rig/local_polynomial.h"

#include "calib/base/linear_algebra.h"

namespace plenocal {

PolynomialWeights WeightsAt(double x, std::span<const double> nodes, int degree, double reach) {
  const Eigen::ArrayXd away =
      Eigen::Map<const Eigen::ArrayXd>(nodes.data(), static_cast<Eigen::Index>(nodes.size())) - x;
  const double unit = away.abs().maxCoeff();
  const Eigen::VectorXd weights = (1 - (away / reach).square()).sqrt();
  Eigen::MatrixXd powers(away.size(), degree + 1);
  powers.col(0) = weights;
  for (Eigen::Index k = 1; k <= degree; ++k) {
    powers.col(k) = powers.col(k - 1).array() * away / unit;
  }
  const Eigen::MatrixXd fit = PseudoInverse(powers) * weights.asDiagonal();
  return {fit.row(0), fit.row(1) / unit};
}

}  // namespace plenocal
