// SPDX-License-Identifier: Apache-2.0
//
// The white images of one camera, from files to results in memory. No OpenCV type here: the command
// line includes this header without it.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "calib/camera/bayer.h"
#include "calib/camera/micro_lens_array.h"
#include "calib/camera/observation.h"
#include "calib/files/frame_images.h"
#include "detectors/photometry/photon_transfer.h"
#include "detectors/plenoptic/white/micro_lens_grid.h"

namespace cv {
class Mat;
}

namespace plenocal {

struct WhiteOptions {
  bool plenoptic = false;
  std::optional<BayerOrder> bayer = {};  ///< of raw mosaics
  /// Centres from another source (RayCalibData) for the size of the white images, instead of those
  /// found in them.
  std::optional<std::filesystem::path> grid_file = {};
  /// A raw image of the camera, whose size the white images must have; empty: none.
  std::filesystem::path raw_image = {};
  int threads = 0;  ///< 0: all cores
  /// The sensor's noise too, for which the images are read once more.
  bool measure_noise = false;
};

/// Properties of a camera from its white images.
struct WhiteCamera {
  ImageSize image_size{};
  size_t images = 0;                 ///< used
  double level = 0, full_scale = 0;  ///< mean grey value; that of a saturated pixel
  double saturated = 0, black = 0;   ///< shares of pixels
  double unevenness = 0;             ///< of the illumination, from side to side
  double darkest = 0;                ///< lowest attenuation
  std::vector<LeftOut> left_out = {};
  std::vector<std::string> warnings = {};
  std::optional<MicroLensGrid> grid = {};    ///< of a plenoptic camera
  std::string attenuation_tiff = {};         ///< content of a file with 32 bits per pixel
  std::optional<PhotonTransfer> noise = {};  ///< of two white images and more
  std::string grid_png = {};                 ///< likewise; empty for an ordinary camera
};

/// Averages and measures. Throws `Error` with the file or the reason.
WhiteCamera MeasureWhiteImages(const std::vector<FrameImage>& images, const WhiteOptions& options);

namespace internal {

/// The same without the contents of files. `attenuation`: CV_32F, of the size of the images;
/// `levelled`: CV_32F, the mean white image in which the grid was found, only for a plenoptic
/// camera.
WhiteCamera MeasureWhite(const std::vector<FrameImage>& images,
                         const WhiteOptions& options,
                         cv::Mat* attenuation,
                         cv::Mat* levelled);

}  // namespace internal

}  // namespace plenocal
