// SPDX-License-Identifier: Apache-2.0
//
// Raw images of a camera with micro lenses, resampled into images of a pinhole camera with depth in
// metres.
#pragma once

#include <filesystem>
#include <functional>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "calib/camera/bayer.h"
#include "calib/files/frame_images.h"
#include "engine/resample/pixel_map.h"
#include "engine/resample/virtual_image.h"

namespace plenocal {

/// Raw images of one camera and the view to make of them.
struct VirtualViewRequest {
  std::vector<FrameImage> images;
  const VirtualImage* virtual_image = nullptr;
  double scale = 2;                  ///< raw px per pixel of the virtual image
  const PixelMap* map = nullptr;     ///< from the view to the virtual image
  ImageSize raw_size{};              ///< of the raw images, px
  std::filesystem::path grid;        ///< micro_lenses_<camera>.csv
  std::filesystem::path vignetting;  ///< attenuation TIFF; empty: the images are corrected already
  std::optional<BayerOrder> bayer;   ///< of raw mosaics
  std::string interpolation;         ///< one of kInterpolations
  bool cloud = false;                ///< make a point cloud
  int threads = 0;                   ///< 0: all cores
  std::function<void(const std::string&)> message;
  /// Called before each image with the number of images done; false stops (`Stopped` is thrown).
  std::function<bool(size_t done)> progress;
  /// Takes a frame's files, suffix of the name -> content: ".png" (depth of the raw image),
  /// "_depth.tiff" and "_depth_sigma.tiff" (z in the view's frame and its standard deviation, m,
  /// 32-bit floats, NaN where unknown) and, for `cloud`, ".ply"; with one line about them.
  std::function<void(const std::string& frame,
                     const std::map<std::string, std::string>& files,
                     const std::string& summary)>
      result;
};

/// Focuses the images one after another, each on all threads. One that cannot be read or focused is
/// left out with a message; throws `Error` for errors in the camera's files and when no image is
/// left. Returns the number of images made.
size_t MakeVirtualViews(const VirtualViewRequest& request);

}  // namespace plenocal
