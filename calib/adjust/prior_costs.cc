// SPDX-License-Identifier: Apache-2.0
#include "calib/adjust/prior_costs.h"

#include <algorithm>

#include "calib/adjust/parameter_blocks.h"

namespace plenocal::internal {

MarkerPrior::MarkerPrior(std::span<const double> nominal, double sigma)
    : nominal_(nominal.begin(), nominal.end()), sigma_(sigma) {
  set_num_residuals(static_cast<int>(nominal.size()));
  mutable_parameter_block_sizes()->push_back(kMarkerBlockSize);
}

bool MarkerPrior::Evaluate(double const* const* parameters,
                           double* residuals,
                           double** jacobians) const {
  const size_t size = nominal_.size();
  for (size_t i = 0; i < size; ++i) residuals[i] = (parameters[0][i] - nominal_[i]) / sigma_;
  if (jacobians != nullptr && jacobians[0] != nullptr) {
    std::fill_n(jacobians[0], size * kMarkerBlockSize, 0.0);
    for (size_t i = 0; i < size; ++i) jacobians[0][i * kMarkerBlockSize + i] = 1 / sigma_;
  }
  return true;
}

ParamPrior::ParamPrior(size_t size, size_t slot, ParamRule::Prior prior)
    : size_(size), slot_(slot), prior_(prior) {
  set_num_residuals(1);
  mutable_parameter_block_sizes()->push_back(static_cast<int>(size));
}

bool ParamPrior::Evaluate(double const* const* parameters,
                          double* residuals,
                          double** jacobians) const {
  residuals[0] = (parameters[0][slot_] - prior_.value) / prior_.sigma;
  if (jacobians != nullptr && jacobians[0] != nullptr) {
    std::fill_n(jacobians[0], size_, 0.0);
    jacobians[0][slot_] = 1 / prior_.sigma;
  }
  return true;
}

JitterPrior::JitterPrior(const Matrix6d& weight) : weight_(weight) {
  set_num_residuals(6);
  mutable_parameter_block_sizes()->push_back(6);
}

bool JitterPrior::Evaluate(double const* const* parameters,
                           double* residuals,
                           double** jacobians) const {
  Eigen::Map<Vector6d> residual(residuals);
  residual = weight_ * Eigen::Map<const Vector6d>(parameters[0]);
  if (jacobians != nullptr && jacobians[0] != nullptr) {
    Eigen::Map<Eigen::Matrix<double, 6, 6, Eigen::RowMajor>> J(jacobians[0]);
    J = weight_;
  }
  return true;
}

}  // namespace plenocal::internal
