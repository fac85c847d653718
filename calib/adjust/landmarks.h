// SPDX-License-Identifier: Apache-2.0
//
// Landmarks estimated one at a time, all else fixed.
#pragma once

#include <span>

#include "calib/adjust/bundle.h"

namespace plenocal {

/// Normal equations of one landmark's position: H delta = -g.
struct LandmarkEquations {
  Eigen::Matrix3d H = Eigen::Matrix3d::Zero();
  Eigen::Vector3d g = Eigen::Vector3d::Zero();
};

/// Normal equations of these observations (indices), used or not, that project. `width` is that of
/// Huber's loss, sigmas.
LandmarkEquations LineariseLandmark(const Bundle& bundle,
                                    std::span<const size_t> observations,
                                    double width);

/// Moves a landmark to the optimum of all its observations while all else stays: a few robust
/// Gauss-Newton steps from a position that is nearly right.
void AdjustLandmark(std::span<const size_t> observations, Bundle* bundle);

/// Indices of the observations of each marker.
std::vector<std::vector<size_t>> ObservationsOfMarkers(const Bundle& bundle);

}  // namespace plenocal
