// SPDX-License-Identifier: Apache-2.0
//
// A wall with a target on it, in the light of a lamp.
#pragma once

#include "apps/simulate/scene/scene_surface.h"
#include "apps/simulate/spec/photometry_spec.h"
#include "apps/simulate/targets/target_surface.h"

namespace plenocal::simulate {

/// The wall is the plane z = 0 of the target's frame. All arguments must outlive the object.
class WallSurface : public Surface {
 public:
  WallSurface(const WallSpec& wall,
              const SceneTexture& texture,
              const PosedSurface& target,
              const RigidTransform& T_camera_target);

  [[nodiscard]] float Radiance(const Eigen::Vector3f& origin,
                               const Eigen::Vector3f& direction,
                               const Spread& spread) const override;
  [[nodiscard]] std::pair<int, float> FaceOf(const Eigen::Vector3f& origin,
                                             const Eigen::Vector3f& direction) const override;

 private:
  /// Where a ray meets the wall, target's frame, and the distance in lengths of `direction`.
  struct Hit {
    Eigen::Vector3f point;
    float distance = -1;          ///< negative: nowhere
    Eigen::Vector2f place{0, 0};  ///< along the unfolded wall, m
  };
  [[nodiscard]] Hit Meet(const Eigen::Vector3f& origin, const Eigen::Vector3f& direction) const;
  [[nodiscard]] float Light(const Hit& hit) const;
  [[nodiscard]] float Gloss(const Hit& hit) const;

  const WallSpec& wall_;
  const SceneTexture& texture_;
  const PosedSurface& target_;
  Eigen::Matrix3f R_;  // target by camera
  Eigen::Vector3f viewer_;
  Eigen::Vector2f axis_;  // where the camera's axis meets the wall
};

}  // namespace plenocal::simulate
