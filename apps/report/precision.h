// SPDX-License-Identifier: Apache-2.0
//
// What the uncertainty of a camera's parameters means for its use.
#pragma once

#include <vector>

#include "apps/report/residual_sections.h"
#include "apps/report/results.h"

namespace plenocal {

/// Uncertainty of the projection over the image of points at one distance.
struct ProjectionMap {
  double distance = 0;  ///< of the points from the camera, m
  ImageGrid grid;
  /// Per cell: standard deviation of the projection in its worst direction, px; NaN where the model
  /// says nothing.
  std::vector<double> sigma;
};

/// Maps at the nearest, the median and the farthest distance of the used points and at ten times
/// the farthest. Only the parameters' errors count, after the best rigid motion of the camera's
/// frame, where and how far the points were seen, has been taken off them: an error that a turn of
/// the frame undoes is part of every pose, not of the camera (as mrcal has it). Empty without a
/// covariance.
std::vector<ProjectionMap> ProjectionMaps(const Results& results, size_t camera);

/// How well one camera alone measures the distance of a marker that it sees in one image.
struct DistancePrecision {
  double distance = 0;     ///< m
  double calibration = 0;  ///< sigma from the parameters' errors, m
  double noise = 0;        ///< sigma from the noise of the marker's own observations, m
};

/// Of markers that the camera saw through several micro lenses, at most `most`, every k-th, by
/// distance. Empty when the camera sees a marker only once in an image.
std::vector<DistancePrecision> DistancePrecisions(const Results& results,
                                                  size_t camera,
                                                  size_t most);

}  // namespace plenocal
