// SPDX-License-Identifier: Apache-2.0
#include "assess/central_view.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

#include "calib/base/format_error.h"
#include "calib/base/number_limits.h"
#include "calib/base/statistics.h"
#include "calib/camera/rays.h"

namespace plenocal {
namespace {

constexpr const char* kExactAt = "exact_at";

// Of the middle of the target's markers, over the frames.
double MedianDistance(const CalibrationRecord& calibration, const CalibratedCamera& camera) {
  const auto c = static_cast<size_t>(&camera - calibration.cameras.data());
  Eigen::Vector3d middle = Eigen::Vector3d::Zero();
  for (const auto& [number, marker] : calibration.markers) middle += marker.position;
  if (!calibration.markers.empty()) middle /= static_cast<double>(calibration.markers.size());
  std::vector<double> distances;
  for (size_t frame = 0; frame < calibration.frames.size(); ++frame) {
    const Eigen::Vector3d p = calibration.CameraFromTarget(c, static_cast<int>(frame)) * middle;
    if (p.allFinite()) distances.push_back(p.norm());
  }
  if (distances.empty()) {
    throw InputError(
        "camera '{}': the rays of {} have no common origin, so that a map of pixels is exact at "
        "one distance, and there are no frames with the target's; give a distance (--distance METRES)",
        camera.name,
        camera.model->name);
  }
  return Median(std::move(distances));
}

// `self` of the central model.
const RaysAtDistance& RaysOf(const CameraModel& model) {
  return *static_cast<const RaysAtDistance*>(model.self);
}

// The point (p / |p|, 1 / distance) on the ray of the original.
bool ProjectAtDistance(const CameraModel& model,
                       const double* params,
                       const double* config,
                       const double* values,
                       const Eigen::Vector3d& p,
                       double /*h*/,
                       double* predicted) {
  const RaysAtDistance& rays = RaysOf(model);
  return rays.model->Project(
      params, config, values, p.stableNormalized(), predicted, rays.inverse_distance);
}

bool DifferentiateAtDistance(const CameraModel& model,
                             const double* params,
                             const double* config,
                             const double* values,
                             const Eigen::Vector3d& p,
                             double /*h*/,
                             const ProjectionOutput& out) {
  const RaysAtDistance& rays = RaysOf(model);
  const double length = p.stableNorm();
  const Eigen::Vector3d unit = p / length;
  if (!rays.model->ProjectWithJacobian(params, config, values, unit, out, rays.inverse_distance)) {
    return false;
  }
  for (size_t r = 0; r < model.measured.size(); ++r) {
    Eigen::Map<Eigen::RowVector3d> by_point(out.J_point + 3 * r);
    by_point = ((by_point - by_point.dot(unit) * unit.transpose()) / length).eval();
    if (out.J_h != nullptr) out.J_h[r] = 0;
  }
  return true;
}

std::optional<Ray> UnprojectToDistance(const CameraModel& model,
                                       const double* params,
                                       const double* config,
                                       const double* values) {
  const RaysAtDistance& rays = RaysOf(model);
  const std::optional<Ray> ray = rays.model->Unproject(params, config, values);
  if (!ray) return std::nullopt;
  // lambda >= 0 with |h origin + lambda direction| = 1.
  const Eigen::Vector3d o = rays.inverse_distance * ray->origin;
  const double along = o.dot(ray->direction), rest = 1 - o.squaredNorm() + along * along;
  if (!(rest > 0)) return std::nullopt;
  return Ray{Eigen::Vector3d::Zero(),
             (o + (std::sqrt(rest) - along) * ray->direction).normalized()};
}

}  // namespace

CentralView::CentralView(const CalibrationRecord& calibration,
                         const CalibratedCamera& camera,
                         std::optional<double> distance)
    : original_(camera) {
  if (distance) RequireWithin("distance", *distance, 1e-3, std::numeric_limits<double>::infinity());
  if (camera.model->IsCentral() || camera.model->plenoptic) return;
  rays_ = {camera.model, 1 / (distance ? *distance : MedianDistance(calibration, camera))};
  model_ = *camera.model;
  model_.centre = Centre::kPoint;
  model_.homogeneous = true;
  model_.self = &rays_;
  model_.functions = {.project = &ProjectAtDistance,
                      .project_with_jacobian = &DifferentiateAtDistance,
                      .unproject = &UnprojectToDistance};
  camera_ = camera;
  camera_.model = &model_;
  FindLargestError();
}

void CentralView::FindLargestError() {
  constexpr int kSteps = 16;
  for (int row = 0; row <= kSteps; ++row) {
    for (int column = 0; column <= kSteps; ++column) {
      const double u[kMaxObservationSize] = {(camera_.image_size[0] - 1.0) * column / kSteps,
                                             (camera_.image_size[1] - 1.0) * row / kSteps};
      const auto ray = Unproject(original_, u);
      if (!ray) continue;
      for (const double inverse :
           rays_.inverse_distance > 0
               ? std::vector{rays_.inverse_distance / 2, rays_.inverse_distance * 2}
               : std::vector{1.0}) {
        const Eigen::Vector3d p = inverse * ray->origin + ray->direction;
        Eigen::Vector2d seen;
        if (!Project(camera_, u, p, seen.data())) continue;
        largest_error_ = std::max(largest_error_, (seen - Eigen::Vector2d(u[0], u[1])).norm());
      }
    }
  }
}

std::string CentralView::DistanceText() const {
  return rays_.inverse_distance > 0 ? fmt::format("{:.4g} m", 1 / rays_.inverse_distance)
                                    : "infinite";
}

Provenance CentralView::WithDistance(Provenance provenance) const {
  if (camera_.model == nullptr) return provenance;
  const std::string stated = fmt::format("{} {}", camera_.name, DistanceText());
  if (provenance.empty() || provenance.back().first != kExactAt) {
    provenance.emplace_back(kExactAt, stated);
  } else {
    provenance.back().second += ", " + stated;
  }
  return provenance;
}

void CentralView::Report(const Run& run) const {
  if (camera_.model == nullptr) return;
  run.Message(fmt::format(
      "camera '{}': {} has no single centre; the map is exact at the distance {}, and off by at "
      "most {:.2g} px {}; --distance chooses another",
      camera_.name,
      original_.model->name,
      DistanceText(),
      largest_error_,
      rays_.inverse_distance > 0 ? "at half and at twice it" : "at 1 m"));
}

}  // namespace plenocal
