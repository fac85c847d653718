// SPDX-License-Identifier: Apache-2.0
#include "engine/resample/rectify.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <map>
#include <optional>
#include <set>
#include <string>
#include <utility>

#include "calib/base/format_error.h"
#include "calib/camera/rays.h"

namespace plenocal {
namespace {

/// The row of a measured point in the rectified view.
std::optional<double> RectifiedRow(const CalibratedCamera& view,
                                   const Eigen::Matrix3d& R_view_camera,
                                   const CalibratedCamera& camera,
                                   const Observation& observation) {
  const auto ray = Unproject(camera, observation.values.data());
  double u[2];
  if (!ray || !Project(view, observation.values.data(), R_view_camera * ray->direction, u)) {
    return std::nullopt;
  }
  return u[1];
}

}  // namespace

RectifiedPair Rectify(const CalibratedCamera& first,
                      const CalibratedCamera& second,
                      const ViewOptions& options) {
  const RigidTransform T_first_second = first.T_camera_rig * second.T_camera_rig.Inverse();
  const Eigen::Vector3d baseline = T_first_second.t;
  const Eigen::Matrix3d axes = Eigen::Matrix3d::Identity() + T_first_second.R;  // sums of both
  // Less than this part of the forward direction across the baseline, and the views look past what
  // the cameras see.
  constexpr double kLeastAcross = 0.1;
  const auto refuse = [&](const char* why) {
    throw JobError(
        "cameras '{}' and '{}' {}, so that they cannot be rectified", first.name, second.name, why);
  };
  if (!(baseline.norm() > 0)) refuse("stand in one place");
  RectifiedPair pair;
  Eigen::Vector3d x = baseline.normalized();
  pair.turned = std::abs(x.dot(axes.col(1))) > std::abs(x.dot(axes.col(0)));
  // Upright images; of turned ones those with positive disparities.
  if (!pair.turned && x.dot(axes.col(0)) < 0) x = -x;
  pair.baseline = baseline.dot(x);
  const Eigen::Vector3d forward = axes.col(2);
  const Eigen::Vector3d across = forward - x * x.dot(forward);
  if (!(across.norm() > kLeastAcross * 2)) refuse("look along their baseline or at each other");
  const Eigen::Vector3d z = across.normalized();
  Eigen::Matrix3d& R_view_first = pair.R_view_camera[0];
  R_view_first.row(0) = x;
  R_view_first.row(1) = z.cross(x);
  R_view_first.row(2) = z;
  pair.R_view_camera[1] = R_view_first * T_first_second.R;

  ViewOptions chosen = options;
  if (!chosen.size) chosen.size = first.image_size;
  if (!options.size && pair.turned) std::swap((*chosen.size)[0], (*chosen.size)[1]);
  const std::array images{ImageOf(first, pair.R_view_camera[0]),
                          ImageOf(second, pair.R_view_camera[1])};
  pair.views.fill(ChoosePinhole(images, chosen));
  pair.views[0].name = first.name;
  pair.views[1].name = second.name;
  pair.views[1].T_camera_rig.t.x() = -pair.baseline;
  return pair;
}

std::array<double, 12> RectifiedPair::ProjectionMatrix(size_t view) const {
  const std::vector<double>& p = views[view].params;
  return {p[0], 0, p[2], p[0] * views[view].T_camera_rig.t.x(), 0, p[1], p[3], 0, 0, 0, 1, 0};
}

EpipolarErrors MeasureEpipolarErrors(const RectifiedPair& pair,
                                     const std::array<const CalibratedCamera*, 2>& cameras,
                                     const std::array<std::vector<View>, 2>& views) {
  std::map<std::pair<std::string, int>, double> first_rows;
  const auto for_each = [&](size_t c, const auto& take) {
    for (const View& view : views[c]) {
      for (const Observation& observation : view.observations) {
        const auto row =
            RectifiedRow(pair.views[c], pair.R_view_camera[c], *cameras[c], observation);
        if (row) take(std::pair(view.frame, observation.marker), *row);
      }
    }
  };
  for_each(0, [&](const auto& key, double row) { first_rows[key] = row; });
  EpipolarErrors errors;
  std::set<std::string> frames;
  for_each(1, [&](const auto& key, double row) {
    const auto found = first_rows.find(key);
    if (found == first_rows.end()) return;
    const double error = std::abs(row - found->second);
    ++errors.points;
    frames.insert(key.first);
    errors.mean_absolute += error;
    errors.rms += error * error;
    errors.largest = std::max(errors.largest, error);
  });
  errors.frames = frames.size();
  if (errors.points == 0) return errors;
  errors.mean_absolute /= static_cast<double>(errors.points);
  errors.rms = std::sqrt(errors.rms / static_cast<double>(errors.points));
  return errors;
}

}  // namespace plenocal
