// SPDX-License-Identifier: Apache-2.0
#include "engine/resample/virtual_image.h"

#include <array>
#include <cmath>
#include <vector>

#include "calib/base/format_error.h"
#include "calib/base/invert_map.h"
#include "calib/camera/rays.h"
#include "calib/space/point_fit.h"

namespace plenocal {

VirtualImage::VirtualImage(const CalibratedCamera& camera) : camera_(camera) {
  if (camera.model->measured.size() != 2 || camera.model->context.size() != 2) {
    throw InputError("camera '{}': {} has no micro lenses", camera.name, camera.model->name);
  }
  const Eigen::Vector2d size(camera.image_size[0], camera.image_size[1]);
  const auto fail = [&] {
    throw JobError("camera '{}': its calibration images hardly any pixel", camera.name);
  };
  std::vector<Ray> rays;
  for (const double x : {0.1, 0.5, 0.9}) {
    for (const double y : {0.1, 0.5, 0.9}) {
      const Eigen::Vector2d q = size.cwiseProduct(Eigen::Vector2d(x, y));
      if (const auto ray = RayOf(q, q)) rays.push_back(*ray);
    }
  }
  const auto centre = NearestToRays(rays);
  if (!centre) fail();
  centre_ = centre->position;

  // The optical axis, by the scale in the middle of the image.
  c_ = size / 2;
  for (int i = 0; i < 2; ++i) {
    const auto at = Direction(c_), right = Direction(c_ + Eigen::Vector2d(1, 0)),
               below = Direction(c_ + Eigen::Vector2d(0, 1));
    if (!at || !right || !below) fail();
    f_ = {1 / (right->hnormalized() - at->hnormalized()).norm(),
          1 / (below->hnormalized() - at->hnormalized()).norm()};
    const auto c = Place(Eigen::Vector3d::UnitZ());
    if (!c) fail();
    c_ = *c;
  }
}

RigidTransform VirtualImage::ViewFromCamera() const {
  return {Eigen::Matrix3d::Identity(), -centre_};
}

std::optional<Ray> VirtualImage::RayOf(const Eigen::Vector2d& place,
                                       const Eigen::Vector2d& lens) const {
  const double values[kMaxObservationSize] = {place.x(), place.y(), lens.x(), lens.y()};
  return Unproject(camera_, values);
}

std::optional<Eigen::Vector3d> VirtualImage::Direction(const Eigen::Vector2d& q) const {
  const auto ray = RayOf(q, q);
  if (!ray) return std::nullopt;
  return ray->direction;
}

std::optional<Eigen::Vector2d> VirtualImage::Place(const Eigen::Vector3d& direction) const {
  if (!(direction.z() > 0)) return std::nullopt;
  const Eigen::Vector2d goal = direction.hnormalized();
  constexpr double kLastStep = 1e-6;  // px
  // Steps by the scale on the axis: the distortion of a lens changes it by some percent.
  const auto map = [&](const Eigen::Vector2d& q, Eigen::Vector2d* image, Eigen::Matrix2d* slope) {
    const auto at = Direction(q);
    if (at) *image = at->hnormalized();
    *slope = f_.cwiseInverse().asDiagonal();
    return at.has_value();
  };
  return InvertMap<2>(map, goal, c_ + f_.cwiseProduct(goal), kLastStep);
}

std::optional<Eigen::Vector3d> VirtualImage::Point(const Eigen::Vector2d& q,
                                                   double inverse_depth) const {
  // As far as micro images that see one point are apart; the distortion is even over so little.
  constexpr double kReach = 10;  // px
  const Eigen::Vector2d reach(kReach, 0);
  const auto through = [&](const Eigen::Vector2d& lens) {
    return RayOf(lens + inverse_depth * (q - lens), lens);
  };
  const auto a = through(q - reach), b = through(q + reach);
  if (!a || !b) return std::nullopt;
  const auto meeting = NearestToRays(std::array{*a, *b});
  if (!meeting) return std::nullopt;
  const Eigen::Vector3d p = meeting->position - centre_;
  if (!(p.z() > 0) || !p.allFinite()) return std::nullopt;
  return p;
}

std::optional<VirtualImage::UncertainPoint> VirtualImage::Point(const Eigen::Vector2d& q,
                                                                double inverse_depth,
                                                                double sigma) const {
  constexpr double kStep = 1e-5;  // of an inverse depth of some tenths
  const auto p = Point(q, inverse_depth), further = Point(q, inverse_depth + kStep);
  if (!p || !further) return std::nullopt;
  return UncertainPoint{*p, std::abs(further->z() - p->z()) / kStep * sigma};
}

ImageSize VirtualImage::SizeAt(ImageSize raw, double scale) {
  return {static_cast<int>(std::ceil(raw[0] / scale)), static_cast<int>(std::ceil(raw[1] / scale))};
}

SeenImage VirtualImage::Seen(double scale) const {
  SeenImage image{.name = camera_.name,
                  .size = SizeAt(camera_.image_size, scale),
                  .direction = {},
                  .f = f_ / scale,
                  .c = c_ / scale};
  image.direction = [this, scale](const Eigen::Vector2d& place) {
    return Direction(scale * place);
  };
  return image;
}

}  // namespace plenocal
