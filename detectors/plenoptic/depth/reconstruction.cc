// SPDX-License-Identifier: Apache-2.0
#include "detectors/plenoptic/depth/reconstruction.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>
#include <optional>
#include <string_view>

#include "calib/base/format_error.h"
#include "detectors/images/image.h"
#include "detectors/plenoptic/depth/depth_survey.h"
#include "detectors/plenoptic/depth/image_synthesis.h"
#include "detectors/plenoptic/white/grid_mismatch.h"

namespace plenocal {
namespace {

/// One channel as CV_32F.
cv::Mat Exact(const cv::Mat& channel) {
  cv::Mat exact;
  channel.convertTo(exact, CV_32F);
  return exact;
}

/// A mosaic stays one.
cv::Mat GreyOf(const cv::Mat& raw) { return Exact(ToGray(raw)); }

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
    // Without any light in one of the colours no ratio is defined.
    weights[i] = std::isfinite(sum) ? static_cast<float>(light[i] / value[i] / sum) : 0.25f;
  }
  return weights;
}

internal::LensPatches CutGrey(const cv::Mat& grey, const PlenopticCamera& camera, int threads) {
  return internal::CutPatches(
      grey,
      camera.attenuation,
      camera.array,
      camera.bayer ? std::optional(GreyOfMosaic(grey, camera.attenuation)) : std::nullopt,
      threads);
}

/// The micro images in one colour: 0 blue, 1 green, 2 red.
internal::LensPatches CutColour(const cv::Mat& raw,
                                int colour,
                                const PlenopticCamera& camera,
                                int threads) {
  using namespace internal;
  if (!camera.bayer) {
    cv::Mat channel;
    cv::extractChannel(raw, channel, colour);
    return CutPatches(Exact(channel), camera.attenuation, camera.array, std::nullopt, threads);
  }
  const char letter = "BGR"[colour];
  const std::string_view colours = BayerName(*camera.bayer);
  const auto pixels = static_cast<float>(std::count(colours.begin(), colours.end(), letter));
  MosaicWeights weights;
  std::transform(colours.begin(), colours.end(), weights.begin(), [&](char c) {
    return c == letter ? 1 / pixels : 0;
  });
  return CutPatches(Exact(raw), camera.attenuation, camera.array, weights, threads);
}

/// Throws `Error` for a raw image that cannot be of this camera.
void CheckFormat(const cv::Mat& raw, const PlenopticCamera& camera) {
  if (raw.size() != camera.attenuation.size()) {
    throw InputError(
        "is {} x {} pixels, but the white images or the vignetting file are {} x {}; use "
        "those of this camera",
        raw.cols,
        raw.rows,
        camera.attenuation.cols,
        camera.attenuation.rows);
  }
  if (camera.bayer && raw.channels() != 1) {
    throw InputError("has colours already, so it is no raw mosaic; leave --bayer out");
  }
}

/// The totally focused image in colour.
cv::Mat SynthesiseColour(const cv::Mat& raw,
                         const PlenopticCamera& camera,
                         const VirtualDepth& depth,
                         const internal::MicroLensIndex& index,
                         const internal::DepthSurvey& survey,
                         int threads) {
  std::array<cv::Mat, 3> channels;
  for (int c = 0; c < 3; ++c) {
    const internal::LensPatches patches = CutColour(raw, c, camera, threads);
    channels[c] = internal::SynthesiseFocusedImage(
        depth, patches, index, internal::EstimateNoise(patches), survey, threads);
  }
  cv::Mat colour;
  cv::merge(channels, colour);
  return colour;
}

}  // namespace

internal::LensPatches GreyPatches(const cv::Mat& raw, const PlenopticCamera& camera, int threads) {
  return CutGrey(GreyOf(raw), camera, threads);
}

Reconstruction Reconstruct(cv::Mat raw,
                           const PlenopticCamera& camera,
                           const ReconstructionOptions& options) {
  using namespace internal;
  CheckFormat(raw, camera);
  cv::Mat grey = GreyOf(raw);
  const bool colour = options.colour && (raw.channels() == 3 || camera.bayer);
  if (!colour) raw.release();
  const std::string mismatch = GridMismatch(grey, camera.attenuation, camera.array);
  if (!mismatch.empty()) throw Error(ErrorKind::kJob, mismatch);

  const int threads = options.threads;
  const MicroLensIndex index(camera.array);
  Reconstruction view;
  view.lattice = MeasureLatticeShift(
      grey,
      camera.attenuation,
      camera.array,
      camera.bayer ? GreyOfMosaic(grey, camera.attenuation) : MosaicWeights{1, 1, 1, 1});
  view.patches = CutGrey(grey, camera, threads);
  grey.release();  // the patches have all that is needed of it
  view.noise = EstimateNoise(view.patches);
  const DepthSurvey survey = SurveyDepth(view.patches, index, view.noise, threads);
  view.keplerian = survey.range.highest < 0;
  view.depth = FuseDepth(MatchMicroImages(index, view.noise, survey, threads, &view.patches),
                         camera.array,
                         view.patches.radius_px,
                         options.scale,
                         threads);
  if (cv::countNonZero(view.depth.known) == 0) {
    throw JobError(
        "has no detail that several micro images of this grid show, so no depth can be found; if "
        "the grid is of this camera and setting, light the scene or focus the main lens");
  }
  const auto synthesise = [&] {
    return SynthesiseFocusedImage(view.depth, view.patches, index, view.noise, survey, threads);
  };
  view.image = synthesise();
  if (options.find_flat_parts) {
    view.flat_parts =
        FlattenParts(options.find_flat_parts(view.image), options.common_error, &view.depth);
    if (view.flat_parts > 0) view.image = synthesise();
  }
  if (colour) {
    view.patches = {};  // frees their memory
    view.colour = SynthesiseColour(raw, camera, view.depth, index, survey, threads);
  }
  return view;
}

}  // namespace plenocal
