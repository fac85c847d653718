// SPDX-License-Identifier: Apache-2.0
#include "assess/views/target_poses.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

#include "assess/views/micro_lens_visibility.h"
#include "calib/base/format_error.h"
#include "calib/base/linear_algebra.h"

namespace plenocal {
namespace {

constexpr double kResolvedPixels = 3;
// Focus and light are known to serve where the target was found; farther steps are left to later.
constexpr double kBeyondSeen = 2;

/// Line of sight of a place in the image, from the camera's frame's origin; nothing outside the
/// model's domain.
std::optional<Ray> RayAt(const RigEstimate& rig, size_t c, const Eigen::Vector2d& u_px) {
  const BundleCamera& camera = rig.bundle.cameras[c];
  std::array<double, kMaxObservationSize> values{u_px.x(), u_px.y()};
  if (camera.model->plenoptic) {
    if (rig.lenses[c].lenses.empty()) return std::nullopt;
    const MicroLens& lens =
        *std::ranges::min_element(rig.lenses[c].lenses, {}, [&](const MicroLens& each) {
          return (each.centre - u_px).squaredNorm();
        });
    values = {lens.centre.x(), lens.centre.y(), lens.centre.x(), lens.centre.y()};
  }
  return camera.model->Unproject(camera.params.data(), camera.config.data(), values.data());
}

double LargestExtent(const ViewTarget& shape) {
  const Eigen::Vector3d middle = MiddleOf(shape);
  double radius = 0;
  for (const auto& [number, p] : shape.markers) radius = std::max(radius, (p - middle).norm());
  return 2 * radius;
}

/// Where the printed side looks; zero when it has none.
Eigen::Vector3d MeanNormal(const ViewTarget& shape) {
  Eigen::Vector3d sum = Eigen::Vector3d::Zero();
  for (const auto& [number, normal] : shape.normals) sum += normal;
  constexpr double kNone = 1e-6;
  return sum.norm() > kNone ? sum.normalized() : Eigen::Vector3d::Zero();
}

/// Rotation of a target that faces a camera, upright: its x axis to the image's right.
Eigen::Matrix3d Facing(const ViewTarget& shape) {
  Eigen::Vector3d normal = MeanNormal(shape);
  if (normal == Eigen::Vector3d::Zero()) normal = -Eigen::Vector3d::UnitZ();
  Eigen::Vector3d right = Eigen::Vector3d::UnitX() - normal.x() * normal;
  constexpr double kParallel = 0.1;
  if (right.norm() < kParallel) right = Eigen::Vector3d::UnitY() - normal.y() * normal;
  right.normalize();
  Eigen::Matrix3d R;  // rows: the camera's axes in the target's frame
  R.row(0) = right;
  R.row(1) = (-normal).cross(right);
  R.row(2) = -normal;
  return R;
}

/// Angle of a pixel in the middle of the image, rad.
double PixelAngle(const RigEstimate& rig, size_t c) {
  const ImageSize size = rig.bundle.cameras[c].image_size;
  const Eigen::Vector2d middle(size[0] / 2.0, size[1] / 2.0);
  constexpr double kStep = 10;  // px
  const auto a = RayAt(rig, c, middle);
  const auto b = RayAt(rig, c, middle + Eigen::Vector2d(kStep, 0));
  if (!a || !b) {
    throw JobError("{}: the camera has no ray in the middle of its image",
                   rig.bundle.cameras[c].name);
  }
  return std::acos(std::min(1.0, a->direction.dot(b->direction))) / kStep;
}

}  // namespace

Eigen::Vector3d MiddleOf(const ViewTarget& shape) {
  Eigen::AlignedBox3d box;
  for (const auto& [number, position] : shape.markers) box.extend(position);
  return box.center();
}

ViewRange FeasibleRange(const RigEstimate& rig,
                        size_t c,
                        const ViewTarget& shape,
                        const std::vector<double>& seen,
                        const ViewRange& wanted) {
  const BundleCamera& camera = rig.bundle.cameras[c];
  ViewRange range;
  if (camera.model->plenoptic) {
    // Its depths are those at which virtual depth is resolved; the predictor tests each marker.
    if (!seen.empty()) range = {seen.front() / kBeyondSeen, seen.back() * kBeyondSeen};
  } else {
    const double pixel = PixelAngle(rig, c);
    const double diagonal = std::hypot(camera.image_size[0], camera.image_size[1]);
    constexpr double kWidest = 2;  // rad; beyond it nearness is limited by the hand, not the lens
    range.nearest = LargestExtent(shape) / 2 / std::tan(std::min(diagonal * pixel, kWidest) / 2);
    range.farthest = shape.finest > 0 ? shape.finest / (kResolvedPixels * pixel) / std::sqrt(2.0)
                                      : 10 * range.nearest;
    if (!seen.empty()) {
      range.nearest = std::max(range.nearest, seen.front() / kBeyondSeen);
      range.farthest = std::min(range.farthest, seen.back() * kBeyondSeen);
    }
    range.farthest = std::max(range.farthest, range.nearest);
  }
  if (wanted.nearest > 0) range.nearest = wanted.nearest;
  if (wanted.farthest > 0) range.farthest = wanted.farthest;
  if (!(range.nearest > 0) || !(range.farthest >= range.nearest)) {
    throw InputError(
        "{}: no distance for the target between {:.3g} m and {:.3g} m; set "
        "--near and --far",
        camera.name,
        range.nearest,
        range.farthest);
  }
  return range;
}

std::vector<TargetPose> CandidatePoses(const RigEstimate& rig,
                                       size_t c,
                                       const ViewTarget& shape,
                                       const ViewRange& range,
                                       double largest_tilt) {
  constexpr int kColumns = 7, kRows = 5, kDistances = 6, kDirections = 8;
  constexpr std::array kTilts{0.0, 0.4, 0.7, 1.0};  // of the largest
  const ImageSize size = rig.bundle.cameras[c].image_size;
  // A target found in part is moved with its middle onto the border.
  const double edge = shape.found_in_part ? 0.02 : 0.12;
  std::vector<TargetPose> poses;
  for (int row = 0; row < kRows; ++row) {
    for (int column = 0; column < kColumns; ++column) {
      const auto place = [&](int i, int count, int pixels) {
        return (edge + (1 - 2 * edge) * i / (count - 1)) * pixels;
      };
      for (int d = 0; d < kDistances; ++d) {
        const double part = static_cast<double>(d) / (kDistances - 1);
        TargetPose pose{.camera = c,
                        .place = {place(column, kColumns, size[0]), place(row, kRows, size[1])},
                        .distance = 1 / ((1 - part) / range.nearest + part / range.farthest)};
        for (const double tilt : kTilts) {
          pose.tilt = tilt * largest_tilt;
          for (int direction = 0; direction < (tilt > 0 ? kDirections : 1); ++direction) {
            pose.away = 2 * std::numbers::pi * direction / kDirections;
            for (const double turn : {0.0, std::numbers::pi / 2}) {
              pose.turn = turn;
              poses.push_back(pose);
            }
          }
        }
      }
    }
  }
  return poses;
}

TargetPose NeighbourPose(TargetPose pose,
                         size_t neighbour,
                         double step,
                         ImageSize image_size,
                         const ViewRange& range,
                         double largest_tilt) {
  constexpr double kPlaces = 12, kTilt = 0.15, kAngle = 0.4, kDistance = 0.12;
  const double part = neighbour % 2 == 0 ? step : -step;
  switch (neighbour / 2) {
    case 0:
      pose.place.x() += part * image_size[0] / kPlaces;
      break;
    case 1:
      pose.place.y() += part * image_size[1] / kPlaces;
      break;
    case 2:
      pose.distance =
          std::clamp(pose.distance * (1 + kDistance * part), range.nearest, range.farthest);
      break;
    case 3:
      pose.tilt = std::clamp(pose.tilt + kTilt * part, 0.0, largest_tilt);
      break;
    case 4:
      pose.away += kAngle * part;
      break;
    default:
      pose.turn += kAngle * part;
      break;
  }
  return pose;
}

TargetPose LargestNearby(
    TargetPose pose,
    const std::function<TargetPose(const TargetPose&, size_t, double)>& neighbour,
    const std::function<double(const TargetPose&)>& value) {
  double most = value(pose);
  for (const double step : {1.0, 0.5, 0.25}) {
    for (size_t k = 0; k < kNeighbours; ++k) {
      const TargetPose next = neighbour(pose, k, step);
      const double at_next = value(next);
      if (at_next > most) pose = next, most = at_next;
    }
  }
  return pose;
}

std::optional<RigidTransform> PlaceTarget(const RigEstimate& rig,
                                          const ViewTarget& shape,
                                          const TargetPose& pose) {
  const auto ray = RayAt(rig, pose.camera, pose.place);
  if (!ray) return std::nullopt;
  const Eigen::Vector3d middle = ray->origin + pose.distance * ray->direction;
  // The side that lies towards `away` in the image moves along z.
  const Eigen::Vector3d axis(std::sin(pose.away), -std::cos(pose.away), 0);
  const Eigen::Matrix3d R = RotationBetween(Eigen::Vector3d::UnitZ(), ray->direction) *
                            ExpRotation(pose.tilt * axis) *
                            ExpRotation(pose.turn * Eigen::Vector3d::UnitZ()) * Facing(shape);
  return RigidTransform{R, middle - R * MiddleOf(shape)};
}

std::vector<RigidTransform> ExecutedPoses(const RigidTransform& T_camera_target,
                                          const ViewTarget& shape,
                                          double angle,
                                          double part) {
  const Eigen::Vector3d middle = T_camera_target * MiddleOf(shape);
  // Errors of one sigma along the directions in turn; the third is one of the distance, too.
  static constexpr std::array<std::array<double, 3>, 7> kErrors{
      {{0, 0, 0}, {1, 0, 0}, {-1, 0, 0}, {0, 1, 0}, {0, -1, 0}, {0, 0, 1}, {0, 0, -1}}};
  std::vector<RigidTransform> executed;
  for (const auto& error : kErrors) {
    const Eigen::Matrix3d R =
        ExpRotation(angle * Eigen::Vector3d(error[0], error[1], error[2])) * T_camera_target.R;
    const Eigen::Vector3d place = (1 + part * error[2]) * middle;
    executed.push_back({R, place - R * MiddleOf(shape)});
  }
  return executed;
}

bool LookDifferent(const TargetPose& a, const TargetPose& b, ImageSize image_size) {
  if (a.camera != b.camera) return true;
  constexpr double kAngle = 20 * std::numbers::pi / 180, kDistance = 0.2, kPart = 1.0 / 3;
  // Of the angle between the normals.
  const double cosine = std::sin(a.tilt) * std::sin(b.tilt) * std::cos(a.away - b.away) +
                        std::cos(a.tilt) * std::cos(b.tilt);
  return cosine < std::cos(kAngle) || a.turn != b.turn ||
         std::abs(a.distance - b.distance) > kDistance * std::max(a.distance, b.distance) ||
         std::abs(a.place.x() - b.place.x()) > kPart * image_size[0] ||
         std::abs(a.place.y() - b.place.y()) > kPart * image_size[1];
}

}  // namespace plenocal
