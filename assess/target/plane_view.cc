// SPDX-License-Identifier: Apache-2.0
#include "assess/target/plane_view.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "calib/base/linear_algebra.h"
#include "calib/base/statistics.h"

namespace plenocal {
namespace {

// Observations of one marker in one view.
using Seen = std::vector<const Observation*>;

// The virtual image point p of x = (1 - 1/v) c + p/v, by least squares.
std::optional<Eigen::Vector2d> VirtualPoint(const Seen& seen) {
  constexpr size_t kLeast = 3;  // micro lenses: 6 equations for 3 unknowns
  if (seen.size() < kLeast) return std::nullopt;
  const auto count = static_cast<double>(seen.size());
  Eigen::Vector2d mean_x(0, 0), mean_c(0, 0);
  for (const Observation* o : seen) {
    mean_x += Eigen::Vector2d(o->values[0], o->values[1]) / count;
    mean_c += Eigen::Vector2d(o->values[2], o->values[3]) / count;
  }
  double cross = 0, square = 0;
  for (const Observation* o : seen) {
    const Eigen::Vector2d c = Eigen::Vector2d(o->values[2], o->values[3]) - mean_c;
    cross += c.dot(Eigen::Vector2d(o->values[0], o->values[1]) - mean_x);
    square += c.squaredNorm();
  }
  constexpr double kSmallestSlope = 0.02;  // of x - c: virtual depths of 50 pitches
  const double slope = cross / square;
  if (!(std::abs(1 - slope) > kSmallestSlope)) return std::nullopt;
  return Eigen::Vector2d((mean_x - slope * mean_c) / (1 - slope));
}

double TypicalSpacing(const std::vector<PlanePoint>& points) {
  std::vector<double> nearest;
  for (const PlanePoint& point : points) {
    double best = std::numeric_limits<double>::infinity();
    for (const PlanePoint& other : points) {
      if (other.marker != point.marker) {
        best = std::min(best, (other.image - point.image).norm());
      }
    }
    nearest.push_back(best);
  }
  return Median(nearest);
}

}  // namespace

std::vector<PlaneView> MakePlaneViews(const CameraInput& camera, size_t limit, size_t least) {
  std::vector<PlaneView> views;
  for (const View& view : camera.views) {
    std::map<int, Seen> by_marker;
    for (const Observation& o : view.observations) by_marker[o.marker].push_back(&o);
    PlaneView plane;
    for (const auto& [marker, seen] : by_marker) {
      const std::optional<Eigen::Vector2d> at =
          camera.model->plenoptic
              ? VirtualPoint(seen)
              : Eigen::Vector2d(seen.front()->values[0], seen.front()->values[1]);
      if (at) plane.points.push_back({marker, *at});
    }
    if (plane.points.size() < least) continue;
    plane.spacing = TypicalSpacing(plane.points);
    plane.centre = Eigen::Vector2d(camera.image_size[0] - 1, camera.image_size[1] - 1) / 2;
    plane.radius = plane.centre.norm();
    views.push_back(std::move(plane));
  }
  std::stable_sort(views.begin(), views.end(), [](const PlaneView& a, const PlaneView& b) {
    return a.points.size() > b.points.size();
  });
  views.resize(std::min(views.size(), limit));
  return views;
}

std::optional<MarkerPlane> FindPlane(const std::map<int, Eigen::Vector3d>& markers) {
  if (markers.size() < 4) return std::nullopt;
  MarkerPlane plane;
  plane.middle.setZero();
  for (const auto& [number, p] : markers) plane.middle += p / static_cast<double>(markers.size());
  Eigen::Matrix3d scatter = Eigen::Matrix3d::Zero();
  for (const auto& [number, p] : markers) {
    scatter += (p - plane.middle) * (p - plane.middle).transpose();
    plane.extent = std::max(plane.extent, (p - plane.middle).norm());
  }
  const SymmetricEigen3 axes = DecomposeSymmetric(scatter);
  // A bent board is still one plane here; tags on the faces of a box are not.
  constexpr double kFlat = 0.05;
  if (!(axes.values[0] < kFlat * kFlat * axes.values[1])) return std::nullopt;
  plane.y = axes.vectors.col(1);
  plane.x = axes.vectors.col(2);
  return plane;
}

}  // namespace plenocal
