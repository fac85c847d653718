// SPDX-License-Identifier: Apache-2.0
//
// Weights of a robust loss, and the common noise of a marker's observations, applied to residuals.
#pragma once

#include "calib/adjust/linearise.h"
#include "calib/base/robust.h"

namespace plenocal::internal {

/// A robust loss of each observation; `width` in sigmas of all its noise.
struct RobustLoss {
  Loss loss = Loss::kNone;
  double width = 0;
};

/// Scales an observation's residual r so that half its square is the loss, r' = f(s^2) r, and its
/// derivatives accordingly: J' = (f I + 2 f' r r') J, where s is the length of r in sigmas of all
/// noise. Applied to the residual itself, not by ceres::LossFunction, because that acts on whole
/// residual blocks and one block holds several observations.
void Robustify(const RobustLoss& loss,
               const BundleCamera& camera,
               double assumed_sigma,
               const LinearisedRows& out);

/// Sets the derivatives of an observation of `camera` to zero.
void ClearDerivatives(const BundleCamera& camera, const LinearisedRows& out);

}  // namespace plenocal::internal
