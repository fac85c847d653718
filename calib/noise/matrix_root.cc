// SPDX-License-Identifier: Apache-2.0
#include "calib/noise/matrix_root.h"

#include "calib/base/linear_algebra.h"

namespace plenocal {
namespace {

// V is D E D with `size` the diagonal of D and `spectrum` that of E, whose diagonal is 1 (or 0).
struct Scaled {
  Eigen::VectorXd size, inverse_size;
  SymmetricEigen spectrum;

  explicit Scaled(const Eigen::MatrixXd& V)
      : size(V.diagonal().cwiseMax(0).cwiseSqrt()),
        inverse_size((size.array() > 0).select(size.cwiseInverse(), 0)),
        spectrum(DecomposeSymmetric(
            Eigen::MatrixXd(inverse_size.asDiagonal() * V * inverse_size.asDiagonal()))) {}
};

}  // namespace

Eigen::MatrixXd Root(const Eigen::MatrixXd& V) {
  if (V.rows() == 0) return V;
  const Scaled scaled(V);
  return scaled.size.asDiagonal() * scaled.spectrum.vectors *
         scaled.spectrum.values.cwiseMax(0).cwiseSqrt().asDiagonal();
}

Eigen::MatrixXd InverseRoot(const Eigen::MatrixXd& V) {
  constexpr double kRankTolerance = 1e-10;
  if (V.rows() == 0) return V;
  const Scaled scaled(V);
  const Eigen::VectorXd& eigenvalues = scaled.spectrum.values;
  const auto rank = (eigenvalues.array() > kRankTolerance).count();  // the last ones
  return scaled.inverse_size.asDiagonal() * scaled.spectrum.vectors.rightCols(rank) *
         eigenvalues.tail(rank).cwiseSqrt().cwiseInverse().asDiagonal();
}

}  // namespace plenocal
