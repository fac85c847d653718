// SPDX-License-Identifier: Apache-2.0
//
// A motion near one time: the polynomial through poses before and after it.
#pragma once

#include <Eigen/Core>
#include <limits>
#include <span>

#include "calib/camera/rigid_transform.h"

namespace plenocal {

/// Weights of the values at some nodes in their least-squares polynomial at one place, and in its
/// derivative there.
struct PolynomialWeights {
  Eigen::VectorXd value, derivative;
};

/// A node at the distance d counts by 1 - (d / reach)^2, so that the polynomial is continuous in x
/// as nodes come and go; by default all count alike. REQUIRES: more nodes than `degree`, which
/// differ and are nearer than `reach`.
PolynomialWeights WeightsAt(double x,
                            std::span<const double> nodes,
                            int degree,
                            double reach = std::numeric_limits<double>::infinity());

}  // namespace plenocal
