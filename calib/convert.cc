// SPDX-License-Identifier: Apache-2.0
#include "calib/convert.h"

#include <fmt/format.h>

#include <cmath>
#include <limits>
#include <map>

#include "calib/error.h"
#include "calib/ray_fit.h"

namespace plenocal {
namespace {

std::optional<Eigen::Vector2d> Image(const CameraModel& model,
                                     const std::vector<double>& params,
                                     const Eigen::Vector3d& direction) {
  double u[2];
  const double values[kMaxObservationSize] = {};
  if (!model.project(params.data(), nullptr, values, direction, u)) return std::nullopt;
  return Eigen::Vector2d(u[0], u[1]);
}

}  // namespace

Conversion Convert(const CalibratedCamera& camera, const CameraModel& model) {
  for (const CameraModel* each : {camera.model, &model}) {
    if (!each->central || !each->config.empty()) {
      throw Error(ErrorKind::kInput,
                  fmt::format("{} is no model of an ordinary camera; only between these a camera "
                              "can be converted",
                              each->name));
    }
  }
  std::vector<Eigen::Vector3d> directions;
  std::vector<Eigen::Vector2d> image;
  for (int row = 0; row < kConvertedRows; ++row) {
    for (int column = 0; column < kConvertedColumns; ++column) {
      const double values[kMaxObservationSize] = {
          (camera.image_size[0] - 1.0) * column / (kConvertedColumns - 1),
          (camera.image_size[1] - 1.0) * row / (kConvertedRows - 1)};
      const auto ray = camera.model->unproject(camera.params.data(), nullptr, values);
      if (!ray) continue;
      directions.push_back(ray->direction);
      image.emplace_back(values[0], values[1]);
    }
  }
  if (image.size() < model.params.size()) {
    throw Error(ErrorKind::kJob,
                fmt::format("{}: its calibration images hardly any pixel", camera.name));
  }

  // Start values as of a calibration whose target is a cloud of points on these rays.
  View view{"rays", {}};
  std::map<int, Eigen::Vector3d> markers;
  for (size_t i = 0; i < image.size(); ++i) {
    const auto number = static_cast<int>(i);
    markers[number] = (1 + 0.5 * std::sin(static_cast<double>(i))) * directions[i];
    view.observations.push_back({number, {image[i].x(), image[i].y()}, 1});
  }
  const std::vector<std::optional<double>> given(model.params.size());
  const std::vector<bool> fixed(model.params.size(), false);
  const std::vector<StartCandidate> candidates = model.start({.views = std::span(&view, 1),
                                                              .markers = &markers,
                                                              .image_size = camera.image_size,
                                                              .config = {},
                                                              .given = given,
                                                              .fixed = &fixed});
  Conversion best;
  // Rays that a model cannot see weigh more than any error in the image.
  const auto badness = [&](const Conversion& conversion) {
    return conversion.unseen * 1e3 + conversion.rms;
  };
  for (const StartCandidate& candidate : candidates) {
    Conversion conversion;
    const auto fit = [&](bool within_bounds) {
      std::vector<double> params = candidate.params;
      // Twice: the second time with the rays that the first fit has made visible.
      for (int pass = 0; pass < 2; ++pass) {
        FitToRays(model,
                  {},
                  directions,
                  image,
                  {.within_bounds = within_bounds, .max_iterations = 300, .tolerance = 1e-15},
                  &params);
      }
      return params;
    };
    conversion.params = fit(false);
    if (!WithinBounds(model, conversion.params.data())) conversion.params = fit(true);
    if (!WithinBounds(model, conversion.params.data())) continue;
    double squares = 0;
    for (size_t i = 0; i < image.size(); ++i) {
      ConversionError error{image[i], std::nullopt};
      if (const auto u = Image(model, conversion.params, directions[i])) {
        error.difference_px = *u - image[i];
        const double length = error.difference_px->norm();
        squares += length * length;
        if (length > conversion.largest) {
          conversion.largest = length;
          conversion.largest_at = image[i];
        }
      } else {
        ++conversion.unseen;
      }
      conversion.errors.push_back(error);
    }
    const auto seen = static_cast<double>(image.size()) - conversion.unseen;
    conversion.rms = seen > 0 ? std::sqrt(squares / seen) : std::numeric_limits<double>::infinity();
    if (best.params.empty() || badness(conversion) < badness(best)) best = std::move(conversion);
  }
  if (best.params.empty() || !std::isfinite(best.rms)) {
    throw Error(ErrorKind::kJob,
                fmt::format("{}: {} cannot image what the camera sees", camera.name, model.name));
  }
  return best;
}

}  // namespace plenocal
