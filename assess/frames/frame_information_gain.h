// SPDX-License-Identifier: Apache-2.0
//
// Gain in information by a frame that is being taken, against that of the best view.
#pragma once

#include <memory>
#include <vector>

#include "assess/views/rig_estimate.h"

namespace plenocal {

/// Gain of a calibration by one frame.
struct FrameInformationGain {
  /// Standard error of the projection without and with it, px; infinite while something is not
  /// determined.
  double sigma_before = 0, sigma_after = 0;
  double share = 0;  ///< its gain over that of the best view; 0 where no view adds anything
};

/// Compares frames that are being taken with the view that `ChooseNextViews` finds best.
class FrameGainEvaluator {
 public:
  /// Throws as `ChooseNextViews`.
  FrameGainEvaluator(RigEstimate rig, ViewTarget shape, int threads);
  FrameGainEvaluator(FrameGainEvaluator&&) noexcept;
  ~FrameGainEvaluator();

  /// `views`: per camera the points of this frame, of markers that the rig has; the pose is one
  /// that they determine. Otherwise the frame adds nothing.
  [[nodiscard]] FrameInformationGain Evaluate(const RigidTransform& T_rig_target,
                                              const std::vector<View>& views) const;
  /// The frame is one of the calibration's from now on: what it shows adds less again.
  void Add(const RigidTransform& T_rig_target, const std::vector<View>& views);

 private:
  struct State;

  RigEstimate rig_;
  RigEstimate without_frames_;
  ViewTarget shape_;
  int threads_;
  std::unique_ptr<State> state_;
};

}  // namespace plenocal
