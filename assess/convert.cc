// SPDX-License-Identifier: Apache-2.0
#include "assess/convert.h"

#include <cmath>
#include <limits>
#include <map>

#include "calib/base/format_error.h"
#include "calib/camera/ray_fit.h"

namespace plenocal {
namespace {

std::optional<Eigen::Vector2d> Image(const CameraModel& model,
                                     const std::vector<double>& params,
                                     const Eigen::Vector3d& direction) {
  double u[2];
  const double values[kMaxObservationSize] = {};
  if (!model.Project(params.data(), nullptr, values, direction, u)) return std::nullopt;
  return Eigen::Vector2d(u[0], u[1]);
}

// Pixels over the image with the directions of their rays.
struct Rays {
  std::vector<Eigen::Vector2d> image;  // px
  std::vector<Eigen::Vector3d> directions;
};

Rays RaysOf(const CalibratedCamera& camera) {
  Rays rays;
  for (int row = 0; row < kConvertedRows; ++row) {
    for (int column = 0; column < kConvertedColumns; ++column) {
      const double values[kMaxObservationSize] = {
          (camera.image_size[0] - 1.0) * column / (kConvertedColumns - 1),
          (camera.image_size[1] - 1.0) * row / (kConvertedRows - 1)};
      const auto ray = camera.model->Unproject(camera.params.data(), nullptr, values);
      if (!ray) continue;
      rays.directions.push_back(ray->direction);
      rays.image.emplace_back(values[0], values[1]);
    }
  }
  return rays;
}

// Initial guesses of the parameters, as for a calibration whose target is a cloud of points on the
// rays.
std::vector<StartCandidate> Candidates(const CameraModel& model,
                                       ImageSize image_size,
                                       const Rays& rays) {
  View view{"rays", {}};
  std::map<int, Eigen::Vector3d> markers;
  for (size_t i = 0; i < rays.image.size(); ++i) {
    const auto number = static_cast<int>(i);
    // Depths between 0.5 and 1.5 m, irregular so that the points lie in no plane.
    markers[number] = (1 + 0.5 * std::sin(static_cast<double>(i))) * rays.directions[i];
    view.observations.push_back({number, {rays.image[i].x(), rays.image[i].y()}, 1});
  }
  const std::vector<std::optional<double>> given(model.params.size());
  const std::vector<bool> fixed(model.params.size(), false);
  return model.Start({.views = std::span(&view, 1),
                      .markers = &markers,
                      .image_size = image_size,
                      .config = {},
                      .given = given,
                      .fixed = &fixed});
}

// Parameters fitted to the rays from an initial guess, within the model's bounds; nothing when none
// are found.
std::optional<std::vector<double>> FitWithinBounds(const CameraModel& model,
                                                   const Rays& rays,
                                                   const std::vector<double>& guess) {
  for (const bool within_bounds : {false, true}) {
    std::vector<double> params = guess;
    // Twice: the second time with the rays that the first fit has made visible.
    for (int pass = 0; pass < 2; ++pass) {
      FitToRays(model,
                {},
                rays.directions,
                rays.image,
                {.within_bounds = within_bounds, .max_iterations = 300, .tolerance = 1e-15},
                &params);
    }
    if (WithinBounds(model, params.data())) return params;
  }
  return std::nullopt;
}

Conversion Measure(const CameraModel& model, const Rays& rays, std::vector<double> params) {
  Conversion conversion;
  conversion.params = std::move(params);
  double squares = 0;
  for (size_t i = 0; i < rays.image.size(); ++i) {
    ConversionError error{rays.image[i], std::nullopt};
    if (const auto u = Image(model, conversion.params, rays.directions[i])) {
      error.difference_px = *u - rays.image[i];
      const double length = error.difference_px->norm();
      squares += length * length;
      if (length > conversion.largest) {
        conversion.largest = length;
        conversion.largest_at = rays.image[i];
      }
    } else {
      ++conversion.unseen;
    }
    conversion.errors.push_back(error);
  }
  const auto seen = static_cast<double>(rays.image.size()) - conversion.unseen;
  conversion.rms = seen > 0 ? std::sqrt(squares / seen) : std::numeric_limits<double>::infinity();
  return conversion;
}

}  // namespace

Conversion Convert(const CalibratedCamera& camera, const CameraModel& model) {
  for (const CameraModel* each : {camera.model, &model}) {
    if (each->IsCentral() && each->config.empty()) continue;
    throw InputError(
        "{} is no model of an ordinary camera with a single centre; a camera can be converted only "
        "between these",
        each->name);
  }
  const Rays rays = RaysOf(camera);
  if (rays.image.size() < model.params.size()) {
    throw JobError("{}: its calibration images hardly any pixel", camera.name);
  }
  Conversion best;
  // A ray that the model does not image weighs more than any error in the image.
  constexpr double kUnseen = 1e3;  // px
  const auto badness = [](const Conversion& conversion) {
    return conversion.unseen * kUnseen + conversion.rms;
  };
  for (const StartCandidate& candidate : Candidates(model, camera.image_size, rays)) {
    const auto params = FitWithinBounds(model, rays, candidate.params);
    if (!params) continue;
    Conversion conversion = Measure(model, rays, *params);
    if (best.params.empty() || badness(conversion) < badness(best)) best = std::move(conversion);
  }
  if (best.params.empty() || !std::isfinite(best.rms)) {
    throw JobError("{}: {} cannot image what the camera sees", camera.name, model.name);
  }
  return best;
}

}  // namespace plenocal
