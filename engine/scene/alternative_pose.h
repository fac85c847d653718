// SPDX-License-Identifier: Apache-2.0
//
// A second pose that landmarks agree on which contradict the first: of repeated structure, as equal
// windows, or of an object that has moved.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "engine/scene/scene_start.h"

namespace plenocal {

struct AlternativePose {
  size_t agreeing = 0;       ///< landmarks that agree with the present pose
  size_t contradicting = 0;  ///< landmarks that contradict it and agree with the alternative
  double distance = 0;       ///< of the two positions of the rig, m
  double angle = 0;          ///< of the two orientations, rad

  /// So many contradict that the majority does not decide. Points of one object err together: the
  /// scene counts as 16 parts, of which one may have moved. Two of 16 deviate from equal chances by
  /// less than a false alarm in 1000 allows (binomial distribution: 0.0021; one: 0.0003).
  [[nodiscard]] bool IsAmbiguous() const { return 8 * contradicting >= agreeing + contradicting; }
  /// "80 of 200 common points contradict this pose and agree on another, 1.5 m and 2 degrees away".
  [[nodiscard]] std::string Text() const;
};

/// Of the poses of `frames`, by the landmarks with a position in `state`. Each frame is searched
/// for itself: over a long segment the error of the path between frames exceeds `limit`, the
/// residual below which an observation agrees, px. Nothing when in no frame more landmarks agree on
/// another pose than by chance. Distance and angle are those of the frame where most agree.
std::optional<AlternativePose> FindAlternativePose(const SceneState& state,
                                                   const std::vector<size_t>& frames,
                                                   double limit);

}  // namespace plenocal
