// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <memory>
#include <vector>

#include "assess/views/rig_knowledge.h"

namespace plenocal {

/// What one frame adds to a calibration.
struct FrameWorth {
  /// Standard error of the projection without and with it, px; infinite while something is not
  /// determined.
  double sigma_before = 0, sigma_after = 0;
  double share = 0;  ///< its gain over that of the best view; 0 where no view adds anything
};

/// Compares frames that are being taken with the view that `ChooseNextViews` finds best.
class FrameScale {
 public:
  /// Throws as `ChooseNextViews`.
  FrameScale(RigKnowledge rig, ViewTarget shape, int threads);
  FrameScale(FrameScale&&) noexcept;
  ~FrameScale();

  /// `views`: per camera the points of this frame, of markers that the rig has; the pose is one
  /// that they determine. Otherwise the frame adds nothing.
  [[nodiscard]] FrameWorth Weigh(const RigidTransform& T_rig_target,
                                 const std::vector<View>& views) const;
  /// The frame is one of the calibration's from now on: what it shows is worth less again.
  void Add(const RigidTransform& T_rig_target, const std::vector<View>& views);

 private:
  struct State;

  RigKnowledge rig_;
  RigKnowledge without_frames_;
  ViewTarget shape_;
  int threads_;
  std::unique_ptr<State> state_;
};

}  // namespace plenocal
