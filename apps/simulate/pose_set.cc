// SPDX-License-Identifier: Apache-2.0
#include "apps/simulate/pose_set.h"

#include <fmt/format.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <numbers>

#include "apps/simulate/random.h"
#include "calib/error.h"

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

}  // namespace

std::vector<Frame> MakePoses(const SimulationSpec& spec,
                             const Observer& observer,
                             const TrueTarget& target) {
  const PoseSpec& poses = spec.poses;
  std::vector<Frame> frames;
  for (const auto& [name, T_target_rig] : poses.given) {
    frames.push_back({name, "given", T_target_rig.Inverse()});
  }
  if (!frames.empty()) return frames;

  const Stance stance = FindStance(target);
  const size_t widest = WidestCamera(spec, observer);
  // Fewer do not make a frame worth having; of a small target half of it.
  const int fewest = std::min(8, (static_cast<int>(target.markers.size()) + 1) / 2);
  constexpr int kTries = 300;
  for (int f = 0; f < poses.frames; ++f) {
    Random random(spec.seed, "pose", {static_cast<size_t>(f)});
    // Spread evenly over the run: every 1 / partial-th frame.
    const bool partial = !(poses.one_distance || poses.no_tilt || poses.corner) &&
                         std::floor((f + 1) * poses.partial) > std::floor(f * poses.partial);
    const size_t aim = partial ? widest : poses.aim;
    const CameraSpec& camera = spec.cameras[aim];
    bool found = false;
    for (int attempt = 0; attempt < kTries && !found; ++attempt) {
      Eigen::Vector2d share(random.Uniform(0.2, 0.8), random.Uniform(0.2, 0.8));
      // Reaching out of the image too, so that near targets fit into the corner.
      if (poses.corner) share = share.array() - 0.4;
      if (partial) {
        const int side = static_cast<int>(random.Uniform(0, 4));
        share[side % 2] = side < 2 ? random.Uniform(0.02, 0.12) : random.Uniform(0.88, 0.98);
      }
      // Evenly in 1 / distance, which is what depth does to an image.
      double distance = 1 / random.Uniform(1 / poses.farthest, 1 / poses.nearest);
      if (poses.one_distance) distance = (poses.nearest + poses.farthest) / 2;
      double tilt = poses.tilt * std::sqrt(random.Uniform(0, 1));
      if (poses.no_tilt) tilt = 0;
      const double azimuth = kGoldenAngle * f + random.Uniform(-0.5, 0.5);
      const double roll = random.Uniform(-poses.roll, poses.roll);

      const std::optional<Ray> ray = observer.CentralRay(aim, At(camera, share));
      if (!ray) continue;
      // Without tilt the target is parallel to the image, wherever in it.
      const Eigen::Matrix3d to_ray = poses.no_tilt ? Eigen::Matrix3d::Identity()
                                                   : Eigen::Quaterniond::FromTwoVectors(
                                                         Eigen::Vector3d::UnitZ(), ray->direction)
                                                         .toRotationMatrix();
      const Eigen::Vector3d axis(std::cos(azimuth), std::sin(azimuth), 0);
      RigidTransform T_camera_target;
      T_camera_target.R = to_ray * ExpRotation(tilt * axis) *
                          ExpRotation(Eigen::Vector3d(0, 0, roll)) * stance.R_viewer_target;
      // One distance of a flat target is one depth.
      const double along =
          poses.one_distance ? (distance - ray->origin.z()) / ray->direction.z() : distance;
      T_camera_target.t = ray->origin + along * ray->direction - T_camera_target.R * stance.middle;
      const RigidTransform T_rig_target = camera.T_camera_rig.Inverse() * T_camera_target;
      const std::vector<Observation> seen = observer.Observe(aim, target, T_rig_target);
      if (CountMarkers(seen) < fewest) continue;
      const Eigen::Vector2d centre = At(camera, {0.5, 0.5});
      if (poses.corner && std::any_of(seen.begin(), seen.end(), [&](const Observation& o) {
            return o.values[0] > centre.x() || o.values[1] > centre.y();
          })) {
        continue;
      }
      frames.push_back(
          {fmt::format("{:06}", 100 + 5 * f), partial ? "partial" : "good", T_rig_target});
      found = true;
    }
    if (!found) {
      throw Error(ErrorKind::kJob,
                  fmt::format("{}: poses: in {} tries camera {} never saw {} markers{}; correct "
                              "distance, tilt or the camera",
                              spec.path.string(),
                              kTries,
                              camera.name,
                              fewest,
                              poses.corner ? " in a corner of its image and none elsewhere" : ""));
    }
  }
  return frames;
}

}  // namespace plenocal::simulate
