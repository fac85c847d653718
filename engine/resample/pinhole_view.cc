// SPDX-License-Identifier: Apache-2.0
#include "engine/resample/pinhole_view.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numbers>
#include <vector>

#include "calib/base/format_error.h"
#include "calib/base/number_limits.h"
#include "calib/camera/rays.h"
#include "engine/resample/pixel_map.h"
#include "models/registry.h"

namespace plenocal {
namespace {

/// The point in which a direction meets the plane at distance 1.
using PlanePoint = Eigen::Vector2d;

struct Intrinsics {
  Eigen::Vector2d f, c;  // px
};

/// The centre of the image, px.
Eigen::Vector2d Middle(ImageSize size) { return {(size[0] - 1) / 2.0, (size[1] - 1) / 2.0}; }

/// The edge of what the camera sees as the view has it: walked from the image's centre to places on
/// its border, as far as the directions stay before the view.
struct Edge {
  PlanePoint centre;
  std::vector<PlanePoint> points;
  bool open = false;  // somewhere it reaches 90 degrees from the view's axis
};

Edge EdgeOf(const SeenImage& image) {
  constexpr int kPlaces = 200;   // along each side
  constexpr int kHalvings = 50;  // of the way to the border
  constexpr double kFlattest =
      0.01;  // z of a direction in a plane image: 89.4 degrees off the axis
  const auto turned = [&](const Eigen::Vector2d& pixel) -> std::optional<Eigen::Vector3d> {
    const auto direction = image.direction(pixel);
    if (!direction) return std::nullopt;
    return image.R_view_camera * *direction;
  };
  const auto on_plane = [&](const Eigen::Vector2d& pixel) -> std::optional<PlanePoint> {
    const auto direction = turned(pixel);
    if (!direction || !(direction->z() > kFlattest)) return std::nullopt;
    return PlanePoint(direction->hnormalized());
  };
  const ImageSize size = image.size;
  const Eigen::Vector2d middle = Middle(size);
  Edge edge;
  const auto centre = on_plane(middle);
  if (!centre) {
    throw JobError(
        "camera '{}': the middle of its image looks away from the new view; "
        "no plane image holds both",
        image.name);
  }
  edge.centre = *centre;
  for (int side = 0; side < 4; ++side) {
    for (int i = 0; i < kPlaces; ++i) {
      const double along = static_cast<double>(i) / kPlaces;
      const std::array<Eigen::Vector2d, 4> places{Eigen::Vector2d(along, 0),
                                                  Eigen::Vector2d(1, along),
                                                  Eigen::Vector2d(1 - along, 1),
                                                  Eigen::Vector2d(0, 1 - along)};
      const Eigen::Vector2d border =
          places[static_cast<size_t>(side)].cwiseProduct(Eigen::Vector2d(size[0], size[1])) -
          Eigen::Vector2d::Constant(0.5);
      std::optional<PlanePoint> point = on_plane(border);
      double inside = 0, outside = 1;
      for (int k = 0; !point && k < kHalvings; ++k) {
        const double between = (inside + outside) / 2;
        (on_plane(middle + between * (border - middle)) ? inside : outside) = between;
      }
      if (!point) {
        point = on_plane(middle + inside * (border - middle));
        const auto beyond = turned(middle + outside * (border - middle));
        edge.open = edge.open || (beyond && !(beyond->z() > kFlattest));
      }
      edge.points.push_back(*point);
    }
  }
  return edge;
}

/// Square pixels about the middle of the image by the balance.
Intrinsics Balanced(const std::vector<Edge>& edges,
                    const PlanePoint& centre,
                    ImageSize size,
                    std::span<const SeenImage> images,
                    double balance) {
  // f of a view of which the point lies on the border
  const auto focal = [&](const PlanePoint& point) {
    const PlanePoint from = (point - centre).cwiseAbs();
    return std::min(size[0] / 2.0 / from.x(), size[1] / 2.0 / from.y());
  };
  double all_valid = 0, all_seen = std::numeric_limits<double>::infinity();
  for (size_t i = 0; i < edges.size(); ++i) {
    if (edges[i].open && balance > 0) {
      throw InputError(
          "camera '{}' sees 90 degrees off the axis and more, which no plane "
          "image holds; choose the field of view with --fov",
          images[i].name);
    }
    for (const PlanePoint& point : edges[i].points) {
      all_valid = std::max(all_valid, focal(point));
      all_seen = std::min(all_seen, focal(point));
    }
  }
  // In proportion of what is seen, not of its inverse f.
  const double f = balance > 0 ? 1 / ((1 - balance) / all_valid + balance / all_seen) : all_valid;
  return {Eigen::Vector2d::Constant(f), Middle(size) - f * centre};
}

Intrinsics Choose(std::span<const SeenImage> images, ImageSize size, const ViewOptions& options) {
  if (options.fov) {
    const double f = size[0] / 2.0 / std::tan(*options.fov / 2 * std::numbers::pi / 180);
    return {Eigen::Vector2d::Constant(f), Middle(size)};
  }
  const ImageSize first_size = images[0].size;
  const double scale = std::min(static_cast<double>(size[0]) / first_size[0],
                                static_cast<double>(size[1]) / first_size[1]);
  if (!options.balance && images.size() == 1 && images[0].R_view_camera.isIdentity()) {
    return {scale * images[0].f, Middle(size) + scale * (images[0].c - Middle(first_size))};
  }
  std::vector<Edge> edges;
  PlanePoint centre = PlanePoint::Zero();
  double f = 0;
  for (const SeenImage& image : images) {
    edges.push_back(EdgeOf(image));
    centre += edges.back().centre / static_cast<double>(images.size());
    f += image.f.mean() / static_cast<double>(images.size());
  }
  if (options.balance) return Balanced(edges, centre, size, images, *options.balance);
  f *= scale;
  return {Eigen::Vector2d::Constant(f), Middle(size) - f * centre};
}

}  // namespace

SeenImage ImageOf(const CalibratedCamera& camera, const Eigen::Matrix3d& R_view_camera) {
  RequireCentral(camera);
  SeenImage image{.name = camera.name,
                  .size = camera.image_size,
                  .direction = {},
                  .f = {},
                  .c = {},
                  .R_view_camera = R_view_camera};
  image.direction = [&camera](const Eigen::Vector2d& place) -> std::optional<Eigen::Vector3d> {
    const double values[kMaxObservationSize] = {place.x(), place.y()};
    const auto ray = Unproject(camera, values);
    if (!ray) return std::nullopt;
    return ray->direction;
  };
  const double values[kMaxObservationSize] = {};
  Eigen::Matrix<double, 2, 3, Eigen::RowMajor> J_point;
  if (!camera.model->ProjectWithJacobian(
          camera.params.data(),
          camera.config.data(),
          values,
          Eigen::Vector3d::UnitZ(),
          {.predicted = image.c.data(), .J_point = J_point.data()})) {
    throw JobError("camera '{}' does not image its optical axis", camera.name);
  }
  image.f = {J_point.col(0).norm(), J_point.col(1).norm()};
  return image;
}

CalibratedCamera ChoosePinhole(std::span<const SeenImage> images, const ViewOptions& options) {
  if (options.fov) RequireWithin("fov", *options.fov, 1, 175);
  if (options.balance) RequireWithin("balance", *options.balance, 0, 1);
  const ImageSize size = options.size.value_or(images[0].size);
  const Intrinsics chosen = Choose(images, size, options);
  CalibratedCamera view;
  view.model = FindModel(CameraModels(), "pinhole");
  view.image_size = size;
  view.params = {chosen.f.x(), chosen.f.y(), chosen.c.x(), chosen.c.y()};
  if (!WithinBounds(*view.model, view.params.data())) {
    throw JobError(
        "camera '{}': its plane image has focal lengths of {} and {} px, which no camera has",
        images[0].name,
        chosen.f.x(),
        chosen.f.y());
  }
  return view;
}

CalibratedCamera UndistortedView(const CalibratedCamera& camera, const ViewOptions& options) {
  const std::array seen{ImageOf(camera, Eigen::Matrix3d::Identity())};
  CalibratedCamera view = ChoosePinhole(seen, options);
  view.name = camera.name;
  view.T_camera_rig = camera.T_camera_rig;
  return view;
}

}  // namespace plenocal
