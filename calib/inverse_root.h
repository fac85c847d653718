// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>

namespace plenocal {

/// N with N N' the inverse of a symmetric, positive semidefinite matrix where it has one: as many
/// columns as the matrix with unit diagonal has eigenvalues above 1e-10.
Eigen::MatrixXd InverseRoot(const Eigen::MatrixXd& V);

}  // namespace plenocal
