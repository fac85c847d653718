// SPDX-License-Identifier: Apache-2.0
//
// The bundle adjustment until noise and rejections no longer change.
#pragma once

#include <functional>
#include <string>
#include <vector>

#include "calib/adjust/bundle.h"
#include "calib/base/robust.h"
#include "calib/noise/uncertainty.h"

namespace plenocal {

struct SolveOptions {
  std::vector<double> typical_sigmas;  ///< per camera: `AssumedSigmas::typical`
  Loss loss = Loss::kHuber;
  std::function<bool()> go_on;  ///< called in each iteration; false stops (`Stopped` is thrown)
  /// False: the caller estimates it; `Solution::uncertainty` stays empty.
  bool estimate_uncertainty = true;
};

struct Solution {
  Uncertainty uncertainty;  ///< at the optimum
  bool converged = false;
  int iterations = 0;
  double rejection_threshold = 0;  ///< `Rejection::threshold`
};

/// Estimates unknowns, noise and jitter of the bundle and rejects outliers, in turns. Throws
/// `Error` of kind kJob when a camera's observations do not suffice or a solve fails.
Solution Solve(const SolveOptions& options, Bundle* bundle);

}  // namespace plenocal
