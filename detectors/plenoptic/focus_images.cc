// SPDX-License-Identifier: Apache-2.0
#include "detectors/focus_images.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <memory>
#include <opencv2/imgproc.hpp>
#include <optional>
#include <utility>

#include "calib/error.h"
#include "calib/number_text.h"
#include "calib/raytrix_grid.h"
#include "detectors/depth_picture.h"
#include "detectors/focus_each.h"
#include "detectors/focused_markers.h"
#include "detectors/image.h"
#include "detectors/white_measurement.h"

namespace plenocal {
namespace {

namespace fs = std::filesystem;

bool IsXml(const fs::path& path) { return path.extension() == ".xml"; }

PlenopticCamera CameraFromWhiteImages(const FocusRequest& request) {
  const PlenopticSource& source = request.camera;
  WhiteOptions options{.plenoptic = true,
                       .bayer = !source.bayer.empty(),
                       .grid_file = std::nullopt,
                       .raw_image = {},
                       .threads = request.threads};
  if (!source.grid.empty()) options.grid_file = source.grid;
  internal::WhiteMeasurement white = internal::MeasureWhite(source.white_images, options);
  for (const std::string& warning : white.camera.warnings) request.message("  " + warning);
  for (const LeftOut& item : white.camera.left_out) {
    request.message(fmt::format("  left out {}: {}", item.where, item.reason));
  }
  return {std::move(white.camera.grid->array), white.attenuation, source.bayer};
}

PlenopticCamera CameraFromFiles(const FocusRequest& request) {
  const PlenopticSource& source = request.camera;
  PlenopticCamera camera;
  camera.bayer = source.bayer;
  camera.attenuation =
      source.vignetting.empty()
          ? cv::Mat(ReadImage(request.raw_images[0].path).size(), CV_32F, cv::Scalar(1))
          : ReadAttenuation(source.vignetting);
  const ImageSize size{camera.attenuation.cols, camera.attenuation.rows};
  if (IsXml(source.grid)) {
    camera.array = ReadRayCalibData(source.grid, size);
    const std::string unused = UnusedRayCalibData(source.grid);
    if (!unused.empty()) request.message("  " + unused);
  } else {
    camera.array = ReadMicroLenses(source.grid, size);
  }
  return camera;
}

/// Virtual depth and its sigma, NaN where it is unknown.
std::pair<cv::Mat, cv::Mat> DepthMaps(const VirtualDepth& depth) {
  cv::Mat v = 1 / depth.inverse;
  cv::Mat sigma = depth.sigma.mul(v).mul(v);
  const cv::Mat unknown = depth.known == 0;
  v.setTo(std::numeric_limits<float>::quiet_NaN(), unknown);
  sigma.setTo(std::numeric_limits<float>::quiet_NaN(), unknown);
  return {v, sigma};
}

FrameFiles Files(const FocusedView& view, int raw_depth) {
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
          {"virtual_depth.png", EncodeImage(".png", internal::DepthPicture(view.depth))},
          {"focused.yaml",
           fmt::format("plenocal: 1\n"
                       "# pixel (x, y) of focused.png and virtual_depth*.tiff lies at raw pixel "
                       "offset + scale * (x, y)\n"
                       "offset: [0, 0]\nscale: {}\n",
                       YamlNumber(view.depth.scale))}};
}

std::string Summary(const FocusedView& view) {
  std::vector<float> known;
  for (int y = 0; y < view.depth.inverse.rows; ++y) {
    for (int x = 0; x < view.depth.inverse.cols; ++x) {
      if (view.depth.known.at<uchar>(y, x) != 0)
        known.push_back(view.depth.inverse.at<float>(y, x));
    }
  }
  std::sort(known.begin(), known.end());
  return fmt::format(
      "{} x {} pixels, virtual depth known in {:.0f} %, {:.2f} to {:.2f} ({}){}",
      view.image.cols,
      view.image.rows,
      100.0 * static_cast<double>(known.size()) / static_cast<double>(view.image.total()),
      1 / known[known.size() - 1 - known.size() / 100],
      1 / known[known.size() / 100],
      view.keplerian ? "Keplerian" : "Galilean",
      view.flat_parts > 0 ? fmt::format(", {} flat parts", view.flat_parts) : "");
}

}  // namespace

void FocusImages(const FocusRequest& request) {
  const PlenopticCamera camera = request.camera.white_images.empty()
                                     ? CameraFromFiles(request)
                                     : CameraFromWhiteImages(request);
  FocusOptions options{
      .scale = request.scale, .colour = true, .threads = request.threads, .find_flat_parts = {}};
  if (request.target != nullptr) {
    options.find_flat_parts = [markers =
                                   std::make_shared<internal::FocusedMarkers>(*request.target)](
                                  const cv::Mat& image) { return markers->FlatParts(image); };
  }
  FocusEach(request.raw_images,
            camera,
            {options, request.progress, request.message},
            [&](const FrameImage& raw, const FocusedView& view, int depth) {
              request.result(raw.frame, Files(view, depth), Summary(view));
            });
}

}  // namespace plenocal
