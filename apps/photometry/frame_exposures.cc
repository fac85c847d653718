// SPDX-License-Identifier: Apache-2.0
#include "apps/photometry/frame_exposures.h"

#include <fmt/format.h>

#include <algorithm>
#include <atomic>
#include <bit>
#include <cmath>
#include <iterator>
#include <limits>
#include <opencv2/imgproc.hpp>
#include <optional>

#include "apps/photometry/images/exposed_images.h"
#include "calib/base/format_error.h"
#include "calib/base/number_text.h"
#include "calib/base/parallel.h"
#include "calib/base/robust.h"
#include "calib/base/statistics.h"
#include "calib/io/output_folder.h"
#include "detectors/images/image.h"
#include "detectors/photometry/response_curve.h"
#include "engine/observe/left_out.h"
#include "engine/scene/track/feature_tracker.h"

namespace plenocal {
namespace {

constexpr double kUnknown = std::numeric_limits<double>::quiet_NaN();
constexpr int kFeatures = 500;
constexpr int kPatchReach = 4;  // px
/// Fewer points do not outvote wrong matches and shiny spots.
constexpr size_t kFewestPatches = 15;
/// An exposure differs when it is this many standard deviations away.
constexpr double kFarOff = 5;
/// Standard deviation of a median over that of a mean, of normal values.
constexpr double kMedianOverMean = 1.2533;

/// Response and attenuation: from a camera's grey values to light.
struct Photometry {
  std::optional<ResponseCurve> response;
  cv::Mat attenuation;  // CV_32F; empty: none
};

/// An image for matching and its light.
struct LightImage {
  ImageFeatures features;
  cv::Mat light;    // CV_32F
  cv::Mat clipped;  // CV_8U: not zero near a pixel that is saturated or black
};

/// ln of a camera's light over that of the first camera, in one frame.
struct Comparison {
  double log_ratio = kUnknown, sigma = 0;
  size_t points = 0;
  std::string problem = {};
};

cv::Mat ReadRelativeAttenuation(const std::filesystem::path& path) {
  if (path.extension() == ".tiff" || path.extension() == ".tif") return ReadAttenuation(path);
  cv::Mat attenuation;
  ToGray(ReadImage(path)).convertTo(attenuation, CV_32F);
  double largest = 0;
  cv::minMaxLoc(attenuation, nullptr, &largest);
  return attenuation / std::max(largest, 1.0);
}

Photometry ReadPhotometry(const RecordedCamera& camera) {
  Photometry photometry;
  if (!camera.response.empty()) photometry.response = ReadResponse(camera.response);
  if (camera.vignetting.empty()) return photometry;
  photometry.attenuation = ReadRelativeAttenuation(camera.vignetting);
  if (photometry.attenuation.cols != camera.image_size[0] ||
      photometry.attenuation.rows != camera.image_size[1]) {
    throw InputError("{}: is {} x {} pixels, but the images of {} are {} x {}",
                     camera.vignetting.string(),
                     photometry.attenuation.cols,
                     photometry.attenuation.rows,
                     camera.name,
                     camera.image_size[0],
                     camera.image_size[1]);
  }
  cv::max(photometry.attenuation, 1e-3, photometry.attenuation);
  return photometry;
}

LightImage ReadLight(const RecordedCamera& camera, size_t index, const Photometry& photometry) {
  const cv::Mat image = camera.Read(index);
  LightImage result;
  result.features = FindFeatures(ScaledTo8Bits(image), kFeatures, {}, 0);
  double largest = 0;
  cv::minMaxLoc(image, nullptr, &largest);
  const double full_scale =
      image.depth() == CV_8U ? 255 : std::bit_ceil(static_cast<unsigned>(largest) + 1) - 1;
  const cv::Mat kernel = cv::Mat::ones(2 * kPatchReach + 1, 2 * kPatchReach + 1, CV_8U);
  cv::dilate((image >= full_scale) | (image == 0), result.clipped, kernel);
  if (image.depth() == CV_8U && photometry.response) {
    result.light = LightOf(image, *photometry.response);
  } else {
    image.convertTo(result.light, CV_32F);
  }
  if (!photometry.attenuation.empty()) result.light /= photometry.attenuation;
  cv::blur(result.light, result.light, kernel.size());
  return result;
}

std::optional<double> LogLight(const LightImage& image, const cv::Point2f& point) {
  const cv::Point pixel(cvRound(point.x), cvRound(point.y));
  const cv::Rect inside(kPatchReach,
                        kPatchReach,
                        image.light.cols - 2 * kPatchReach,
                        image.light.rows - 2 * kPatchReach);
  if (!inside.contains(pixel) || image.clipped.at<unsigned char>(pixel) != 0) return {};
  const float light = image.light.at<float>(pixel);
  if (!(light > 0)) return {};
  return std::log(light);
}

Comparison CompareLight(const LightImage& first, const LightImage& other) {
  std::vector<cv::Point2f> a, b;
  for (const auto& [i, j] :
       MatchDescriptors(first.features.descriptors, other.features.descriptors)) {
    a.push_back(first.features.points[static_cast<size_t>(i)]);
    b.push_back(other.features.points[static_cast<size_t>(j)]);
  }
  const std::vector<bool> agrees = OnOneEpipolarGeometry(a, b);
  std::vector<double> ratios;
  for (size_t i = 0; i < a.size(); ++i) {
    if (!agrees[i]) continue;
    const auto of_first = LogLight(first, a[i]), of_other = LogLight(other, b[i]);
    if (of_first && of_other) ratios.push_back(*of_other - *of_first);
  }
  Comparison result{.points = ratios.size()};
  if (ratios.size() < kFewestPatches) {
    result.problem = fmt::format(
        "{} points in common that are not clipped; {} are needed", ratios.size(), kFewestPatches);
    return result;
  }
  result.log_ratio = Median(ratios);
  for (double& ratio : ratios) ratio = std::abs(ratio - result.log_ratio);
  const auto count = static_cast<double>(ratios.size());
  result.sigma = kMedianOverMean * kSigmaPerMad * Median(std::move(ratios)) / std::sqrt(count);
  return result;
}

double RecordedExposure(const RecordedCamera& camera, size_t index) {
  return camera.images[index].exposure.value_or(kUnknown);
}

// The comparisons of one frame, by camera.
std::vector<Comparison> CompareFrame(const Recording& recording,
                                     const RecordedFrame& frame,
                                     const std::vector<Photometry>& photometry) {
  std::vector<Comparison> comparisons(recording.cameras.size());
  if (!frame.image[0]) return comparisons;
  try {
    const LightImage first = ReadLight(recording.cameras[0], *frame.image[0], photometry[0]);
    for (size_t c = 1; c < recording.cameras.size(); ++c) {
      if (!frame.image[c]) continue;
      comparisons[c] =
          CompareLight(first, ReadLight(recording.cameras[c], *frame.image[c], photometry[c]));
    }
  } catch (const Error& error) {
    for (Comparison& comparison : comparisons) comparison.problem = error.what();
  }
  return comparisons;
}

// Recorded exposures divided out where both are known, then the camera's median.
void Judge(std::vector<RelativeExposure>* images) {
  std::vector<double> ratios;
  for (const RelativeExposure& image : *images) ratios.push_back(image.log_ratio);
  const double usual = Median(ratios);
  for (double& ratio : ratios) ratio = std::abs(ratio - usual);
  const double scatter = kSigmaPerMad * Median(std::move(ratios));
  for (RelativeExposure& image : *images) {
    image.log_ratio -= usual;
    image.sigma = std::max(image.sigma, scatter);
    image.differs = std::abs(image.log_ratio) > kFarOff * image.sigma;
  }
}

}  // namespace

double RelativeExposure::Exposure() const {
  return differs ? recorded * std::exp(log_ratio) : recorded;
}

FrameExposures CompareExposures(const Recording& recording,
                                int threads,
                                const std::function<void(size_t done, size_t total)>& done) {
  if (recording.cameras.size() < 2) {
    throw InputError("{}: has one camera; exposures of the cameras of a frame are compared",
                     recording.path.string());
  }
  FrameExposures result;
  std::vector<Photometry> photometry;
  for (const RecordedCamera& camera : recording.cameras) {
    photometry.push_back(ReadPhotometry(camera));
    if (!photometry.back().response) {
      result.warnings.push_back(
          fmt::format("{}: without 'response' in recording.yaml its grey values are taken for "
                      "proportional to the light",
                      camera.name));
    }
  }
  std::vector<std::vector<Comparison>> comparisons(recording.frames.size());
  std::atomic<size_t> count{0};
  ParallelFor(recording.frames.size(), threads, [&](size_t f) {
    done(count++, recording.frames.size());
    comparisons[f] = CompareFrame(recording, recording.frames[f], photometry);
  });
  for (size_t c = 1; c < recording.cameras.size(); ++c) {
    const RecordedCamera& camera = recording.cameras[c];
    std::vector<RelativeExposure> images;
    for (size_t f = 0; f < recording.frames.size(); ++f) {
      const RecordedFrame& frame = recording.frames[f];
      if (!frame.image[0] || !frame.image[c]) continue;
      const Comparison& comparison = comparisons[f][c];
      const std::string& name = camera.images[*frame.image[c]].frame;
      if (!comparison.problem.empty()) {
        result.left_out.push_back({fmt::format("{}: {}", camera.name, name), comparison.problem});
        continue;
      }
      RelativeExposure image{.frame = name,
                             .camera = camera.name,
                             .recorded = RecordedExposure(camera, *frame.image[c]),
                             .log_ratio = comparison.log_ratio,
                             .sigma = comparison.sigma,
                             .points = comparison.points};
      const double of_first = RecordedExposure(recording.cameras[0], *frame.image[0]);
      if (image.recorded > 0 && of_first > 0)
        image.log_ratio -= std::log(image.recorded / of_first);
      images.push_back(std::move(image));
    }
    Judge(&images);
    std::ranges::move(images, std::back_inserter(result.images));
  }
  if (result.images.empty()) {
    throw JobError(
        "{}: no frame shows points in two cameras; the first: {}: {}",
        recording.path.string(),
        result.left_out.empty() ? recording.frames[0].name : result.left_out[0].where,
        result.left_out.empty() ? "its cameras have no common frame" : result.left_out[0].reason);
  }
  return result;
}

std::string FrameExposuresCsv(const Recording& recording, const FrameExposures& exposures) {
  std::string text = kExposuresHead;
  const RecordedCamera& first = recording.cameras[0];
  for (size_t i = 0; i < first.images.size(); ++i) {
    text += ExposureRow(first.images[i].frame, first.name, RecordedExposure(first, i), 0, 0);
  }
  for (const RelativeExposure& image : exposures.images) {
    const double relative = std::expm1(image.log_ratio);
    text += ExposureRow(image.frame, image.camera, image.Exposure(), relative, image.sigma);
  }
  return text;
}

std::string MeasureExposures(const Recording& recording,
                             const std::filesystem::path& out,
                             const Run& run) {
  const FrameExposures exposures =
      CompareExposures(recording, run.threads, [&](size_t done, size_t total) {
        const auto stage = fmt::format("exposures: frame {} of {}", done + 1, total);
        if (!run.Progress(stage)) throw Stopped();
      });
  for (const std::string& warning : exposures.warnings) run.Warning(warning);
  ReportLeftOut(exposures.left_out, run);
  if (!out.empty()) {
    WriteInto(out, {{"exposures.csv", FrameExposuresCsv(recording, exposures)}});
  }
  std::string text;
  size_t different = 0;
  for (const RelativeExposure& image : exposures.images) {
    if (!image.differs) continue;
    ++different;
    text += fmt::format("{} of {}: exposure {:+.1f} % +- {:.1f} % from {}, by {}\n",
                        image.frame,
                        image.camera,
                        100 * std::expm1(image.log_ratio),
                        100 * image.sigma,
                        std::isnan(image.recorded)
                            ? "the usual ratio to the first camera's"
                            : fmt::format("the recorded {:.4g} ms", image.recorded),
                        Counted(image.points, "point"));
  }
  return text + fmt::format("exposures differ in {} of {}\n",
                            different,
                            Counted(exposures.images.size(), "image"));
}

}  // namespace plenocal
