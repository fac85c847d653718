// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <array>
#include <utility>

namespace plenocal::simulate {

/// Width of the bundle of light that a ray represents: `at_origin` + distance * `by_distance`, m.
struct Spread {
  float at_origin = 0, by_distance = 0;
};

/// Rays of one position in an image; all start at depth z and have direction (dx, dy, 1).
struct RayBundle {
  static constexpr int kMost = 144;
  int count = 0;
  float z = 0;
  std::array<float, kMost> x, y, dx, dy;
};

/// What a camera looks at, in its frame: the brightness along rays.
class Surface {
 public:
  virtual ~Surface() = default;

  /// Radiance along a ray of the camera frame, 1: white paper. `direction` need not have length 1.
  [[nodiscard]] virtual float Radiance(const Eigen::Vector3f& origin,
                                       const Eigen::Vector3f& direction,
                                       const Spread& spread) const = 0;
  /// The radiances of a whole bundle. `face`: that of all rays around these by `FaceOf`, or -1;
  /// rays of one face are much faster.
  virtual void Radiances(const RayBundle& rays,
                         const Spread& spread,
                         int face,
                         std::array<float, RayBundle::kMost>* radiances) const = 0;
  /// The flat face that a ray meets, -1: none; and how far from the origin, in lengths of
  /// `direction`.
  [[nodiscard]] virtual std::pair<int, float> FaceOf(const Eigen::Vector3f& origin,
                                                     const Eigen::Vector3f& direction) const = 0;

  static constexpr float kBackground = 0.15f;  ///< radiance where a camera images nothing
};

}  // namespace plenocal::simulate
