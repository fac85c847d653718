// SPDX-License-Identifier: Apache-2.0
#include "assess/causes/outlier_causes.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <map>
#include <optional>
#include <span>
#include <utility>

#include "calib/base/statistics.h"
#include "calib/noise/camera_noise.h"
#include "calib/start/camera_guess.h"

namespace plenocal {
namespace {

constexpr double kOutlierLevel = 1e-4;  // false alarms of a test, a camera

std::string FirstOf(const std::vector<std::string>& names) {
  constexpr size_t kMost = 5;
  const auto shown = std::span(names).first(std::min(kMost, names.size()));
  return fmt::format("{}{}", fmt::join(shown, ", "), names.size() > kMost ? ", ..." : "");
}

// ---- images upside down

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
    if (!camera.model->project(camera.params.data(),
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
  return FTail(ratio * ratio, degrees, degrees) < kOutlierLevel;
}

// Median length of the residuals of the observations [begin, end), px; infinite where most have
// none.
double MedianResidual(const Bundle& bundle, size_t begin, size_t end) {
  std::vector<double> lengths;
  for (size_t i = begin; i < end; ++i) {
    double residual[kMaxObservationSize];
    lengths.push_back(Residual(bundle, bundle.observations[i], residual)
                          ? std::hypot(residual[0], residual[1])
                          : std::numeric_limits<double>::infinity());
  }
  return Median(std::move(lengths));
}

std::vector<Finding> FindRotatedImages(const Calibration& calibration, size_t c) {
  constexpr double kFits = 3;  // sigmas: the median of a view that fits is near 1.2
  const Bundle& bundle = calibration.bundle;
  const BundleCamera& camera = bundle.cameras[c];
  if (camera.model->plenoptic) return {};
  Positions markers;
  for (const BundleMarker& marker : bundle.markers) markers[marker.number] = marker.position;
  const double noise = calibration.fits[c].noise_sigma;
  size_t views = 0;
  std::vector<std::string> names;
  for (size_t begin = 0, end = 0; begin < bundle.observations.size(); begin = end) {
    end = EndOfView(bundle.observations, begin);
    if (bundle.observations[begin].camera != static_cast<int>(c)) continue;
    ++views;
    if (MedianResidual(bundle, begin, end) < kFits * noise) continue;
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
  return {
      {.code = "images_rotated",
       .grade = Grade::kUsable,
       .cameras = {camera.name},
       .value = static_cast<double>(names.size()),
       .limit = 1,
       .what = fmt::format("{}: {} of {} images {} upside down: turned by 180 degrees they agree "
                           "with the others: {}.",
                           camera.name,
                           names.size(),
                           views,
                           names.size() == 1 ? "is" : "are",
                           FirstOf(names)),
       .remedy = "Use all images as the sensor recorded them: programs turn them by their "
                 "orientation tag (EXIF), and cameras held upside down do it themselves."}};
}

// ---- markers

/// Points of one marker.
struct Share {
  int all = 0, rejected = 0;
};

// Probability of so many rejections among `share.all` points when each is rejected with
// `probability`: Chernoff's bound.
double ChanceOf(const Share& share, double probability) {
  const double part = static_cast<double>(share.rejected) / share.all;
  if (part <= probability) return 1;
  double information = part * std::log(part / probability);
  if (part < 1) information += (1 - part) * std::log((1 - part) / (1 - probability));
  return std::exp(-share.all * information);
}

std::vector<Finding> FindMarkerOutliers(const Calibration& calibration, size_t c) {
  constexpr double kMostPoints = 0.3;   // of a marker; less than that are single bad points
  constexpr double kFewMarkers = 0.25;  // many are no exceptions
  constexpr double kLeastShare = 0.01;  // rejected in any recording
  const Bundle& bundle = calibration.bundle;
  std::map<int, Share> shares;
  Share total;
  for (const BundleObservation& observation : bundle.observations) {
    if (observation.camera != static_cast<int>(c)) continue;
    Share& share = shares[bundle.markers[static_cast<size_t>(observation.marker)].number];
    for (Share* one : {&share, &total}) {
      ++one->all;
      if (!observation.used) ++one->rejected;
    }
  }
  std::vector<std::string> names;
  double worst = 0;
  for (const auto& [number, share] : shares) {
    const double part = static_cast<double>(share.rejected) / share.all;
    const int others = std::max(1, total.all - share.all);
    const double usual =
        std::max(kLeastShare, static_cast<double>(total.rejected - share.rejected) / others);
    if (part < kMostPoints || usual >= 1 ||
        ChanceOf(share, usual) > kOutlierLevel / static_cast<double>(shares.size())) {
      continue;
    }
    names.push_back(fmt::format("{} ({} of {})", number, share.rejected, share.all));
    worst = std::max(worst, part);
  }
  if (names.empty() || static_cast<double>(names.size()) > kFewMarkers * shares.size()) return {};
  const std::string& name = bundle.cameras[c].name;
  return {{.code = "marker_outlier",
           .grade = Grade::kUsable,
           .cameras = {name},
           .value = worst,
           .limit = kMostPoints,
           .what = fmt::format("{}: {} with all others in most images; points rejected: {}.",
                               name,
                               names.size() == 1 ? "one marker disagrees" : "some markers disagree",
                               FirstOf(names)),
           .remedy = "Look for a reflection, dirt or damage there, and leave these markers out "
                     "('exclude')."}};
}

// ---- points on the border of the image

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

// All points of a camera, rejected ones too.
std::vector<BorderPoint> BorderPointsOf(const Bundle& bundle, size_t c) {
  std::vector<BorderPoint> points;
  const ImageSize size = bundle.cameras[c].image_size;
  for (const BundleObservation& observation : bundle.observations) {
    double residual[kMaxObservationSize];
    if (observation.camera != static_cast<int>(c) || !Residual(bundle, observation, residual)) {
      continue;
    }
    const double x = observation.seen.values[0], y = observation.seen.values[1];
    const double margin = 0.5 + std::min({x, y, size[0] - 1 - x, size[1] - 1 - y});
    const double length = std::hypot(residual[0], residual[1]);
    if (length > 0) points.push_back({margin, std::log(length)});
  }
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

std::vector<Finding> FindBorderPoints(const Calibration& calibration, size_t c) {
  // Half widths of the windows in which detectors measure points.
  constexpr std::array<double, 4> kWidths{4, 8, 16, 32};
  constexpr double kPlainlyWorse = 2;
  const BundleCamera& camera = calibration.bundle.cameras[c];
  if (camera.model->plenoptic || calibration.fits[c].noise_sigma < kRoundingNoise) return {};
  const std::vector<BorderPoint> points = BorderPointsOf(calibration.bundle, c);
  BorderBand worst;
  for (const double width : kWidths) {
    const BorderBand band = TestBand(points, width);
    if (band.ratio > kPlainlyWorse && band.probability < worst.probability) worst = band;
  }
  if (worst.probability > kOutlierLevel / kWidths.size()) return {};
  return {{.code = "border_points",
           .grade = Grade::kUsable,
           .cameras = {camera.name},
           .value = worst.ratio,
           .limit = kPlainlyWorse,
           .what = fmt::format("{}: the {} points within {:g} px of the image's border have {:.1f} "
                               "times the residuals of their neighbours.",
                               camera.name,
                               worst.points,
                               worst.width,
                               worst.ratio),
           .remedy = "The detector's window was cut off there: leave these points out."}};
}

}  // namespace

std::vector<Finding> FindOutlierCauses(const Calibration& calibration) {
  std::vector<Finding> findings;
  for (size_t c = 0; c < calibration.bundle.cameras.size(); ++c) {
    Append(FindRotatedImages(calibration, c), &findings);
    Append(FindMarkerOutliers(calibration, c), &findings);
    Append(FindBorderPoints(calibration, c), &findings);
  }
  return findings;
}

}  // namespace plenocal
