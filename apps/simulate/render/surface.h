// SPDX-License-Identifier: Apache-2.0
//
// The interface between what a camera sees and the renderers: brightness along rays.
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

  [[nodiscard]] Eigen::Vector3f Origin(size_t i) const { return {x[i], y[i], z}; }
  [[nodiscard]] Eigen::Vector3f Direction(size_t i) const { return {dx[i], dy[i], 1}; }
};

/// The surfaces before a camera, in its frame: the brightness along rays.
class Surface {
 public:
  virtual ~Surface() = default;

  /// Radiance along a ray of the camera frame, 1: white paper. `direction` need not have length 1.
  [[nodiscard]] virtual float Radiance(const Eigen::Vector3f& origin,
                                       const Eigen::Vector3f& direction,
                                       const Spread& spread) const = 0;
  /// The radiances of a whole bundle. `face`: that of all rays around these by `FaceOf`, or -1;
  /// surfaces with faces take much less time for rays of one of them.
  virtual void Radiances(const RayBundle& rays,
                         const Spread& spread,
                         int /*face*/,
                         std::array<float, RayBundle::kMost>* radiances) const {
    for (size_t i = 0; i < static_cast<size_t>(rays.count); ++i) {
      (*radiances)[i] = Radiance(rays.Origin(i), rays.Direction(i), spread);
    }
  }
  /// The flat face that a ray meets, -1: none; and how far from the origin, in lengths of
  /// `direction`.
  [[nodiscard]] virtual std::pair<int, float> FaceOf(const Eigen::Vector3f& origin,
                                                     const Eigen::Vector3f& direction) const = 0;

  static constexpr float kBackground = 0.15f;  ///< radiance where a camera images nothing
};

}  // namespace plenocal::simulate
