// SPDX-License-Identifier: Apache-2.0
//
// Images upside down: they agree with the others after a rotation by 180 degrees.
#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <map>
#include <optional>
#include <span>

#include "assess/causes/cause.h"
#include "assess/causes/residual_tests.h"
#include "calib/base/statistics.h"
#include "calib/start/camera_guess.h"

namespace plenocal {
namespace {

constexpr double kRotatedLevel = 1e-4;  // false alarms, a camera

using Positions = std::map<int, Eigen::Vector3d>;

// Median length of a view's residuals with the best pose and the camera's own parameters, px.
std::optional<double> ResidualOfView(const BundleCamera& camera,
                                     const View& view,
                                     const Positions& markers) {
  const std::optional<RigidTransform> pose = GuessPose(camera, view, markers);
  if (!pose) return std::nullopt;
  std::vector<double> lengths;
  for (const Observation& seen : view.observations) {
    double predicted[kMaxObservationSize];
    if (!camera.model->Project(camera.params.data(),
                               camera.config.data(),
                               seen.values.data(),
                               *pose * markers.at(seen.marker),
                               predicted)) {
      continue;
    }
    lengths.push_back(std::hypot(seen.values[0] - predicted[0], seen.values[1] - predicted[1]));
  }
  constexpr size_t kLeastSeen = 8;
  if (lengths.size() < kLeastSeen) return std::nullopt;
  return Median(std::move(lengths));
}

View UpsideDown(View view, ImageSize image_size) {
  for (Observation& seen : view.observations) {
    for (size_t axis = 0; axis < 2; ++axis) {
      seen.values[axis] = image_size[axis] - 1 - seen.values[axis];
    }
  }
  return view;
}

// Whether the view fits far better when it is turned, both with their best poses.
bool IsUpsideDown(const BundleCamera& camera,
                  double noise,
                  const View& view,
                  const Positions& markers) {
  constexpr double kDecisive = 2;  // residuals as they are over those turned
  const std::optional<double> stated = ResidualOfView(camera, view, markers);
  if (!stated) return false;
  const std::optional<double> turned =
      ResidualOfView(camera, UpsideDown(view, camera.image_size), markers);
  if (!turned || *stated < kDecisive * *turned) return false;
  // A median has 0.64 times the information of a mean.
  const double degrees = 0.64 * (2 * static_cast<double>(view.observations.size()) - 6);
  const double ratio = *stated / std::max(*turned, noise);
  return FTail(ratio * ratio, degrees, degrees) < kRotatedLevel;
}

// Median length of residuals, px; infinite where most are NaN.
double MedianResidual(std::span<const std::array<double, kMaxObservationSize>> residuals) {
  std::vector<double> lengths;
  for (const auto& residual : residuals) {
    lengths.push_back(std::isnan(residual[0]) ? std::numeric_limits<double>::infinity()
                                              : std::hypot(residual[0], residual[1]));
  }
  return Median(std::move(lengths));
}

std::vector<Finding> FindRotatedImages(const CauseEvidence& evidence) {
  constexpr double kFits = 3;  // sigmas: the median of a view that fits is near 1.2
  const Calibration& calibration = *evidence.calibration;
  const Bundle& bundle = calibration.bundle;
  const size_t c = evidence.camera;
  const BundleCamera& camera = bundle.cameras[c];
  if (camera.model->plenoptic) return {};
  Positions markers;
  for (const BundleMarker& marker : bundle.markers) markers[marker.number] = marker.position;
  const double noise = calibration.fits[c].noise_sigma;
  const auto residuals = Residuals(bundle, c);
  size_t views = 0;
  std::vector<std::string> names;
  for (size_t begin = 0, end = 0; begin < bundle.observations.size(); begin = end) {
    end = EndOfView(bundle.observations, begin);
    if (bundle.observations[begin].camera != static_cast<int>(c)) continue;
    ++views;
    if (MedianResidual(std::span(residuals).subspan(begin, end - begin)) < kFits * noise) continue;
    View view;
    for (size_t i = begin; i < end; ++i) {
      const BundleObservation& observation = bundle.observations[i];
      view.observations.push_back(observation.seen);
      view.observations.back().marker =
          bundle.markers[static_cast<size_t>(observation.marker)].number;
    }
    if (IsUpsideDown(camera, noise, view, markers)) {
      names.push_back(calibration.frames[static_cast<size_t>(bundle.observations[begin].frame)]);
    }
  }
  if (names.empty()) return {};
  return {{.code = "images_rotated",
           .role = FindingRole::kImageDistortion,
           .grade = Grade::kUsable,
           .value = static_cast<double>(names.size()),
           .limit = 1,
           .what = fmt::format("{} of {} images {} upside down: turned by 180 degrees they agree "
                               "with the others: {}.",
                               names.size(),
                               views,
                               names.size() == 1 ? "is" : "are",
                               FirstNames(names)),
           .remedy = "Use all images as the sensor recorded them: programs turn them by their "
                     "orientation tag (EXIF), and cameras held upside down do it themselves."}};
}

}  // namespace

Cause ImagesRotatedCause() { return {CauseStage::kPoints, FindRotatedImages}; }

}  // namespace plenocal
