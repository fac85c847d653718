// SPDX-License-Identifier: Apache-2.0
//
// Points whose place on the plane is one of several, and points that follow two maps.
#pragma once

#include <Eigen/Core>
#include <vector>

#include "assess/target/plane_map.h"

namespace plenocal {

/// An image point and the places on the plane where it may be; `image` and `scale` as in
/// `PlaneMap::Pairs`.
struct PlaneChoice {
  Eigen::Vector2d image;
  double scale = 1;
  const std::vector<Eigen::Vector2d>* places = nullptr;
};

/// Each point with the place that agrees best with the others: the homography of four points with
/// most others near it (random samples, M. A. Fischler and R. C. Bolles, "Random Sample Consensus",
/// 1981), then the nearest places under a map fitted to all. `spacing`: of the points, px.
PlaneMap::Pairs ChoosePlaces(const std::vector<PlaneChoice>& choices, double spacing);

/// Whether one smooth map fits all points but a few.
bool FollowsOneMap(const PlaneMap::Pairs& pairs, double spacing);

/// Whether the points consist of two groups, each on its own smooth map.
bool FollowsTwoMaps(const PlaneMap::Pairs& pairs, double spacing);

}  // namespace plenocal
