// SPDX-License-Identifier: Apache-2.0
#include "detectors/plenoptic/plenoptic_source.h"

#include <fmt/format.h>

#include <string>
#include <utility>

#include "calib/base/error.h"
#include "calib/base/names.h"
#include "calib/files/raytrix_grid.h"
#include "detectors/images/image.h"
#include "detectors/plenoptic/depth/reconstruction.h"
#include "detectors/plenoptic/white/micro_lens_grid.h"
#include "detectors/plenoptic/white/white_camera.h"

namespace plenocal {
namespace {

using Message = std::function<void(const std::string&)>;

PlenopticCamera CameraFromWhiteImages(const PlenopticSource& source,
                                      int threads,
                                      const Message& message) {
  WhiteOptions options{.plenoptic = true,
                       .bayer = source.bayer,
                       .grid_file = std::nullopt,
                       .raw_image = {},
                       .threads = threads};
  if (!source.grid.empty()) options.grid_file = source.grid;
  cv::Mat attenuation, levelled;
  WhiteCamera white = internal::MeasureWhite(source.white_images, options, &attenuation, &levelled);
  for (const std::string& warning : white.warnings) message("  " + warning);
  for (const LeftOut& item : white.left_out) {
    message(fmt::format("  left out {}: {}", item.where, item.reason));
  }
  return {std::move(white.grid->array), attenuation, source.bayer};
}

PlenopticCamera CameraFromFiles(const PlenopticSource& source,
                                const FrameImage& raw_image,
                                const Message& message) {
  PlenopticCamera camera;
  camera.bayer = source.bayer;
  camera.attenuation = source.vignetting.empty()
                           ? cv::Mat(ReadImage(raw_image).size(), CV_32F, cv::Scalar(1))
                           : ReadAttenuation(source.vignetting);
  const ImageSize size{camera.attenuation.cols, camera.attenuation.rows};
  if (source.vignetting.empty()) {
    message("  without white images or a vignetting file the grid is used unchecked");
  }
  if (LowerCase(source.grid.extension().string()) == ".xml") {
    camera.array = ReadRayCalibData(source.grid, size);
    const std::string unused = UnusedRayCalibData(source.grid);
    if (!unused.empty()) message("  " + unused);
  } else {
    camera.array = ReadMicroLenses(source.grid, size);
  }
  const std::string misplaced = MisplacedCells(camera.attenuation, camera.array);
  if (!misplaced.empty()) {
    throw InputError("{}: the grid does not fit the attenuation in {}: {}",
                     source.grid.string(),
                     source.vignetting.string(),
                     misplaced);
  }
  return camera;
}

}  // namespace

PlenopticCamera LoadPlenopticCamera(const PlenopticSource& source,
                                    const FrameImage& raw_image,
                                    int threads,
                                    const Message& message) {
  return source.white_images.empty() ? CameraFromFiles(source, raw_image, message)
                                     : CameraFromWhiteImages(source, threads, message);
}

}  // namespace plenocal
