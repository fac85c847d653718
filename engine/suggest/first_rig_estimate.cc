// SPDX-License-Identifier: Apache-2.0
#include "engine/suggest/first_rig_estimate.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <numbers>

#include "calib/base/format_error.h"

namespace plenocal {
namespace {

constexpr double kUsualSigma = 0.1;                              // px, of good detectors
constexpr double kWidestPinhole = 100 * std::numbers::pi / 180;  // rad

/// Image of a point by the lens of the data sheet; nothing outside the image.
std::optional<Eigen::Vector2d> IdealImage(const FirstCamera& camera, const Eigen::Vector3d& p) {
  const double half = camera.angle / 2, half_width = camera.image_size[0] / 2.0;
  const double off = p.head<2>().norm(), angle = std::atan2(off, p.z());
  const bool pinhole = camera.angle < kWidestPinhole;
  if (pinhole && p.z() <= 0) return std::nullopt;
  const double radius =
      pinhole ? half_width / std::tan(half) * std::tan(angle) : half_width / half * angle;
  const Eigen::Vector2d middle((camera.image_size[0] - 1) / 2.0, (camera.image_size[1] - 1) / 2.0);
  const Eigen::Vector2d u = off > 0 ? Eigen::Vector2d(middle + radius / off * p.head<2>()) : middle;
  const bool inside = u.minCoeff() >= 0 && u.x() <= 2 * middle.x() && u.y() <= 2 * middle.y();
  return inside ? std::optional(u) : std::nullopt;
}

/// A point grid of unit spacing before the camera, as an ideal lens images it.
struct IdealViews {
  std::map<int, Eigen::Vector3d> markers;
  std::vector<View> views;
};

IdealViews ViewsOf(const FirstCamera& camera) {
  constexpr int kSide = 9;
  constexpr double kTilt = 0.5;
  IdealViews ideal;
  for (int i = 0; i < kSide * kSide; ++i) {
    const int column = i % kSide, row = i / kSide;
    ideal.markers[i] = {column - (kSide - 1) / 2.0, row - (kSide - 1) / 2.0, 0};
  }
  for (const double side : {0.0, 0.5, 0.9}) {
    for (int turn = 0; turn < 4; ++turn) {
      const double azimuth = turn * std::numbers::pi / 2;
      const Eigen::Vector3d across(std::sin(azimuth), -std::cos(azimuth), 0);
      const Eigen::Matrix3d sight = ExpRotation(side * camera.angle / 2 * across);
      // As large as a third of the field of view.
      const double distance = kSide / 2.0 / std::tan(std::min(camera.angle, 1.5) / 4);
      const Eigen::Matrix3d R =
          sight * ExpRotation(kTilt * Eigen::Vector3d(std::cos(azimuth), std::sin(azimuth), 0));
      View view{.frame = fmt::format("{}", ideal.views.size()), .observations = {}};
      for (const auto& [number, position] : ideal.markers) {
        const auto u = IdealImage(camera, R * position + sight * Eigen::Vector3d(0, 0, distance));
        if (u) view.observations.push_back({.marker = number, .values = {u->x(), u->y()}});
      }
      if (view.observations.size() >= ideal.markers.size() / 3) ideal.views.push_back(view);
    }
  }
  return ideal;
}

std::vector<double> ParamsOf(const FirstCamera& camera) {
  const IdealViews ideal = ViewsOf(camera);
  const size_t params = camera.model->params.size();
  try {
    return GuessCamera({.name = camera.name,
                        .model = camera.model,
                        .config = {},
                        .initial = std::vector<std::optional<double>>(params),
                        .fixed = std::vector<bool>(params, false),
                        .image_size = camera.image_size,
                        .views = ideal.views},
                       ideal.markers)
        .params;
  } catch (const Error&) {
    throw InputError(
        "{}: the model {} does not describe a lens of {:.0f} degrees; choose "
        "another model or angle",
        camera.name,
        camera.model->name,
        camera.angle * 180 / std::numbers::pi);
  }
}

void CheckCamera(const FirstCamera& camera) {
  if (!camera.model->config.empty() || camera.model->plenoptic || camera.model->support_size > 0) {
    throw InputError(
        "{}: the model {} needs more than a lens angle; record a few images, "
        "calibrate, and ask for suggestions then",
        camera.name,
        camera.model->name);
  }
}

}  // namespace

RigEstimate MakeFirstRigEstimate(const std::vector<FirstCamera>& cameras,
                                 const std::map<int, Eigen::Vector3d>& markers,
                                 MarkerFreedom marker_freedom) {
  RigEstimate rig;
  Bundle& bundle = rig.bundle;
  bundle.marker_freedom = marker_freedom;
  std::map<int, int> index;
  for (const auto& [number, position] : markers) {
    index[number] = static_cast<int>(bundle.markers.size());
    bundle.markers.push_back({number, position, position});
  }
  std::map<std::string, int> frames;
  for (const FirstCamera& camera : cameras) {
    CheckCamera(camera);
    const size_t params = camera.model->params.size();
    const size_t c = bundle.cameras.size();
    BundleCamera made = MakeBundleCamera({.name = camera.name,
                                          .model = camera.model,
                                          .config = {},
                                          .initial = std::vector<std::optional<double>>(params),
                                          .fixed = std::vector<bool>(params, false),
                                          .image_size = camera.image_size,
                                          .views = {}},
                                         ParamsOf(camera));
    made.is_master = c == 0;
    for (const View& view : camera.views) {
      const auto pose = GuessPose(made, view, markers);
      if (!pose) continue;
      const auto [frame, is_new] =
          frames.try_emplace(view.frame, static_cast<int>(bundle.T_rig_target.size()));
      if (is_new) bundle.T_rig_target.push_back(*pose);
      for (const Observation& seen : view.observations) {
        if (!index.contains(seen.marker)) continue;
        bundle.observations.push_back(
            {.camera = static_cast<int>(c),
             .frame = frame->second,
             .marker = index.at(seen.marker),
             .seen = seen,
             .assumed_sigma = seen.detector_sigma > 0 ? seen.detector_sigma : kUsualSigma});
      }
    }
    bundle.cameras.push_back(std::move(made));
  }
  std::ranges::stable_sort(bundle.observations, {}, [](const BundleObservation& each) {
    return std::tuple(each.frame, each.camera, each.marker);
  });
  rig.sigma_px.assign(cameras.size(), kUsualSigma);
  rig.factors.assign(cameras.size(), 1);
  rig.lenses.resize(cameras.size());
  return rig;
}

}  // namespace plenocal
