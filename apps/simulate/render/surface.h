// SPDX-License-Identifier: Apache-2.0
//
// Interface between simulated scenes and the renderers: radiance along rays.
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

/// The surfaces in front of a camera, in its frame.
class Surface {
 public:
  virtual ~Surface() = default;

  /// Radiance along a ray of the camera frame, 1: white paper. `direction` need not have length 1.
  [[nodiscard]] virtual float Radiance(const Eigen::Vector3f& origin,
                                       const Eigen::Vector3f& direction,
                                       const Spread& spread) const = 0;
  /// The radiances of a whole bundle. `face`: the face (`FaceOf`) that all rays around these meet,
  /// or -1 if not known; if it is given, surfaces with faces take much less time.
  virtual void Radiances(const RayBundle& rays,
                         const Spread& spread,
                         int /*face*/,
                         std::array<float, RayBundle::kMost>* radiances) const {
    for (size_t i = 0; i < static_cast<size_t>(rays.count); ++i) {
      (*radiances)[i] = Radiance(rays.Origin(i), rays.Direction(i), spread);
    }
  }
  /// The flat face that a ray meets, -1: none; and its distance from the origin in lengths of
  /// `direction`.
  [[nodiscard]] virtual std::pair<int, float> FaceOf(const Eigen::Vector3f& origin,
                                                     const Eigen::Vector3f& direction) const = 0;

  static constexpr float kBackground = 0.15f;  ///< radiance where no surface is seen
};

}  // namespace plenocal::simulate
