// SPDX-License-Identifier: Apache-2.0
//
// Points at the border of the image whose residuals are larger than those beside them.
#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>

#include "assess/causes/cause.h"
#include "assess/causes/residual_tests.h"
#include "calib/base/statistics.h"
#include "calib/noise/camera_noise.h"

namespace plenocal {
namespace {

constexpr double kBorderLevel = 1e-4;  // false alarms, a camera

/// A band of the image along its border.
struct BorderBand {
  double width = 0;        ///< px
  size_t points = 0;       ///< in it
  double ratio = 1;        ///< of the residuals there to those inside of it
  double probability = 1;  ///< that they are so much larger by chance
};

struct BorderPoint {
  double margin = 0;      ///< distance from the image's border, px
  double log_length = 0;  ///< logarithm of the length of the residual
};

std::vector<BorderPoint> BorderPoints(const Bundle& bundle, size_t camera) {
  std::vector<BorderPoint> points;
  const ImageSize size = bundle.cameras[camera].image_size;
  ForEachResidual(
      bundle, camera, [&](const BundleObservation& observation, const double* residual) {
        const double x = observation.seen.values[0], y = observation.seen.values[1];
        const double margin = 0.5 + std::min({x, y, size[0] - 1 - x, size[1] - 1 - y});
        const double length = std::hypot(residual[0], residual[1]);
        if (length > 0) points.push_back({margin, std::log(length)});
      });
  return points;
}

// Student's test of the points in a band against those of the next, twice as wide: errors of the
// lens model hardly differ between them.
BorderBand TestBand(const std::vector<BorderPoint>& points, double width) {
  constexpr double kLeastPoints = 10;
  std::array<double, 2> count{}, sum{}, squares{};
  for (const auto& [margin, log_length] : points) {
    if (margin >= 3 * width) continue;
    const size_t part = margin < width ? 0 : 1;
    count[part] += 1;
    sum[part] += log_length;
    squares[part] += log_length * log_length;
  }
  BorderBand band{.width = width, .points = static_cast<size_t>(count[0])};
  if (std::min(count[0], count[1]) < kLeastPoints) return band;
  const double difference = sum[0] / count[0] - sum[1] / count[1];
  double rest = 0;
  for (size_t part = 0; part < 2; ++part) {
    rest += squares[part] - sum[part] * sum[part] / count[part];
  }
  const double degrees = count[0] + count[1] - 2;
  const double variance = rest / degrees * (1 / count[0] + 1 / count[1]);
  band.ratio = std::exp(difference);
  band.probability = StudentTail(difference / std::sqrt(variance), degrees);
  return band;
}

std::vector<Finding> FindBorderPoints(const CauseEvidence& evidence) {
  const Calibration& calibration = *evidence.calibration;
  // Half widths of the windows in which detectors measure points.
  constexpr std::array<double, 4> kWidths{4, 8, 16, 32};
  constexpr double kPlainlyWorse = 2;
  const BundleCamera& camera = calibration.bundle.cameras[evidence.camera];
  if (camera.model->plenoptic || calibration.fits[evidence.camera].noise_sigma < kRoundingNoise)
    return {};
  const std::vector<BorderPoint> points = BorderPoints(calibration.bundle, evidence.camera);
  BorderBand worst;
  for (const double width : kWidths) {
    const BorderBand band = TestBand(points, width);
    if (band.ratio > kPlainlyWorse && band.probability < worst.probability) worst = band;
  }
  if (worst.probability > kBorderLevel / kWidths.size()) return {};
  return {{.code = "border_points",
           .role = FindingRole::kOutlier,
           .grade = Grade::kUsable,
           .value = worst.ratio,
           .limit = kPlainlyWorse,
           .what = fmt::format("the {} points within {:g} px of the image's border have {:.1f} "
                               "times the residuals of their neighbours.",
                               worst.points,
                               worst.width,
                               worst.ratio),
           .remedy = "The detector's window was cut off there: leave these points out."}};
}

}  // namespace

Cause PointsAtBorderCause() { return {CauseStage::kPoints, FindBorderPoints}; }

}  // namespace plenocal
