// SPDX-License-Identifier: Apache-2.0
//
// The surfaces of a simulated scene: a room, boxes that stand in it and boxes that move through it.
#pragma once

#include <Eigen/Core>
#include <optional>
#include <vector>

#include "apps/simulate/render/observer.h"
#include "apps/simulate/scene/rig_path.h"
#include "apps/simulate/spec/random.h"

namespace plenocal::simulate {

/// A plane that bounds the room: normal . p = offset, the normal points out of the room.
struct Wall {
  Eigen::Vector3d normal{0, 0, 1};
  double offset = 0;  ///< m
};

struct Box {
  RigidTransform T_world_box;
  Eigen::Vector3d half{0, 0, 0};  ///< m, half of its edges
};

/// A box that moves and rotates about the vertical steadily.
struct MovingBox {
  Box box;                            ///< at `time`
  double time = 0;                    ///< s
  Eigen::Vector3d velocity{0, 0, 0};  ///< m/s
  double turning = 0;                 ///< rad/s
  Eigen::Vector3d viewer{0, 0, 0};    ///< m, the rig that it was placed before, at `time`

  [[nodiscard]] Box At(double t) const;
};

/// Where a ray meets a surface.
struct SurfaceHit {
  double distance = 0;              ///< in lengths of the ray's direction
  Eigen::Vector3d normal{0, 0, 0};  ///< towards the ray's origin
};

/// The scene at one instant, or a part of it.
class SceneShape {
 public:
  std::vector<Wall> walls;
  std::vector<Box> boxes;

  /// The nearest surface from a point in the room; nothing outside of it.
  [[nodiscard]] std::optional<SurfaceHit> Cast(const Eigen::Vector3d& origin,
                                               const Eigen::Vector3d& direction) const;
  /// True where a point on a surface is hidden from `viewer` by a box or lies outside the room.
  [[nodiscard]] bool Hides(const Eigen::Vector3d& point, const Eigen::Vector3d& viewer) const;
};

class SimulatedScene {
 public:
  /// A room around the path, boxes before the cameras and, for `moving` points, moving boxes. All
  /// from the seed of `spec`.
  SimulatedScene(const SimulationSpec& spec, const Observer& observer, const RigPath& path);

  /// The room and the boxes that stand still.
  [[nodiscard]] const SceneShape& Still() const { return still_; }
  [[nodiscard]] const std::vector<MovingBox>& Moving() const { return moving_; }
  /// All that is within `reach` (m) of `viewer` at a time.
  [[nodiscard]] SceneShape At(double time, const Eigen::Vector3d& viewer, double reach) const;
  /// Angle about the world's z axis after which the scene repeats itself, rad; 0: it does not.
  [[nodiscard]] double Period() const { return period_; }

 private:
  void BuildRoom(const ScenerySpec& spec, const RigPath& path);

  SceneShape still_;
  std::vector<MovingBox> moving_;
  double period_ = 0;
};

/// A ray through a random pixel of a random camera in a random one of `instants`; world frame.
struct RandomSight {
  const RigInstant* instant = nullptr;
  RigidTransform T_camera_world;
  Ray ray;
};
std::optional<RandomSight> DrawSight(const SimulationSpec& spec,
                                     const Observer& observer,
                                     const std::vector<const RigInstant*>& instants,
                                     Random* random);

}  // namespace plenocal::simulate
