// SPDX-License-Identifier: Apache-2.0
#include "detectors/plenoptic/focus_images.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <memory>
#include <opencv2/imgproc.hpp>
#include <optional>
#include <utility>

#include "calib/base/error.h"
#include "calib/base/number_text.h"
#include "detectors/images/image.h"
#include "detectors/plenoptic/depth/image_synthesis.h"
#include "detectors/plenoptic/depth/reconstruction.h"
#include "detectors/plenoptic/markers/focused_image_detector.h"
#include "detectors/plenoptic/views/depth_picture.h"

namespace plenocal {
namespace {

/// Virtual depth and its sigma, NaN where it is unknown.
std::pair<cv::Mat, cv::Mat> DepthMaps(const VirtualDepth& depth) {
  cv::Mat v = 1 / depth.inverse;
  cv::Mat sigma = depth.sigma.mul(v).mul(v);
  const cv::Mat unknown = depth.known == 0;
  v.setTo(std::numeric_limits<float>::quiet_NaN(), unknown);
  sigma.setTo(std::numeric_limits<float>::quiet_NaN(), unknown);
  return {v, sigma};
}

FrameFiles Files(const Reconstruction& view, int raw_depth) {
  const auto [v, sigma] = DepthMaps(view.depth);
  // Values as in the raw image, unless the corrected ones exceed its range.
  const double range = raw_depth == CV_8U ? 255 : 65535;
  const cv::Mat& exact = view.colour.empty() ? view.image : view.colour;
  cv::Mat image;
  exact.convertTo(
      image, raw_depth, std::min(1.0, internal::ScaleTo8Bits(exact.reshape(1)) * range / 255));
  return {{"focused.png", EncodeImage(".png", image)},
          {"virtual_depth.tiff", EncodeImage(".tiff", v)},
          {"virtual_depth_sigma.tiff", EncodeImage(".tiff", sigma)},
          {"virtual_depth_16bit.png", EncodeImage(".png", internal::RxLiveDepth(view.depth))},
          {"virtual_depth.png", EncodeImage(".png", internal::DepthPicture(view.depth))},
          {"focused.yaml",
           fmt::format("plenocal: 1\n"
                       "# pixel (x, y) of focused.png and virtual_depth*.tiff lies at raw pixel "
                       "offset + scale * (x, y)\n"
                       "offset: [0, 0]\nscale: {}\n",
                       YamlNumber(view.depth.scale))}};
}

std::string Summary(const Reconstruction& view) {
  const auto [low, high] = internal::UsualRange(view.depth);
  return fmt::format(
      "{} x {} pixels, virtual depth known in {:.0f} %, {:.2f} to {:.2f} ({}){}",
      view.image.cols,
      view.image.rows,
      100.0 * cv::countNonZero(view.depth.known) / static_cast<double>(view.image.total()),
      1 / high,
      1 / low,
      view.keplerian ? "Keplerian" : "Galilean",
      view.flat_parts > 0 ? fmt::format(", {} flat parts", view.flat_parts) : "");
}

/// `Reconstruct`, whose errors name the file.
Reconstruction ReconstructNamed(const std::filesystem::path& path,
                                cv::Mat image,
                                const PlenopticCamera& camera,
                                const ReconstructionOptions& options) {
  try {
    return Reconstruct(std::move(image), camera, options);
  } catch (const Error& error) {
    throw Error(error.kind(), fmt::format("{}: {}", path.string(), error.what()));
  }
}

}  // namespace

size_t ReconstructImages(
    const std::vector<FrameImage>& images,
    const PlenopticCamera& camera,
    const ReconstructionOptions& options,
    const LoopReports& reports,
    const std::function<void(const FrameImage& raw, const Reconstruction& view, int depth)>& take) {
  std::optional<Error> first;
  std::vector<LatticeShift> lattices;
  for (size_t i = 0; i < images.size(); ++i) {
    const FrameImage& raw = images[i];
    if (!reports.progress(i)) throw Stopped();
    Reconstruction view;
    int depth = 0;
    try {
      cv::Mat image = ReadImage(raw);
      depth = image.depth();
      view = ReconstructNamed(raw.path, std::move(image), camera, options);
    } catch (const Error& error) {
      if (images.size() > 1) reports.message(fmt::format("  left out {}", error.what()));
      if (!first) first = error;
      continue;
    }
    lattices.push_back(view.lattice);
    take(raw, view, depth);
  }
  if (lattices.empty()) throw Error(*first);
  if (const auto shift = SignificantShift(lattices)) reports.message("  " + ShiftText(*shift));
  return lattices.size();
}

void FocusImages(const FocusRequest& request) {
  const PlenopticCamera camera =
      LoadPlenopticCamera(request.camera, request.raw_images[0], request.threads, request.message);
  ReconstructionOptions options{.scale = request.scale,
                                .colour = true,
                                .threads = request.threads,
                                .find_flat_parts = {},
                                .common_error = internal::kCommonError / camera.array.Pitch()};
  if (request.target != nullptr) {
    options.find_flat_parts =
        [markers = std::make_shared<internal::FocusedImageDetector>(*request.target)](
            const cv::Mat& image) { return markers->FlatParts(image); };
  }
  ReconstructImages(request.raw_images,
                    camera,
                    options,
                    {request.progress, request.message},
                    [&](const FrameImage& raw, const Reconstruction& view, int depth) {
                      request.result(raw.frame, Files(view, depth), Summary(view));
                    });
}

}  // namespace plenocal
