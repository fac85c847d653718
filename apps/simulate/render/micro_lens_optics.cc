// SPDX-License-Identifier: Apache-2.0
#include "apps/simulate/render/micro_lens_optics.h"

#include <fmt/format.h>

#include <Eigen/Geometry>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <numbers>

#include "calib/base/format_error.h"
#include "calib/base/invert_map.h"
#include "calib/camera/lens_lattice.h"

namespace plenocal::simulate {
namespace {

[[noreturn]] void Fail(const CameraSpec& camera, const std::string& message) {
  throw InputError("cameras.{}: {}", camera.name, message);
}

int LensType(const MicroLensSpec& spec, const LatticeNode& node) {
  const LensPattern repeats{.columns = static_cast<int>(spec.pattern.cols()),
                            .rows = static_cast<int>(spec.pattern.rows())};
  const int set = repeats.Set(node);
  return spec.pattern(set / repeats.columns, set % repeats.columns);
}

}  // namespace

MicroLensOptics::MicroLensOptics(const CameraSpec& camera) : camera_(camera) {
  FindPrincipalPoint();
  const MicroLensSpec& spec = *camera.micro_lenses;
  const bool hexagonal = spec.lattice == LatticeKind::kHexagonal;
  const double step = hexagonal ? std::numbers::pi / 3 : std::numbers::pi / 2;
  const double row_pitch = hexagonal ? spec.pitch : spec.row_pitch;
  const double least = std::min(spec.pitch, row_pitch);
  basis_.col(0) = Eigen::Rotation2Dd(spec.rotation) * Eigen::Vector2d(spec.pitch, 0);
  basis_.col(1) = Eigen::Rotation2Dd(spec.rotation + step) * Eigen::Vector2d(row_pitch, 0);
  origin_ = principal_ + spec.offset;

  // Rows and columns are oblique, so that they run farther than the image's diagonal.
  const Eigen::Vector2d size(camera.image_size[0], camera.image_size[1]);
  const double reach = size.norm() + (origin_ - size / 2).norm() + 2 * spec.pitch;
  const double steps = reach / (least * std::cos(step / 2));
  constexpr double kMostSteps = 5000;  // of a hundred million nodes in both directions
  if (!(steps < kMostSteps)) {
    Fail(camera,
         fmt::format("from its principal point at ({:.6g}, {:.6g}) px micro lenses of this pitch "
                     "would fill more than {:.0f} rows up to the image's corners",
                     principal_.x(),
                     principal_.y(),
                     kMostSteps));
  }
  most_ = static_cast<int>(steps) + 2;
  const int count = 2 * most_ + 1;
  index_.setConstant(count, count, -1);
  for (int row = -most_; row <= most_; ++row) {
    for (int column = -most_; column <= most_; ++column) {
      const Eigen::Vector2d regular = origin_ + basis_ * Eigen::Vector2d(column, row);
      // Distortion does not move a centre from here onto the sensor.
      if (!IsInside(regular, camera.image_size, 0.2 * size.maxCoeff())) continue;
      const auto centre = CentreOf(regular);
      if (!centre || !IsInside(*centre, camera.image_size, spec.pitch)) continue;
      const int type = LensType(spec, {column, row});
      index_(column + most_, row + most_) = static_cast<int>(lenses_.size());
      lenses_.push_back({.row = row, .column = column, .centre = *centre, .type = type});
    }
  }
  constexpr size_t kFewest = 30;  // that a lattice with three types is recognised by
  if (lenses_.size() < kFewest) {
    Fail(camera, fmt::format("only {} micro lenses fit on the sensor", lenses_.size()));
  }
}

std::optional<Ray> MicroLensOptics::RayThrough(const Eigen::Vector2d& x,
                                               const Eigen::Vector2d& c) const {
  const std::array values{x.x(), x.y(), c.x(), c.y()};
  return camera_.model->Unproject(camera_.params.data(), camera_.config.data(), values.data());
}

std::optional<Eigen::Vector2d> MicroLensOptics::Slope(const Eigen::Vector2d& c) const {
  const std::optional<Ray> ray = RayThrough(c, c);
  if (!ray || !(ray->direction.z() > 0)) return std::nullopt;
  return ray->direction.head<2>() / ray->direction.z();
}

void MicroLensOptics::FindPrincipalPoint() {
  const Eigen::Vector2d middle =
      Eigen::Vector2d(camera_.image_size[0] - 1.0, camera_.image_size[1] - 1.0) / 2;
  const double h = 1;  // px; slopes are smooth over many pixels
  const auto map = [&](const Eigen::Vector2d& c, Eigen::Vector2d* slope, Eigen::Matrix2d* by_c) {
    const auto at = Slope(c);
    for (int k = 0; at && k < 2; ++k) {
      const Eigen::Vector2d d = h * Eigen::Vector2d::Unit(k);
      const auto plus = Slope(c + d), minus = Slope(c - d);
      if (!plus || !minus) return false;
      by_c->col(k) = (*plus - *minus) / (2 * h);
    }
    if (at) *slope = *at;
    return at.has_value();
  };
  const auto found = InvertMap(map, Eigen::Vector2d(0, 0), middle, 1e-10);
  Eigen::Vector2d slope;
  if (!found || !map(*found, &slope, &slope_by_px_)) {
    Fail(camera_, "its model sees nothing at the principal point");
  }
  principal_ = *found;
  px_by_slope_ = slope_by_px_.inverse();

  // Two rays through the pupil's middle; where they are nearest to each other.
  const double aside = 0.2 * camera_.image_size[0];
  const auto a =
      RayThrough(principal_ + Eigen::Vector2d(aside, 0), principal_ + Eigen::Vector2d(aside, 0));
  const auto b =
      RayThrough(principal_ - Eigen::Vector2d(aside, 0), principal_ - Eigen::Vector2d(aside, 0));
  if (!a || !b) Fail(camera_, "its model does not see the middle half of the image");
  const Eigen::Vector3d between = a->origin - b->origin;
  const Eigen::Vector3d difference = a->direction - b->direction;
  const double along = -between.dot(difference) / difference.squaredNorm();
  pupil_ = (a->origin + b->origin + along * (a->direction + b->direction)) / 2;
}

std::optional<Eigen::Vector2d> MicroLensOptics::FromSlope(const Eigen::Vector2d& slope) const {
  const Eigen::Vector2d start = principal_ + px_by_slope_ * slope;
  // The distortion changes slowly, so its absence is a good enough derivative.
  const auto map = [&](const Eigen::Vector2d& c, Eigen::Vector2d* image, Eigen::Matrix2d* by_c) {
    const auto at = Slope(c);
    if (at) *image = *at;
    *by_c = slope_by_px_;
    return at.has_value();
  };
  return InvertMap(map, slope, start, 1e-11 * (1 + start.norm()));
}

std::optional<Eigen::Vector2d> MicroLensOptics::CentreOf(const Eigen::Vector2d& regular) const {
  if (!camera_.micro_lenses->regular_in_raw) {
    return FromSlope(slope_by_px_ * (regular - principal_));
  }
  return Slope(regular) ? std::optional(regular) : std::nullopt;
}

MicroLensArray MicroLensOptics::Array() const {
  MicroLensArray array;
  array.image_size = camera_.image_size;
  array.types = static_cast<int>(camera_.micro_lenses->focus.size());
  for (const MicroLens& lens : lenses_) {
    if (IsInside(lens.centre, camera_.image_size)) array.lenses.push_back(lens);
  }
  SetLatticeVectors(&array);
  return array;
}

std::optional<Eigen::Vector2d> MicroLensOptics::CentralImage(const Eigen::Vector3d& p_cam) const {
  const Eigen::Vector3d from_pupil = p_cam - pupil_;
  if (!(from_pupil.z() > 0)) return std::nullopt;
  return FromSlope(from_pupil.head<2>() / from_pupil.z());
}

std::vector<Observation> MicroLensOptics::Observe(int marker, const Eigen::Vector3d& p_cam) const {
  const MicroLensSpec& spec = *camera_.micro_lenses;
  const auto project = [&](const Eigen::Vector2d& c) -> std::optional<Eigen::Vector2d> {
    const double values[kMaxObservationSize] = {0, 0, c.x(), c.y()};
    Eigen::Vector2d x;
    if (!camera_.model->Project(
            camera_.params.data(), camera_.config.data(), values, p_cam, x.data())) {
      return std::nullopt;
    }
    return x;
  };
  const auto q = CentralImage(p_cam);
  if (!q || !IsInside(*q, camera_.image_size, camera_.image_size[0])) return {};
  // x = c + (q - c) / T: a pitch beside q the offset is pitch / T.
  const auto beside = project(*q + Eigen::Vector2d(spec.pitch, 0));
  if (!beside) return {};
  const double inverse_T = (q->x() + spec.pitch - beside->x()) / spec.pitch;
  // All of the pixel that the point falls on shall be within the micro image.
  const double radius = spec.fill * spec.pitch / 2 - 1;
  // Two pitches more, for what distortion does to the lattice.
  const double reach = radius / std::max(std::abs(inverse_T), 1e-3) + 2 * spec.pitch;

  std::vector<Observation> seen;
  const auto slope = Slope(*q);
  if (!slope) return {};
  const Eigen::Vector2d regular = spec.regular_in_raw ? *q : principal_ + px_by_slope_ * *slope;
  const Eigen::Vector2d node = basis_.inverse() * (regular - origin_);
  const double least = basis_.colwise().norm().minCoeff();
  const int steps = static_cast<int>(reach / (least * std::cos(std::numbers::pi / 6))) + 1;
  const int middle_row = static_cast<int>(std::lround(node.y()));
  const int middle_column = static_cast<int>(std::lround(node.x()));
  for (int row = std::max(middle_row - steps, -most_); row <= std::min(middle_row + steps, most_);
       ++row) {
    for (int column = std::max(middle_column - steps, -most_);
         column <= std::min(middle_column + steps, most_);
         ++column) {
      const int index = index_(column + most_, row + most_);
      if (index < 0) continue;
      const Eigen::Vector2d& centre = lenses_[static_cast<size_t>(index)].centre;
      if (!IsInside(centre, camera_.image_size)) continue;
      const auto x = project(centre);
      if (!x || (*x - centre).norm() > radius || !IsInside(*x, camera_.image_size)) continue;
      seen.push_back({.marker = marker, .values = {x->x(), x->y(), centre.x(), centre.y()}});
    }
  }
  return seen;
}

}  // namespace plenocal::simulate
