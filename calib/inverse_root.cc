// SPDX-License-Identifier: Apache-2.0
#include "calib/inverse_root.h"

#include <Eigen/Eigenvalues>

namespace plenocal {

Eigen::MatrixXd InverseRoot(const Eigen::MatrixXd& V) {
  constexpr double kRankTolerance = 1e-10;
  if (V.rows() == 0) return V;
  const Eigen::VectorXd diagonal = V.diagonal();
  const Eigen::VectorXd scale =
      (diagonal.array() > 0).select(diagonal.cwiseSqrt().cwiseInverse(), 0);
  const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> spectrum(scale.asDiagonal() * V *
                                                                scale.asDiagonal());
  const auto rank = (spectrum.eigenvalues().array() > kRankTolerance).count();  // the last ones
  return scale.asDiagonal() * spectrum.eigenvectors().rightCols(rank) *
         spectrum.eigenvalues().tail(rank).cwiseSqrt().cwiseInverse().asDiagonal();
}

}  // namespace plenocal
