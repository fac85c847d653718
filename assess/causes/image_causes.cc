// SPDX-License-Identifier: Apache-2.0
#include "assess/causes/image_causes.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <limits>
#include <map>
#include <optional>
#include <span>

#include "calib/base/statistics.h"
#include "calib/noise/camera_noise.h"

namespace plenocal {
namespace {

// ---- images whose points are worse than those of others

constexpr double kImageLevel = 1e-3;  // false alarms of a test, a camera
// That these are at once the worst by points and by another measure happens by chance once in 1140
// recordings of 20 images.
constexpr std::ptrdiff_t kLeastImages = 3;

/// One image of a camera.
struct ImageSample {
  double defect = 0;  ///< larger is worse, >= 0
  double noise = 0;   ///< median length of its points' residuals, px
};

/// The images with the largest defects, against all others.
struct WorseImages {
  std::ptrdiff_t count = 0;
  double probability = 1;  ///< that their points are so much worse by chance
  double defect = 0, usual_defect = 0, noise = 0, usual_noise = 0;  ///< medians
};

double MeanSquareNoise(std::span<const ImageSample> images) {
  double sum = 0;
  for (const ImageSample& image : images) sum += image.noise * image.noise;
  return sum / static_cast<double>(images.size());
}

double MedianOf(std::span<const ImageSample> images, double ImageSample::*member) {
  std::vector<double> values;
  for (const ImageSample& image : images) values.push_back(image.*member);
  return Median(std::move(values));
}

// Sums over the first images of the logarithms of their noise less the mean of all.
struct LogSums {
  double sum = 0, squares = 0;

  [[nodiscard]] LogSums operator-(const LogSums& other) const {
    return {sum - other.sum, squares - other.squares};
  }
  [[nodiscard]] double SquaresAboutMean(double count) const { return squares - sum * sum / count; }
};

std::vector<LogSums> SumLogs(std::span<const ImageSample> images) {
  double mean = 0;
  for (const ImageSample& image : images) mean += std::log(image.noise);
  mean /= static_cast<double>(images.size());
  std::vector<LogSums> sums{{}};
  for (const ImageSample& image : images) {
    const double log = std::log(image.noise) - mean;
    sums.push_back({sums.back().sum + log, sums.back().squares + log * log});
  }
  return sums;
}

// The split of the images, sorted by defect, whose parts differ most in noise: Student's test of
// the logarithms, in which images scatter alike however large their noise is.
WorseImages LargestSplit(std::span<const ImageSample> sorted) {
  WorseImages worse;
  const auto n = static_cast<std::ptrdiff_t>(sorted.size());
  const std::ptrdiff_t splits = n - 2 * kLeastImages + 1;
  const std::vector<LogSums> sums = SumLogs(sorted);
  double largest = 0;
  for (std::ptrdiff_t k = kLeastImages; k + kLeastImages <= n; ++k) {
    const auto count = static_cast<double>(k), rest = static_cast<double>(n - k);
    const LogSums& first = sums[static_cast<size_t>(k)];
    const LogSums others = sums.back() - first;
    const double difference = first.sum / count - others.sum / rest;
    if (difference <= 0 ||
        !(sorted[static_cast<size_t>(k) - 1].defect > sorted[static_cast<size_t>(k)].defect)) {
      continue;
    }
    const double variance =
        (first.SquaresAboutMean(count) + others.SquaresAboutMean(rest)) / (n - 2.0);
    const double F = difference * difference / (variance * (1 / count + 1 / rest));
    if (F <= largest) continue;
    largest = F;
    worse.count = k;
  }
  if (worse.count == 0) return worse;
  const auto first = sorted.first(worse.count), others = sorted.subspan(worse.count);
  return {.count = worse.count,
          .probability = std::min(1.0, FTail(largest, 1, n - 2.0) * static_cast<double>(splits)),
          .defect = MedianOf(first, &ImageSample::defect),
          .usual_defect = MedianOf(others, &ImageSample::defect),
          .noise = MedianOf(first, &ImageSample::noise),
          .usual_noise = MedianOf(others, &ImageSample::noise)};
}

// The images that a defect makes so much worse that they have half of the noise of all.
std::optional<WorseImages> LargestExplained(std::vector<ImageSample> images) {
  constexpr double kPlain = 2;     // the defect is at least so many times that of the others
  constexpr double kExplains = 2;  // mean square of all over that of the others
  std::erase_if(images, [](const ImageSample& image) { return !(image.noise > 0); });
  if (images.size() < 2 * kLeastImages + 1) return std::nullopt;
  std::ranges::stable_sort(images, std::greater(), &ImageSample::defect);
  const WorseImages worse = LargestSplit(images);
  if (worse.probability > kImageLevel || worse.defect < kPlain * worse.usual_defect) {
    return std::nullopt;
  }
  const double others = MeanSquareNoise(std::span(images).subspan(worse.count));
  if (MeanSquareNoise(images) < kExplains * others) return std::nullopt;
  return worse;
}

// Median distance of a point to its nearest neighbour, px; of many points every k-th is asked.
double SpacingOf(const std::vector<Eigen::Vector2d>& points) {
  constexpr size_t kAsked = 100;
  std::vector<double> distances;
  for (size_t i = 0; i < points.size(); i += 1 + points.size() / kAsked) {
    double nearest = std::numeric_limits<double>::infinity();
    for (size_t j = 0; j < points.size(); ++j) {
      if (j != i) nearest = std::min(nearest, (points[i] - points[j]).norm());
    }
    distances.push_back(nearest);
  }
  return Median(std::move(distances));
}

/// The points of one image.
struct ImagePoints {
  std::vector<Eigen::Vector2d> places;  ///< px
  std::vector<double> residuals;        ///< lengths, px
};

// By frame. Rejected points count: bad images have most of them.
std::map<std::string, ImagePoints> PointsOfImages(const Calibration& calibration, size_t c) {
  std::map<std::string, ImagePoints> images;
  int frame = -1;  // observations of one frame follow each other
  ImagePoints* points = nullptr;
  for (const BundleObservation& observation : calibration.bundle.observations) {
    double residual[kMaxObservationSize];
    if (observation.camera != static_cast<int>(c) ||
        !Residual(calibration.bundle, observation, residual)) {
      continue;
    }
    if (observation.frame != frame) {
      frame = observation.frame;
      points = &images[calibration.frames[static_cast<size_t>(frame)]];
    }
    points->places.emplace_back(observation.seen.values[0], observation.seen.values[1]);
    points->residuals.push_back(std::hypot(residual[0], residual[1]));
  }
  std::erase_if(images, [](const auto& image) {
    constexpr size_t kLeastPoints = 4;
    return image.second.places.size() < kLeastPoints;
  });
  return images;
}

/// A property of images that can make their points worse.
struct ImageDefect {
  const char *code, *what, *remedy;
  std::function<double(const ImagePoints&, const ImageTraits&)> measure;  ///< larger is worse
  std::function<std::string(double defect, double usual)> describe;
};

const std::array<ImageDefect, 3>& ImageDefects() {
  static const std::array<ImageDefect, 3> kDefects{{
      {"blurred_images",
       "blurred",
       "Hold camera and target still or expose for a shorter time, and keep within the depth of "
       "field; leave these images out ('exclude').",
       [](const ImagePoints&, const ImageTraits& traits) { return traits.blur; },
       [](double defect, double usual) {
         return fmt::format("edges have a sigma of {:.1f} px there, else {:.1f} px", defect, usual);
       }},
      {"saturated_images",
       "saturated",
       "Expose for a shorter time, so that the white of the target is below the largest gray "
       "level, and avoid reflections; leave these images out ('exclude').",
       [](const ImagePoints&, const ImageTraits& traits) { return traits.saturated; },
       [](double defect, double usual) {
         return fmt::format(
             "{:.0f} % of the target's area have the largest gray level, else {:.0f} "
             "%",
             100 * defect,
             100 * usual);
       }},
      {"few_pixels",
       "too small",
       "Take images from nearer, or print a target with fewer and larger squares or tags.",
       [](const ImagePoints& points, const ImageTraits&) { return 1 / SpacingOf(points.places); },
       [](double defect, double usual) {
         return fmt::format("neighbouring points are {:.0f} px apart there, else {:.0f} px",
                            1 / defect,
                            1 / usual);
       }},
  }};
  return kDefects;
}

Finding FindingOf(const ImageDefect& defect, const WorseImages& worse, const std::string& camera) {
  return {
      .code = defect.code,
      .grade = Grade::kGood,
      .cameras = {camera},
      .value = worse.noise / worse.usual_noise,
      .limit = 1,
      .what = fmt::format("{}: {} images in which the target is {} have {:.1f} times the residuals "
                          "of the others ({}).",
                          camera,
                          worse.count,
                          defect.what,
                          worse.noise / worse.usual_noise,
                          defect.describe(worse.defect, worse.usual_defect)),
      .remedy = defect.remedy};
}

}  // namespace

std::vector<Finding> FindWorseImages(const Calibration& calibration,
                                     size_t c,
                                     const CameraTraits& traits) {
  const BundleCamera& camera = calibration.bundle.cameras[c];
  // Exact (simulated) points have no noise to compare.
  if (camera.model->plenoptic || calibration.fits[c].noise_sigma < kRoundingNoise) return {};
  const std::map<std::string, ImagePoints> images = PointsOfImages(calibration, c);
  std::optional<WorseImages> worst;
  const ImageDefect* cause = nullptr;
  for (const ImageDefect& defect : ImageDefects()) {
    std::vector<ImageSample> samples;
    for (const auto& [frame, points] : images) {
      const auto known = traits.find(frame);
      const ImageTraits image = known == traits.end() ? ImageTraits() : known->second;
      samples.push_back({defect.measure(points, image), Median(points.residuals)});
    }
    const std::optional<WorseImages> worse = LargestExplained(std::move(samples));
    if (!worse || (worst && worst->probability <= worse->probability)) continue;
    worst = worse;
    cause = &defect;
  }
  if (!worst) return {};
  return {FindingOf(*cause, *worst, camera.name)};
}

std::vector<Finding> FindOrientationTags(const std::string& camera, const CameraTraits& traits) {
  const auto count = std::ranges::count_if(
      traits, [](const auto& image) { return image.second.orientation != 1; });
  if (count == 0) return {};
  return {{.code = "orientation_tag",
           .grade = Grade::kGood,
           .cameras = {camera},
           .value = static_cast<double>(count),
           .limit = 1,
           .what = fmt::format("{}: {} an orientation tag (EXIF), by which viewers turn {}; pixels "
                               "are used as the sensor recorded them.",
                               camera,
                               count == 1 ? "one image has" : fmt::format("{} images have", count),
                               count == 1 ? "it" : "them"),
           .remedy = "Let other programs that use this calibration ignore the tag as well (OpenCV: "
                     "IMREAD_IGNORE_ORIENTATION)."}};
}

}  // namespace plenocal
