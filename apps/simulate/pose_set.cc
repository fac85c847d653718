// SPDX-License-Identifier: Apache-2.0
#include "apps/simulate/pose_set.h"

#include <fmt/format.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <numbers>
#include <optional>

#include "apps/simulate/random.h"
#include "calib/base/error.h"
#include "calib/base/linear_algebra.h"

namespace plenocal::simulate {
namespace {

constexpr double kGoldenAngle = 2.399963229728653;  // rad; its multiples are spread evenly

// Middle of the target and the direction from which most of its markers face the viewer.
struct Stance {
  Eigen::Vector3d middle{0, 0, 0};
  Eigen::Matrix3d R_viewer_target;  // target seen upright along the viewer's z axis
};

Stance FindStance(const TrueTarget& target) {
  Stance stance;
  Eigen::Vector3d normal = Eigen::Vector3d::Zero();
  for (const auto& [number, position] : target.markers) {
    stance.middle += position / static_cast<double>(target.markers.size());
    normal += target.normals.at(number);
  }
  // Markers without a front, or tags all around: any side will do.
  if (normal.norm() < 1e-6) normal = Eigen::Vector3d(0, 0, -1);
  const Eigen::Vector3d forward = -normal.normalized();
  Eigen::Vector3d right = Eigen::Vector3d::UnitX();
  if (std::abs(forward.x()) > 0.9) right = Eigen::Vector3d::UnitY();
  right = (right - right.dot(forward) * forward).normalized();
  stance.R_viewer_target << right.transpose(), forward.cross(right).transpose(),
      forward.transpose();
  return stance;
}

Eigen::Vector2d At(const CameraSpec& camera, const Eigen::Vector2d& share) {
  return {share.x() * (camera.image_size[0] - 1), share.y() * (camera.image_size[1] - 1)};
}

// The camera with the widest view across its image.
size_t WidestCamera(const SimulationSpec& spec, const Observer& observer) {
  size_t widest = 0;
  double least = 2;
  for (size_t c = 0; c < spec.cameras.size(); ++c) {
    const auto a = observer.CentralRay(c, At(spec.cameras[c], {0.1, 0.5}));
    const auto b = observer.CentralRay(c, At(spec.cameras[c], {0.9, 0.5}));
    if (!a || !b) continue;
    const double cosine = a->direction.dot(b->direction);
    if (cosine < least) least = cosine, widest = c;
  }
  return widest;
}

std::string FrameName(int index) { return fmt::format("{:06}", 100 + 5 * index); }

// A frame to be found a pose for.
struct FramePlan {
  int index = 0;
  bool partial = false;  // the target is at the rim of the image
  size_t aim = 0;        // the camera that is aimed at the target
};

FramePlan PlanFrame(const PoseSpec& poses, int index, size_t widest_camera) {
  FramePlan plan{.index = index, .partial = false, .aim = poses.aim};
  // Spread evenly over the run: every 1 / partial-th frame.
  plan.partial = !(poses.one_distance || poses.no_tilt || poses.corner) &&
                 std::floor((index + 1) * poses.partial) > std::floor(index * poses.partial);
  if (plan.partial) plan.aim = widest_camera;
  return plan;
}

// A random position of the target in the image and orientation before the camera.
struct Placement {
  Eigen::Vector2d share;                   // position in the image, in parts of its size
  double distance = 0;                     // m
  double tilt = 0, azimuth = 0, roll = 0;  // rad
};

Placement DrawPlacement(const PoseSpec& poses, const FramePlan& plan, Random* random) {
  Placement drawn;
  // The order of the draws belongs to the seeds of existing sets.
  drawn.share.y() = random->Uniform(0.2, 0.8);
  drawn.share.x() = random->Uniform(0.2, 0.8);
  // Reaching out of the image too, so that near targets fit into the corner.
  if (poses.corner) drawn.share = drawn.share.array() - 0.4;
  if (plan.partial) {
    const int side = static_cast<int>(random->Uniform(0, 4));
    drawn.share[side % 2] = side < 2 ? random->Uniform(0.02, 0.12) : random->Uniform(0.88, 0.98);
  }
  // Uniform in 1 / distance, which is the effect of depth on an image.
  drawn.distance = 1 / random->Uniform(1 / poses.farthest, 1 / poses.nearest);
  if (poses.one_distance) drawn.distance = (poses.nearest + poses.farthest) / 2;
  drawn.tilt = poses.tilt * std::sqrt(random->Uniform(0, 1));
  if (poses.no_tilt) drawn.tilt = 0;
  drawn.azimuth = kGoldenAngle * plan.index + random->Uniform(-0.5, 0.5);
  drawn.roll = random->Uniform(-poses.roll, poses.roll);
  return drawn;
}

// T_camera_target of a target whose middle is on `ray`.
RigidTransform PlaceTarget(const PoseSpec& poses,
                           const Placement& drawn,
                           const Ray& ray,
                           const Stance& stance) {
  // Without tilt the target is parallel to the image, wherever in it.
  const Eigen::Matrix3d to_ray = poses.no_tilt
                                     ? Eigen::Matrix3d::Identity()
                                     : RotationBetween(Eigen::Vector3d::UnitZ(), ray.direction);
  const Eigen::Vector3d axis(std::cos(drawn.azimuth), std::sin(drawn.azimuth), 0);
  RigidTransform T_camera_target;
  T_camera_target.R = to_ray * ExpRotation(drawn.tilt * axis) *
                      ExpRotation(Eigen::Vector3d(0, 0, drawn.roll)) * stance.R_viewer_target;
  // One distance of a flat target is one depth.
  const double along =
      poses.one_distance ? (drawn.distance - ray.origin.z()) / ray.direction.z() : drawn.distance;
  T_camera_target.t = ray.origin + along * ray.direction - T_camera_target.R * stance.middle;
  return T_camera_target;
}

// Finds poses that show the target.
class PoseFinder {
 public:
  PoseFinder(const SimulationSpec& spec, const Observer& observer, const TrueTarget& target)
      : spec_(spec),
        observer_(observer),
        target_(target),
        stance_(FindStance(target)),
        // Fewer do not make a frame worth having; of a small target half of it.
        fewest_(std::min(8, (static_cast<int>(target.markers.size()) + 1) / 2)) {}

  [[nodiscard]] Frame Find(const FramePlan& plan) const {
    constexpr int kTries = 300;
    Random random(spec_.seed, "pose", {static_cast<size_t>(plan.index)});
    const CameraSpec& camera = spec_.cameras[plan.aim];
    for (int attempt = 0; attempt < kTries; ++attempt) {
      const Placement drawn = DrawPlacement(spec_.poses, plan, &random);
      const std::optional<Ray> ray = observer_.CentralRay(plan.aim, At(camera, drawn.share));
      if (!ray) continue;
      const RigidTransform T_rig_target =
          camera.T_camera_rig.Inverse() * PlaceTarget(spec_.poses, drawn, *ray, stance_);
      if (!Suits(observer_.Observe(plan.aim, target_, T_rig_target), camera)) continue;
      return {FrameName(plan.index), plan.partial ? "partial" : "good", T_rig_target};
    }
    throw Error(
        ErrorKind::kJob,
        fmt::format(
            "{}: poses: in {} tries camera {} never saw {} markers{}; correct distance, tilt or the camera",
            spec_.path.string(),
            kTries,
            camera.name,
            fewest_,
            spec_.poses.corner ? " in a corner of its image and none elsewhere" : ""));
  }

 private:
  [[nodiscard]] bool Suits(const std::vector<Observation>& seen, const CameraSpec& camera) const {
    if (CountMarkers(seen) < fewest_) return false;
    const Eigen::Vector2d centre = At(camera, {0.5, 0.5});
    return !spec_.poses.corner || std::ranges::none_of(seen, [&](const Observation& o) {
      return o.values[0] > centre.x() || o.values[1] > centre.y();
    });
  }

  const SimulationSpec& spec_;
  const Observer& observer_;
  const TrueTarget& target_;
  Stance stance_;
  int fewest_;  // markers that a frame must show
};

}  // namespace

std::vector<Frame> MakePoses(const SimulationSpec& spec,
                             const Observer& observer,
                             const TrueTarget& target) {
  std::vector<Frame> frames;
  for (const auto& [name, T_target_rig] : spec.poses.given) {
    frames.push_back({name, "given", T_target_rig.Inverse()});
  }
  if (!frames.empty()) return frames;
  const PoseFinder finder(spec, observer, target);
  const size_t widest = WidestCamera(spec, observer);
  for (int f = 0; f < spec.poses.frames; ++f) {
    if (spec.poses.still && f > 0) {
      frames.push_back({FrameName(f), frames[0].kind, frames[0].T_rig_target});
    } else {
      frames.push_back(finder.Find(PlanFrame(spec.poses, f, widest)));
    }
  }
  return frames;
}

}  // namespace plenocal::simulate
