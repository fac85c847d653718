// SPDX-License-Identifier: Apache-2.0
//
// Gain in information by a frame that is being taken, against that of the best view.
#pragma once

#include <memory>
#include <vector>

#include "assess/views/next_views.h"

namespace plenocal {

/// Gain of a calibration by one frame.
struct FrameInformationGain {
  /// Standard error of the projection without and with it, px; infinite while something is not
  /// determined.
  double sigma_before = 0, sigma_after = 0;
  double share = 0;  ///< its gain over that of the best view; 0 where no view adds anything
};

/// Compares frames that are being taken with the best view.
class FrameGainEvaluator {
 public:
  /// `best`: what `ChooseNextViews` suggests for the rig.
  FrameGainEvaluator(const RigEstimate& rig, const ViewTarget& shape, const NextViews& best);
  FrameGainEvaluator(FrameGainEvaluator&&) noexcept;
  FrameGainEvaluator& operator=(FrameGainEvaluator&&) noexcept;
  ~FrameGainEvaluator();

  /// `views`: per camera the points of this frame, of markers that the rig has; the pose is one
  /// that they determine. Otherwise the frame adds nothing.
  [[nodiscard]] FrameInformationGain Evaluate(const RigidTransform& T_rig_target,
                                              const std::vector<View>& views) const;

 private:
  struct State;
  std::unique_ptr<State> state_;
};

}  // namespace plenocal
