// SPDX-License-Identifier: Apache-2.0
#include "apps/simulate/targets/pose_set.h"

#include <fmt/format.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <optional>
#include <utility>

#include "apps/simulate/spec/random.h"
#include "apps/simulate/targets/hand_path.h"
#include "calib/base/format_error.h"
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
  size_t target = 0;
};

FramePlan PlanFrame(const SimulationSpec& spec, int index, size_t widest_camera) {
  const PoseSpec& poses = spec.poses;
  FramePlan plan{.index = index, .partial = false, .aim = poses.aim, .target = 0};
  const size_t turn = static_cast<size_t>(index), targets = spec.targets.size();
  plan.target = turn % targets;
  if (poses.aim_all) {
    // With as many cameras as targets, or a multiple, each still meets each.
    plan.aim = turn % spec.cameras.size();
    plan.target = (turn / spec.cameras.size() + turn) % targets;
    return plan;
  }
  // Spread evenly over the run: every 1 / partial-th frame.
  plan.partial = !(poses.one_distance || poses.no_tilt || poses.corner) &&
                 std::floor((index + 1) * poses.partial) > std::floor(index * poses.partial);
  if (plan.partial) plan.aim = widest_camera;
  return plan;
}

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
  PoseFinder(const SimulationSpec& spec,
             const Observer& observer,
             const std::vector<TrueTarget>& targets)
      : spec_(spec), observer_(observer), targets_(targets) {
    for (const TrueTarget& target : targets) {
      stances_.push_back(FindStance(target));
      // Fewer do not make a frame worth having; of a small target half of it.
      fewest_.push_back(std::min(8, (static_cast<int>(target.markers.size()) + 1) / 2));
    }
  }

  [[nodiscard]] Frame Find(const FramePlan& plan) const {
    constexpr int kTries = 300;
    Random random(spec_.seed, "pose", {static_cast<size_t>(plan.index)});
    const CameraSpec& camera = spec_.cameras[plan.aim];
    std::optional<Frame> alone;  // a frame in which no second camera sees a target
    for (int attempt = 0; attempt < kTries; ++attempt) {
      const Placement drawn = DrawPlacement(spec_.poses, plan, &random);
      const std::optional<Ray> ray = observer_.CentralRay(plan.aim, At(camera, drawn.share));
      if (!ray) continue;
      const RigidTransform T_rig_target =
          camera.T_camera_rig.Inverse() *
          PlaceTarget(spec_.poses, drawn, *ray, stances_[plan.target]);
      if (!Suits(plan, T_rig_target, camera)) continue;
      Frame frame{FrameName(plan.index), plan.partial ? "partial" : "good", T_rig_target};
      if (!spec_.poses.aim_all || SecondSees(plan.aim, T_rig_target)) return frame;
      if (!alone) alone = std::move(frame);
    }
    if (alone) return *alone;
    throw JobError(
        "{}: poses: in {} tries camera {} never saw {} markers{}; correct distance, tilt or the camera",
        spec_.path.string(),
        kTries,
        camera.name,
        fewest_[plan.target],
        spec_.poses.corner ? " in a corner of its image and none elsewhere" : "");
  }

  // T_rig_target of a rig that moves; nothing where the target would be out of the camera's domain.
  [[nodiscard]] std::optional<RigidTransform> OnPath(const HandPath& path, double time) const {
    const CameraSpec& camera = spec_.cameras[spec_.poses.aim];
    const Placement placement = path.At(time);
    const std::optional<Ray> ray =
        observer_.CentralRay(spec_.poses.aim, At(camera, placement.share));
    if (!ray) return std::nullopt;
    return camera.T_camera_rig.Inverse() * PlaceTarget(spec_.poses, placement, *ray, stances_[0]);
  }

 private:
  [[nodiscard]] bool Suits(const FramePlan& plan,
                           const RigidTransform& T_rig_target,
                           const CameraSpec& camera) const {
    const std::vector<Observation> seen =
        observer_.Observe(plan.aim, targets_[plan.target], T_rig_target);
    if (CountMarkers(seen) < fewest_[plan.target]) return false;
    const Eigen::Vector2d centre = At(camera, {0.5, 0.5});
    return !spec_.poses.corner || std::ranges::none_of(seen, [&](const Observation& o) {
      return o.values[0] > centre.x() || o.values[1] > centre.y();
    });
  }

  // True where a camera beside this one sees a target.
  [[nodiscard]] bool SecondSees(size_t aim, const RigidTransform& T_rig_target) const {
    for (size_t c = 0; c < spec_.cameras.size(); ++c) {
      for (size_t k = 0; c != aim && k < targets_.size(); ++k) {
        if (CountMarkers(observer_.Observe(c, targets_[k], T_rig_target)) >= fewest_[k]) {
          return true;
        }
      }
    }
    return false;
  }

  const SimulationSpec& spec_;
  const Observer& observer_;
  const std::vector<TrueTarget>& targets_;
  std::vector<Stance> stances_;  // per target
  std::vector<int> fewest_;      // per target: markers that a frame must show
};

// Frames of a rig that moves; those for which the lens has no image of the target's middle are not
// taken.
std::vector<Frame> MakeMovingPoses(const SimulationSpec& spec, const PoseFinder& finder) {
  const HandPath path(spec.poses, spec.seed);
  std::vector<Frame> frames;
  for (int f = 0; f < spec.poses.frames; ++f) {
    const double time = f / spec.poses.rate;
    const auto T_rig_target = finder.OnPath(path, time);
    if (!T_rig_target) continue;
    Frame frame{.name = FrameName(f), .kind = "good", .T_rig_target = *T_rig_target, .time = time};
    for (const CameraSpec& camera : spec.cameras) {
      frame.T_rig_target_of_camera.push_back(
          finder.OnPath(path, time + camera.time_offset + camera.time_shift)
              .value_or(*T_rig_target));
    }
    frames.push_back(std::move(frame));
  }
  return frames;
}

}  // namespace

std::vector<Frame> MakePoses(const SimulationSpec& spec,
                             const Observer& observer,
                             const std::vector<TrueTarget>& targets) {
  std::vector<Frame> frames;
  for (const auto& [name, T_target_rig] : spec.poses.given) {
    frames.push_back({name, "given", T_target_rig.Inverse()});
  }
  if (!frames.empty()) return frames;
  const PoseFinder finder(spec, observer, targets);
  if (spec.poses.moving) return MakeMovingPoses(spec, finder);
  const size_t widest = WidestCamera(spec, observer);
  for (int f = 0; f < spec.poses.frames; ++f) {
    if (spec.poses.still && f > 0) {
      frames.push_back({FrameName(f), frames[0].kind, frames[0].T_rig_target});
    } else {
      frames.push_back(finder.Find(PlanFrame(spec, f, widest)));
    }
  }
  return frames;
}

}  // namespace plenocal::simulate
