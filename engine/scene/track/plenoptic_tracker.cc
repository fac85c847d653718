// SPDX-License-Identifier: Apache-2.0
#include "engine/scene/track/plenoptic_tracker.h"

#include <cstdint>
#include <utility>

#include "detectors/images/image_codecs.h"
#include "detectors/plenoptic/depth/image_synthesis.h"
#include "detectors/plenoptic/markers/marker_views.h"
#include "detectors/plenoptic/markers/patch_measurement.h"
#include "detectors/plenoptic/white/white_camera.h"

namespace plenocal {
namespace {

cv::Mat ToEightBits(const cv::Mat& image, double factor) {
  cv::Mat grey;
  image.convertTo(grey, CV_8U, factor);
  return grey;
}

Eigen::Matrix2d ToEigen(const cv::Matx22f& A) {
  Eigen::Matrix2d matrix;
  matrix << A(0, 0), A(0, 1), A(1, 0), A(1, 1);
  return matrix;
}

}  // namespace

PlenopticCamera MeasurePlenopticCamera(const std::vector<FrameImage>& white_images,
                                       std::optional<BayerOrder> bayer,
                                       int threads,
                                       std::vector<LeftOut>* left_out) {
  WhiteCamera white = MeasureWhiteImages(white_images,
                                         {.plenoptic = true,
                                          .bayer = bayer,
                                          .grid_file = std::nullopt,
                                          .raw_image = {},
                                          .threads = threads});
  left_out->insert(left_out->end(), white.left_out.begin(), white.left_out.end());
  const std::string& tiff = white.attenuation_tiff;
  return {std::move(white.grid->array),
          DecodeImage(std::vector<std::uint8_t>(tiff.begin(), tiff.end()), Channels::kAsStored),
          bayer};
}

PlenopticTracker::PlenopticTracker(const BundleCamera& camera,
                                   const PlenopticCamera& optics,
                                   const FeatureOptions& options,
                                   int first_number,
                                   int threads)
    : optics_(optics),
      camera_{camera},
      tracker_(camera_, options, first_number),
      threads_(threads) {}

void PlenopticTracker::AddFrame(const std::string& name, const cv::Mat& raw) {
  Reconstruction view;
  try {
    ReconstructionOptions options;
    options.threads = threads_;
    view = Reconstruct(raw.clone(), optics_, options);
  } catch (...) {
    tracker_.AddFrame(name, {cv::Mat()});
    throw;
  }
  if (!brightness_) brightness_ = internal::ScaleTo8Bits(view.image);
  tracker_.AddFrame(name, {ToEightBits(view.image, *brightness_)});
  std::vector<ScenePatch> points;
  for (const FeatureTracker::Followed& point : tracker_.FollowedNow()) {
    points.push_back({.number = point.number,
                      .reference = point.key_image,
                      .in_reference = {point.in_key.x, point.in_key.y},
                      .position = {point.now.point.x, point.now.point.y},
                      .by_reference = ToEigen(point.now.A)});
  }
  // The reconstruction has corrected its own patches.
  const internal::LensPatches patches = GreyPatches(raw, optics_, threads_);
  frames_.push_back(name);
  measured_.push_back(MeasurePatches(points, view, patches, optics_.array, threads_));
}

std::vector<View> PlenopticTracker::Views() const {
  return MarkerViews(frames_, optics_.array.types, measured_, false);
}

cv::Mat FocusedImage(const cv::Mat& raw, const PlenopticCamera& optics, int threads) {
  ReconstructionOptions options;
  options.threads = threads;
  const Reconstruction view = Reconstruct(raw.clone(), optics, options);
  return ToEightBits(view.image, internal::ScaleTo8Bits(view.image));
}

}  // namespace plenocal
