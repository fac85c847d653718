// SPDX-License-Identifier: Apache-2.0
//
// Points of several frames that have kept their distances, adjusted together: poses are free.
#pragma once

#include <map>
#include <vector>

#include "calib/space/point_fit.h"

namespace plenocal {

/// Found points of one frame by their numbers.
using PointsOfFrame = std::map<int, const SpacePoint*>;

struct CongruentPoints {
  /// In the frame of the first frame that is used. Their noise is correlated: it stands in the
  /// `frame_columns` columns of `shared`, and `noise` is 0.
  std::map<int, SpacePoint> points;
  std::vector<bool> used;  ///< frames: false where three points or more link none to the others
};

/// By generalised least squares of all points with their noise; the error of the calibration is
/// propagated. Empty for frames without points.
CongruentPoints AdjustCongruent(const std::vector<PointsOfFrame>& frames);

}  // namespace plenocal
