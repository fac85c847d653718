// SPDX-License-Identifier: Apache-2.0
#include "detectors/white_camera.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>

#include "calib/error.h"
#include "calib/raytrix_grid.h"
#include "detectors/attenuation.h"
#include "detectors/grid_picture.h"
#include "detectors/image.h"
#include "detectors/white_images.h"
#include "detectors/white_measurement.h"

namespace plenocal {
namespace {

/// More micro lenses than this are never dead or dirty: the field was not even.
constexpr double kMaxUnusable = 0.1;

/// A raw image must be of the size of the white images.
void CheckRawImage(const std::filesystem::path& path, const cv::Mat& white) {
  const cv::Mat raw = ReadImage(path);
  if (raw.size() == white.size()) return;
  throw Error(ErrorKind::kInput,
              fmt::format("{}: is {} x {} pixels, but the white images are {} x {}; record them "
                          "with the same settings of the camera",
                          path.string(),
                          raw.cols,
                          raw.rows,
                          white.cols,
                          white.rows));
}

}  // namespace

namespace internal {

WhiteMeasurement MeasureWhite(const std::vector<FrameImage>& images, const WhiteOptions& options) {
  const WhiteImages white = AverageWhiteImages(images, options.threads);
  if (!options.raw_image.empty()) CheckRawImage(options.raw_image, white.mean);
  WhiteMeasurement measured;
  WhiteCamera& camera = measured.camera;
  camera = {.image_size = {white.mean.cols, white.mean.rows},
            .images = white.used,
            .level = white.level,
            .full_scale = white.full_scale,
            .saturated = white.saturated,
            .black = white.black,
            .unevenness = white.unevenness,
            .left_out = white.left_out};
  const double difference = options.bayer ? 0 : PlaneDifference(white.mean);
  if (difference > 0) {
    camera.warnings.push_back(fmt::format(
        "the white images look like raw colour mosaics (the planes of their 2 x 2 raster "
        "differ by {:.0f} %); if they are, say so with 'bayer'",
        100 * difference));
  }
  if (options.grid_file) {
    const std::string unused = UnusedRayCalibData(*options.grid_file);
    if (!unused.empty()) camera.warnings.push_back(unused);
  }
  if (options.plenoptic) {
    const cv::Mat levelled = measured.levelled =
        options.bayer ? LevelBayerPlanes(white.mean) : white.mean;
    try {
      camera.grid = options.grid_file ? MeasureMicroLensGrid(
                                            levelled,
                                            ReadRayCalibData(*options.grid_file, camera.image_size),
                                            options.threads)
                                      : FindMicroLensGrid(levelled, options.threads);
    } catch (const Error& error) {
      if (camera.warnings.empty()) throw;
      throw Error(error.kind(), fmt::format("{}; {}", error.what(), camera.warnings[0]));
    }
    const auto& lenses = camera.grid->array.lenses;
    const auto unusable = static_cast<size_t>(
        std::count_if(lenses.begin(), lenses.end(), [](const MicroLens& l) { return !l.usable; }));
    if (static_cast<double>(unusable) > kMaxUnusable * static_cast<double>(lenses.size())) {
      throw Error(
          ErrorKind::kJob,
          fmt::format("{} of {} micro images do not look like the others: {}",
                      unusable,
                      lenses.size(),
                      options.grid_file ? "does the grid belong to these images?"
                                        : "the white images show a scene or the array is dirty; "
                                          "record an even white field"));
    }
    measured.attenuation = MicroLensAttenuation(white.mean, *camera.grid, options.bayer);
  } else {
    CheckEvenField(white.mean);
    measured.attenuation = SmoothAttenuation(white.mean, options.bayer);
  }
  cv::minMaxLoc(measured.attenuation, &camera.darkest);
  return measured;
}

}  // namespace internal

WhiteCamera MeasureWhiteImages(const std::vector<FrameImage>& images, const WhiteOptions& options) {
  internal::WhiteMeasurement measured = internal::MeasureWhite(images, options);
  WhiteCamera& camera = measured.camera;
  camera.attenuation_tiff = EncodeImage(".tiff", measured.attenuation);
  if (camera.grid) {
    camera.grid_png = EncodeImage(".png", GridPicture(measured.levelled, camera.grid->array));
  }
  return std::move(camera);
}

}  // namespace plenocal
