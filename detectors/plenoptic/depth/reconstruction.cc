// SPDX-License-Identifier: Apache-2.0
#include "detectors/focus.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>
#include <optional>

#include "calib/error.h"
#include "detectors/focused_image.h"
#include "detectors/raw_check.h"

namespace plenocal {

namespace {

/// One channel as CV_32F.
cv::Mat Exact(const cv::Mat& channel) {
  cv::Mat exact;
  channel.convertTo(exact, CV_32F);
  return exact;
}

/// A mosaic stays one.
cv::Mat GreyOf(const cv::Mat& raw) {
  if (raw.channels() == 1) return Exact(raw);
  cv::Mat grey;
  cv::cvtColor(raw, grey, cv::COLOR_BGR2GRAY);
  return Exact(grey);
}

/// All colours alike: where black meets white, the four pixels of the raster must be of one
/// contrast, or the mean over 3 x 3 is another blur for each. The image as a whole is grey.
internal::MosaicWeights GreyOfMosaic(const cv::Mat& raw, const cv::Mat& attenuation) {
  std::array<double, 4> light{}, value{};
  for (int y = 0; y < raw.rows; ++y) {
    for (int x = 0; x < raw.cols; ++x) {
      const size_t place = 2 * static_cast<size_t>(y & 1) + static_cast<size_t>(x & 1);
      light[place] += attenuation.at<float>(y, x);
      value[place] += raw.at<float>(y, x);
    }
  }
  internal::MosaicWeights weights;
  double sum = 0;
  for (size_t i = 0; i < weights.size(); ++i) sum += light[i] / value[i];
  for (size_t i = 0; i < weights.size(); ++i) {
    // A colour without any light says nothing of the others.
    weights[i] = std::isfinite(sum) ? static_cast<float>(light[i] / value[i] / sum) : 0.25f;
  }
  return weights;
}

internal::LensPatches CutGrey(const cv::Mat& grey, const PlenopticCamera& camera, int threads) {
  return internal::CutPatches(
      grey,
      camera.attenuation,
      camera.array,
      camera.bayer.empty() ? std::nullopt : std::optional(GreyOfMosaic(grey, camera.attenuation)),
      threads);
}

/// The micro images in one colour: 0 blue, 1 green, 2 red.
internal::LensPatches CutColour(const cv::Mat& raw,
                                int colour,
                                const PlenopticCamera& camera,
                                int threads) {
  using namespace internal;
  if (camera.bayer.empty()) {
    cv::Mat channel;
    cv::extractChannel(raw, channel, colour);
    return CutPatches(Exact(channel), camera.attenuation, camera.array, std::nullopt, threads);
  }
  const char letter = "BGR"[colour];
  const auto pixels =
      static_cast<float>(std::count(camera.bayer.begin(), camera.bayer.end(), letter));
  MosaicWeights weights;
  std::transform(camera.bayer.begin(), camera.bayer.end(), weights.begin(), [&](char c) {
    return c == letter ? 1 / pixels : 0;
  });
  return CutPatches(Exact(raw), camera.attenuation, camera.array, weights, threads);
}

}  // namespace

internal::LensPatches GreyPatches(const cv::Mat& raw, const PlenopticCamera& camera, int threads) {
  return CutGrey(GreyOf(raw), camera, threads);
}

FocusedView Focus(cv::Mat raw, const PlenopticCamera& camera, const FocusOptions& options) {
  using namespace internal;
  if (raw.size() != camera.attenuation.size()) {
    throw Error(
        ErrorKind::kInput,
        fmt::format(
            "is {} x {} pixels, but the white images or the vignetting file are {} x {}; use those "
            "of this camera",
            raw.cols,
            raw.rows,
            camera.attenuation.cols,
            camera.attenuation.rows));
  }
  if (!camera.bayer.empty() && raw.channels() != 1) {
    throw Error(ErrorKind::kInput,
                "has colours already, so it is no raw mosaic; leave --bayer out");
  }
  cv::Mat grey = GreyOf(raw);
  const bool colour = options.colour && (raw.channels() == 3 || !camera.bayer.empty());
  if (!colour) raw.release();
  const std::string wrong = WhyNotOfThisGrid(grey, camera.attenuation, camera.array);
  if (!wrong.empty()) throw Error(ErrorKind::kJob, wrong);

  const int threads = options.threads;
  const MicroLensArray& array = camera.array;
  const MicroLensIndex index(array);
  FocusedView view;
  view.patches = CutGrey(grey, camera, threads);
  grey.release();  // the patches have all that is needed of it
  view.noise = EstimateNoise(view.patches);
  const LensPatches& patches = view.patches;
  const SensorNoise& noise = view.noise;
  const DepthSurvey survey = SurveyDepth(patches, array, index, noise, threads);
  view.keplerian = survey.range.highest < 0;
  view.depth = FuseDepth(MatchMicroImages(array, index, noise, survey, threads, &view.patches),
                         array,
                         patches.radius_px,
                         options.scale,
                         threads);
  if (cv::countNonZero(view.depth.known) == 0) {
    throw Error(ErrorKind::kJob,
                "has no detail that several micro images show, so no depth can be found; light the "
                "scene or focus the "
                "main lens");
  }
  const auto synthesise = [&](const LensPatches& seen, const SensorNoise& its_noise) {
    return SynthesiseFocused(view.depth, seen, array, index, its_noise, survey, threads);
  };
  view.image = synthesise(patches, noise);
  if (options.find_flat_parts) {
    view.flat_parts = FlattenParts(options.find_flat_parts(view.image), &view.depth);
    if (view.flat_parts > 0) view.image = synthesise(patches, noise);
  }
  if (colour) {
    view.patches = {};  // makes room
    std::array<cv::Mat, 3> channels;
    for (int c = 0; c < 3; ++c) {
      const LensPatches seen = CutColour(raw, c, camera, threads);
      channels[c] = synthesise(seen, EstimateNoise(seen));
    }
    cv::merge(channels, view.colour);
  }
  return view;
}

}  // namespace plenocal
