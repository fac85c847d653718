// SPDX-License-Identifier: Apache-2.0
//
// Images resampled into those of another camera.
#pragma once

#include <array>
#include <filesystem>
#include <functional>
#include <map>
#include <opencv2/core/mat.hpp>
#include <optional>
#include <string>
#include <vector>

#include "calib/camera/bayer.h"
#include "calib/files/frame_images.h"
#include "detectors/photometry/response_curve.h"
#include "engine/resample/pixel_map.h"

namespace plenocal {

/// Names of the ways to interpolate.
inline constexpr std::array kInterpolations{"linear", "nearest", "cubic", "lanczos"};

/// Images of one camera and the map to resample them with.
struct ResampleRequest {
  std::vector<FrameImage> images;
  const PixelMap* map = nullptr;
  std::filesystem::path vignetting;  ///< attenuation TIFF; empty: none is removed
  /// Grey values become light by it, for images of 8 bits, and results have 16 bits: 65535 is light
  /// 255. Nothing: they stay.
  std::optional<ResponseCurve> response = {};
  std::optional<BayerOrder> bayer;  ///< of raw mosaics
  std::string interpolation;        ///< one of kInterpolations
  int threads = 0;                  ///< 0: all cores
  std::function<void(const std::string&)> message;
  /// Called, from several threads, after each image; false stops (`Stopped` is thrown).
  std::function<bool(size_t done)> progress;
  /// Takes a frame's image, PNG of the original's depth and channels, black where the map has no
  /// source; from several threads.
  std::function<void(const std::string& frame, const std::string& png)> result;
};

/// Resamples all images. One that cannot be read or has another size is left out with a message;
/// throws `Error` when none is left. Returns the number of resampled images.
size_t ResampleImages(const ResampleRequest& request);

/// Files for cv::remap: with an empty `format` map_x.tiff and map_y.tiff, 32-bit floats, and
/// mask.png, 255 where there is a source; with "yml" or "xml" one FileStorage under the empty name
/// that holds map_x, map_y, camera_matrix of the view and the sizes.
std::map<std::string, std::string> MapFiles(const PixelMap& map,
                                            const std::vector<double>& pinhole,
                                            const std::string& format);

/// An attenuation (CV_32F) as PNG of 16 bits whose largest value is 65535, as DSO reads it.
std::string VignettePng(const cv::Mat& attenuation);
/// The same of a TIFF.
std::string VignettePng(const std::filesystem::path& attenuation);

}  // namespace plenocal
