// SPDX-License-Identifier: Apache-2.0
//
// Predictions of a square marker's place in the image from those near it on the target.
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstddef>
#include <map>
#include <optional>

#include "targets/tags/quad.h"

namespace plenocal::internal {

/// The corners of a square on the target, in the order of `Quad`.
using QuadPoints = std::array<Eigen::Vector3d, 4>;

Eigen::Vector2d CentreOf(const Quad& q);
/// Mean length of the sides.
double Side(const Quad& q);
bool Convex(const Quad& q);

/// Where a square of the target should be, judging by those found near it in its plane.
struct Prediction {
  Quad corners;
  double distance = 0;         ///< of the nearest square found / the square's side
  std::size_t neighbours = 0;  ///< that it rests on
};

/// Which neighbours predict a square: up to four, or of these the ones about as near as the
/// nearest. A strong lens bends the target more than one homography describes, the more the farther
/// the neighbours; more neighbours determine the homography better.
enum class Neighbours { kAll, kNearest };

/// Nothing where no square found lies in the plane of square `id`.
std::optional<Prediction> Predict(const std::map<int, QuadPoints>& target,
                                  int id,
                                  const std::map<int, Quad>& found,
                                  Neighbours which);

/// The same from the square itself (which `found` has) and all its neighbours together.
std::optional<Prediction> Smooth(const std::map<int, QuadPoints>& target,
                                 int id,
                                 const std::map<int, Quad>& found);

}  // namespace plenocal::internal
