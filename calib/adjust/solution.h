// SPDX-License-Identifier: Apache-2.0
//
// Options and summary of an adjustment.
#pragma once

#include <functional>
#include <string>

#include "calib/base/robust.h"

namespace plenocal {

struct AdjustOptions {
  Loss loss = Loss::kNone;
  /// Width of the loss in sigmas of one observation (length of its weighted residual vector).
  double loss_width = 3;
  int max_iterations = 100;
  /// The solve has converged when a step lowers the cost by less than this part of it.
  double cost_tolerance = 1e-10;
  bool near_optimum = false;  ///< the start is that of an earlier solve of nearly the same problem
  /// Called after every iteration with its number and cost; false stops the solve.
  std::function<bool(int iteration, double cost)> on_iteration;
};

struct AdjustSummary {
  bool usable = false;     ///< the state is at least as good as before
  bool converged = false;  ///< no further improvement was possible
  bool stopped = false;    ///< by `on_iteration`
  int iterations = 0;
  double cost_before = 0;  ///< at the start, half the (robustified) sum of squares
  double cost = 0;         ///< at the end
  std::string message;
};

namespace internal {

/// The first trust region is so large that the first step is Gauss-Newton's; near the optimum, that
/// it is along directions which are hardly determined as well.
inline double FirstTrustRegion(const AdjustOptions& options) {
  return options.near_optimum ? 1e8 : 1e6;
}
}  // namespace internal
}  // namespace plenocal
