// SPDX-License-Identifier: Apache-2.0
//
// Images that blur, saturation or a small target make worse than the others.
#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <limits>
#include <map>
#include <optional>
#include <span>

#include "assess/causes/cause.h"
#include "assess/causes/residual_tests.h"
#include "calib/base/statistics.h"
#include "calib/noise/camera_noise.h"

namespace plenocal {
namespace {

constexpr double kImageLevel = 1e-3;  // false alarms of a test, a camera
// That these are at once the worst by points and by another measure happens by chance once in 1140
// recordings of 20 images.
constexpr Eigen::Index kLeastImages = 3;

/// One image of a camera.
struct ImageSample {
  double defect = 0;  ///< larger is worse, >= 0
  double noise = 0;   ///< median length of its points' residuals, px
};

/// The images with the largest defects, against all others.
struct WorseImages {
  Eigen::Index count = 0;
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

// The division of the images, sorted by defect, whose parts differ most in noise: Student's test of
// the logarithms, in which images scatter alike however large their noise is.
WorseImages LargestDifference(std::span<const ImageSample> sorted) {
  const auto n = static_cast<Eigen::Index>(sorted.size());
  Eigen::VectorXd logarithms(n);
  for (Eigen::Index i = 0; i < n; ++i) {
    logarithms[i] = std::log(sorted[static_cast<size_t>(i)].noise);
  }
  const SequenceSplit split =
      LargestSplit(logarithms,
                   Eigen::VectorXd::Ones(n),
                   kLeastImages,
                   [&](Eigen::Index k, const Eigen::RowVectorXd& step) {
                     const auto next = static_cast<size_t>(k);
                     return step[0] < 0 && sorted[next - 1].defect > sorted[next].defect;
                   });
  if (split.first == 0) return {};
  const auto first = sorted.first(static_cast<size_t>(split.first)),
             others = sorted.subspan(static_cast<size_t>(split.first));
  return {.count = split.first,
          .probability = std::min(1.0, split.Probability()),
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
  const WorseImages worse = LargestDifference(images);
  if (worse.probability > kImageLevel || worse.defect < kPlain * worse.usual_defect) {
    return std::nullopt;
  }
  const double others = MeanSquareNoise(std::span(images).subspan(worse.count));
  if (MeanSquareNoise(images) < kExplains * others) return std::nullopt;
  return worse;
}

// Median distance of a point to its nearest neighbour, px; of many points every k-th is taken.
double Spacing(const std::vector<Eigen::Vector2d>& points) {
  constexpr size_t kTaken = 100;
  std::vector<double> distances;
  for (size_t i = 0; i < points.size(); i += 1 + points.size() / kTaken) {
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
  std::vector<Eigen::Vector2d> positions;  ///< px
  std::vector<double> residuals;           ///< lengths, px
};

// By frame. Rejected points count: bad images have most of them.
std::map<std::string, ImagePoints> PointsOfImages(const Calibration& calibration, size_t c) {
  std::map<std::string, ImagePoints> images;
  ForEachResidual(
      calibration.bundle, c, [&](const BundleObservation& observation, const double* residual) {
        const auto frame = static_cast<size_t>(observation.frame);
        ImagePoints& points = images[calibration.frames[frame]];
        points.positions.emplace_back(observation.seen.values[0], observation.seen.values[1]);
        points.residuals.push_back(std::hypot(residual[0], residual[1]));
      });
  std::erase_if(images, [](const auto& image) {
    constexpr size_t kLeastPoints = 4;
    return image.second.positions.size() < kLeastPoints;
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
      {.code = "blurred_images",
       .what = "blurred",
       .remedy =
           "Hold camera and target still or expose for a shorter time, and keep within the depth of "
           "field; leave these images out ('exclude').",
       .measure = [](const ImagePoints&, const ImageTraits& traits) { return traits.blur; },
       .describe =
           [](double defect, double usual) {
             return fmt::format(
                 "edges have a sigma of {:.1f} px there, else {:.1f} px", defect, usual);
           }},
      {.code = "saturated_images",
       .what = "saturated",
       .remedy =
           "Expose for a shorter time, so that the white of the target is below the largest gray "
           "level, and avoid reflections; leave these images out ('exclude').",
       .measure = [](const ImagePoints&, const ImageTraits& traits) { return traits.saturated; },
       .describe =
           [](double defect, double usual) {
             return fmt::format(
                 "{:.0f} % of the target's area have the largest gray level, else {:.0f} "
                 "%",
                 100 * defect,
                 100 * usual);
           }},
      {.code = "few_pixels",
       .what = "too small",
       .remedy =
           "Take images from nearer, or print a target with fewer and larger squares or tags.",
       .measure = [](const ImagePoints& points,
                     const ImageTraits&) { return 1 / Spacing(points.positions); },
       .describe =
           [](double defect, double usual) {
             return fmt::format("neighbouring points are {:.0f} px apart there, else {:.0f} px",
                                1 / defect,
                                1 / usual);
           }},
  }};
  return kDefects;
}

Finding MakeFinding(const ImageDefect& defect, const WorseImages& worse) {
  return {.code = defect.code,
          .role = FindingRole::kImageDefect,
          .grade = Grade::kGood,
          .value = worse.noise / worse.usual_noise,
          .limit = 1,
          .what = fmt::format("{} images in which the target is {} have {:.1f} times the residuals "
                              "of the others ({}).",
                              worse.count,
                              defect.what,
                              worse.noise / worse.usual_noise,
                              defect.describe(worse.defect, worse.usual_defect)),
          .remedy = defect.remedy};
}

// The defect that has at least half of the noise of all images. False alarms: 1e-3 a defect.
std::vector<Finding> FindWorseImages(const CauseEvidence& evidence) {
  const Calibration& calibration = *evidence.calibration;
  const size_t c = evidence.camera;
  const CameraTraits& traits = *evidence.traits;
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
  return {MakeFinding(*cause, *worst)};
}

}  // namespace

Cause WorseImagesCause() { return {CauseStage::kNoise, FindWorseImages}; }

}  // namespace plenocal
