// SPDX-License-Identifier: Apache-2.0
#include "engine/session/calibration_input.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <limits>

#include "calib/base/format_error.h"
#include "calib/base/statistics.h"
#include "engine/session/session_targets.h"

namespace plenocal {
namespace {

// Typical distance between neighbouring markers: the median of the distances to the nearest other.
double MarkerSpacing(const std::map<int, Eigen::Vector3d>& markers) {
  std::vector<double> nearest;
  for (const auto& [number, position] : markers) {
    double best = std::numeric_limits<double>::infinity();
    for (const auto& [other, place] : markers) {
      if (other != number) best = std::min(best, (place - position).norm());
    }
    nearest.push_back(best);
  }
  return Median(nearest);
}

MarkerFreedom MarkerFreedomOf(const Session& session, const Target& target, const Run& run) {
  if (!session.refine_target.value_or(target.tolerance.has_value())) {
    if (!session.refine_target) {
      run.Message(
          "the target states no tolerance, so it is held rigid; give it 'tolerance' (m) to have "
          "its markers refined");
    }
    return MarkerFreedom::Rigid();
  }
  const MarkerFreedom refined = RefinedMarkerFreedom(target);
  if (!target.tolerance) {
    run.Message(
        fmt::format("the target states no tolerance; its markers are refined with {:.3g} mm, 1 % "
                    "of their spacing",
                    1e3 * refined.Sigma()));
  }
  return refined;
}

// A scale needs markers that can move, and so does a distance.
MarkerFreedom LeastFreedom(const CalibrationInput& input) {
  const bool held = input.marker_freedom.IsHeld();
  const bool moves = !input.scales.empty() || !input.distances.empty();
  return held && moves ? MarkerFreedom::Held() : input.marker_freedom;
}

std::vector<MarkerDistance> DistancesOf(const Session& session) {
  std::vector<MarkerDistance> distances;
  for (const SceneDistance& distance : session.distances) {
    distances.push_back({.markers_a = distance.a.points,
                         .markers_b = distance.b.points,
                         .length = distance.length,
                         .sigma = distance.sigma,
                         .name = distance.a.name + " to " + distance.b.name});
  }
  return distances;
}

}  // namespace

void UseSessionCamera(const SessionCamera& camera, CameraInput* input) {
  input->model = camera.model;
  input->config = camera.config;
  input->initial = camera.initial;
  input->fixed = camera.fixed;
  input->rules = camera.rules;
}

CameraInput InputWithoutViews(const SessionCamera& camera) {
  CameraInput input;
  input.name = camera.name;
  input.image_size = camera.image_size;
  input.image_circle = camera.image_circle;
  UseSessionCamera(camera, &input);
  return input;
}

void CheckImageSize(const SessionCamera& camera, ImageSize found) {
  const ImageSize stated = camera.image_size;
  if (stated == ImageSize{} || stated == found) return;
  throw InputError("{}: the images are {} pixels, but the session states image_size {}",
                   camera.name,
                   fmt::join(found, " x "),
                   fmt::join(stated, " x "));
}

size_t CountObservations(std::span<const View> views) {
  size_t count = 0;
  for (const View& view : views) count += view.observations.size();
  return count;
}

MarkerFreedom RefinedMarkerFreedom(const Target& target) {
  constexpr double kPartOfSpacing = 0.01;
  return MarkerFreedom::FromSigma(
      target.tolerance.value_or(kPartOfSpacing * MarkerSpacing(target.markers)));
}

CalibrationInput MakeCalibrationInput(const Session& session,
                                      const Target& target,
                                      std::vector<CameraInput> cameras,
                                      const Run& run) {
  CalibrationInput input;
  input.cameras = std::move(cameras);
  for (const CameraInput& camera : input.cameras) {
    if (!camera.image_circle || camera.image_circle->IsOf(camera.image_size)) continue;
    throw InputError(
        "{}: the session's image_circle lies beside the image of {} pixels, or covers hardly any of "
        "it; state [c_x, c_y, r_x, r_y] in px",
        camera.name,
        fmt::join(camera.image_size, " x "));
  }
  input.markers = target.markers;
  input.targets = InputTargetsOf(session);
  input.marker_freedom = MarkerFreedomOf(session, target, run);
  input.scales = target.scales;
  input.distances = DistancesOf(session);
  input.marker_freedom = LeastFreedom(input);
  input.loss = session.loss;
  return input;
}

}  // namespace plenocal
