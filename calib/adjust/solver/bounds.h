// SPDX-License-Identifier: Apache-2.0
//
// Bounds of parameters by an active set: a solve without bounds, then parameters that left theirs
// are fixed there and the solve is repeated.
#pragma once

#include <ceres/problem.h>

#include <vector>

#include "calib/adjust/solver/parameter_blocks.h"

namespace plenocal::internal {

/// Lets the solver estimate the parameters of a block that are neither fixed nor at a bound.
void EstimateFree(const IntrinsicsBlock& block, ceres::Problem* problem);

/// One step of the active set after a solve; returns whether another solve is needed.
class ActiveSet {
 public:
  /// `blocks` take part in `problem`; the unknowns must be within their bounds.
  ActiveSet(std::vector<IntrinsicsBlock*> blocks, Unknowns* unknowns, ceres::Problem* problem);

  /// Goes back, when parameters have left their bounds, towards the unknowns before the solve until
  /// the first of them is at its bound, and fixes it there. Otherwise releases those at bounds
  /// whose gradient points inside. False when nothing remains to be done.
  bool Update();

 private:
  // A parameter that has left its bounds, and the part of the step that it may go.
  struct Leaver {
    IntrinsicsBlock* block = nullptr;
    size_t slot = 0;
    double part = 1;
  };
  [[nodiscard]] Leaver FirstLeaver() const;
  void StopAtBound(const Leaver& leaver);
  bool ReleaseThoseThatGoInside();

  std::vector<IntrinsicsBlock*> blocks_;
  Unknowns& unknowns_;
  ceres::Problem& problem_;
  std::vector<double> feasible_;  // values of the unknowns before the solve
  int most_passes_ = 0;
  int passes_ = 0;
};

}  // namespace plenocal::internal
