// SPDX-License-Identifier: Apache-2.0
#include "calib/noise/matrix_root.h"

namespace plenocal {

UnitSpectrum::UnitSpectrum(const Eigen::MatrixXd& V)
    : scale((V.diagonal().array() > 0)
                .select(V.diagonal().cwiseMax(0).cwiseSqrt().cwiseInverse(), 1)),
      eigen(DecomposeSymmetric(Eigen::MatrixXd(scale.asDiagonal() * V * scale.asDiagonal()))) {}

Eigen::MatrixXd Root(const Eigen::MatrixXd& V) {
  if (V.rows() == 0) return V;
  const auto& [scale, eigen] = UnitSpectrum(V);
  return scale.cwiseInverse().asDiagonal() * eigen.vectors *
         eigen.values.cwiseMax(0).cwiseSqrt().asDiagonal();
}

Eigen::MatrixXd InverseRoot(const Eigen::MatrixXd& V) {
  constexpr double kRankTolerance = 1e-10;
  if (V.rows() == 0) return V;
  const auto& [scale, eigen] = UnitSpectrum(V);
  const auto rank = (eigen.values.array() > kRankTolerance).count();  // the last ones
  return scale.asDiagonal() * eigen.vectors.rightCols(rank) *
         eigen.values.tail(rank).cwiseSqrt().cwiseInverse().asDiagonal();
}

}  // namespace plenocal
