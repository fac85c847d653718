// SPDX-License-Identifier: Apache-2.0
#include "detectors/plenoptic/white/white_camera.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>

#include "calib/base/format_error.h"
#include "calib/files/raytrix_grid.h"
#include "detectors/images/attenuation.h"
#include "detectors/images/image.h"
#include "detectors/images/white_images.h"
#include "detectors/plenoptic/white/grid_picture.h"
#include "detectors/plenoptic/white/micro_lens_attenuation.h"

namespace plenocal {
namespace {

/// Largest share of dead or dirty micro lenses; above it the field was not even.
constexpr double kMaxUnusable = 0.1;

/// A raw image must be of the size of the white images.
void CheckRawImage(const std::filesystem::path& path, const cv::Mat& white) {
  const cv::Mat raw = ReadImage(path);
  if (raw.size() == white.size()) return;
  throw InputError(
      "{}: is {} x {} pixels, but the white images are {} x {}; record them "
      "with the same settings of the camera",
      path.string(),
      raw.cols,
      raw.rows,
      white.cols,
      white.rows);
}

/// Throws `Error` when more micro images are unusable than dirt explains.
void CheckUsable(const MicroLensArray& array, const WhiteOptions& options) {
  const auto& lenses = array.lenses;
  const auto unusable = static_cast<size_t>(
      std::count_if(lenses.begin(), lenses.end(), [](const MicroLens& l) { return !l.usable; }));
  if (static_cast<double>(unusable) <= kMaxUnusable * static_cast<double>(lenses.size())) return;
  throw JobError("{} of {} micro images do not look like the others: {}",
                 unusable,
                 lenses.size(),
                 options.grid_file ? "does the grid belong to these images?"
                                   : "the white images show a scene or the array is "
                                     "dirty; record an even white field");
}

/// The grid in the levelled white image, by the file's centres if there is one.
MicroLensGrid MeasureGrid(const cv::Mat& levelled,
                          const WhiteOptions& options,
                          const std::vector<std::string>& warnings) {
  try {
    if (!options.grid_file) return FindMicroLensGrid(levelled, options.threads);
    return MeasureMicroLensGrid(
        levelled,
        ReadRayCalibData(*options.grid_file, {levelled.cols, levelled.rows}),
        options.threads);
  } catch (const Error& error) {
    if (warnings.empty()) throw;
    throw Error(error.kind(), fmt::format("{}; {}", error.what(), warnings[0]));
  }
}

/// A white image has equal green planes by the right colour order.
void CheckColourOrder(const cv::Mat& white, BayerOrder order) {
  const double difference = GreenDifference(white, order);
  if (difference == 0) return;
  throw InputError(
      "bayer: {}: its green pixels differ by {:.0f} % in the white images, and its red and blue "
      "ones do not; the order is {}",
      BayerName(order),
      100 * difference,
      BayerColour(order, 0, 0) == 'G' ? "RGGB or BGGR" : "GRBG or GBRG");
}

std::vector<std::string> Warnings(const cv::Mat& white, const WhiteOptions& options) {
  std::vector<std::string> warnings;
  const double difference = options.bayer ? 0 : PlaneDifference(white);
  if (difference > 0) {
    warnings.push_back(fmt::format(
        "the white images look like raw colour mosaics (the planes of their 2 x 2 raster differ "
        "by {:.0f} %); if they are, state it with 'bayer'",
        100 * difference));
  }
  if (options.bayer && PlanesAgree(white)) {
    warnings.push_back(fmt::format(
        "bayer: {}: the planes of the 2 x 2 raster are alike in the white images, as those of a grey "
        "camera; if it is one, leave 'bayer' out",
        BayerName(*options.bayer)));
  }
  if (options.grid_file) {
    const std::string unused = UnusedRayCalibData(*options.grid_file);
    if (!unused.empty()) warnings.push_back(unused);
  }
  return warnings;
}

}  // namespace

namespace internal {

WhiteCamera MeasureWhite(const std::vector<FrameImage>& images,
                         const WhiteOptions& options,
                         cv::Mat* attenuation,
                         cv::Mat* levelled) {
  const WhiteImages white = AverageWhiteImages(images, options.threads);
  if (!options.raw_image.empty()) CheckRawImage(options.raw_image, white.mean);
  WhiteCamera camera{.image_size = {white.mean.cols, white.mean.rows},
                     .images = white.members.size(),
                     .level = white.level,
                     .full_scale = white.full_scale,
                     .saturated = white.saturated,
                     .black = white.black,
                     .unevenness = white.unevenness,
                     .left_out = white.left_out,
                     .warnings = Warnings(white.mean, options)};
  if (options.bayer) CheckColourOrder(white.mean, *options.bayer);
  if (options.plenoptic) {
    *levelled = options.bayer ? LevelBayerPlanes(white.mean) : white.mean;
    camera.grid = MeasureGrid(*levelled, options, camera.warnings);
    CheckUsable(camera.grid->array, options);
    const LatticeErrors nominal = ErrorsOfNominalGrid(camera.image_size);
    if (!options.grid_file && camera.grid->array.errors.covariance == nominal.covariance) {
      camera.warnings.emplace_back(
          "fewer than 60 whole micro images do not show the errors of their centres: 0.1 px is "
          "assumed, which makes standard errors large");
    }
    *attenuation = MicroLensAttenuation(white.mean, *camera.grid, options.bayer);
  } else {
    CheckEvenField(white.mean);
    *attenuation = SmoothAttenuation(white.mean, options.bayer);
  }
  cv::minMaxLoc(*attenuation, &camera.darkest);
  if (options.measure_noise) camera.noise = MeasurePhotonTransfer(images, white, options.bayer);
  return camera;
}

}  // namespace internal

WhiteCamera MeasureWhiteImages(const std::vector<FrameImage>& images, const WhiteOptions& options) {
  cv::Mat attenuation, levelled;
  WhiteCamera camera = internal::MeasureWhite(images, options, &attenuation, &levelled);
  camera.attenuation_tiff = EncodeImage(".tiff", attenuation);
  if (camera.grid) camera.grid_png = EncodeImage(".png", GridPicture(levelled, camera.grid->array));
  return camera;
}

}  // namespace plenocal
