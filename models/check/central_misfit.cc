// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <optional>
#include <string>

#include "calib/base/error.h"
#include "calib/start/camera_guess.h"
#include "models/kannala_brandt4.h"
#include "models/start/central_model.h"

namespace plenocal {

Misfit CentralModel::JudgeFit(const CameraModel& model,
                              const StartProblem& problem,
                              std::span<const double> params,
                              double median_error) {
  constexpr double kAgrees = 1;        // px: what fits as well needs no explanation
  constexpr double kFarBetter = 0.2;   // part of the model's error that is left to the fisheye
  constexpr double kFewPoints = 0.01;  // part of the points; so many may be mistakes
  if (!(median_error > kAgrees)) return {};
  CameraModel wide = MakeCameraModel<KannalaBrandt4>();
  wide.functions.misfit = nullptr;  // what does not describe the camera either explains nothing
  CameraGuess fisheye;
  try {
    fisheye = GuessCamera({.name = std::string(wide.name),
                           .model = &wide,
                           .config = {},
                           .initial = std::vector<std::optional<double>>(wide.params.size()),
                           .fixed = std::vector<bool>(wide.params.size(), false),
                           .image_size = problem.image_size,
                           .views = {problem.views.begin(), problem.views.end()}},
                          *problem.markers);
  } catch (const Error&) {
    return {};
  }
  if (!(fisheye.median_error < kFarBetter * median_error)) return {};
  size_t all = 0, beyond = 0;
  double farthest = 0;
  for (const View& view : problem.views) {
    for (const Observation& seen : view.observations) {
      const std::optional<Ray> ray =
          wide.Unproject(fisheye.params.data(), nullptr, seen.values.data());
      if (!ray) continue;
      ++all;
      farthest = std::max(farthest, std::acos(std::clamp(ray->direction.z(), -1.0, 1.0)));
      double u[2];
      if (ray->direction.z() <= 0 &&
          !model.Project(
              params.data(), problem.config.data(), seen.values.data(), ray->direction, u)) {
        ++beyond;
      }
    }
  }
  const bool impossible = static_cast<double>(beyond) > kFewPoints * static_cast<double>(all);
  const std::string where =
      impossible ? fmt::format(
                       "{} of {} points looked at are 90 degrees and more off the optical axis "
                       "(up to {:.0f}), where it images nothing",
                       beyond,
                       all,
                       farthest * 180 / std::numbers::pi)
                 : fmt::format("the points are up to {:.0f} degrees off the optical axis",
                               farthest * 180 / std::numbers::pi);
  return {fmt::format("does not describe this lens: {}; start values leave residuals of {:.2g} px "
                      "(median), those of {} {:.2g} px. 'plenocal try' compares models",
                      where,
                      median_error,
                      wide.name,
                      fisheye.median_error),
          impossible};
}

}  // namespace plenocal
