// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <functional>
#include <string>
#include <vector>

#include "calib/observation.h"
#include "calib/session.h"
#include "calib/stage_store.h"
#include "targets/target.h"

namespace plenocal {

/// A frame as a person sees it: contents of JPEG files.
struct SampleView {
  std::string frame;  ///< its name; empty: there is none
  std::string
      picture;        ///< the image, of a plenoptic camera the focused one, with its markers drawn
  std::string depth;  ///< of a plenoptic camera, virtual depth in colours
};

/// What the images of one camera gave.
struct ImageDetections {
  std::vector<View> views;  ///< only images with markers, in the order of the images
  ImageSize image_size{};
  std::vector<LeftOut> left_out;  ///< images and markers, with reasons
  size_t reused = 0;              ///< images whose markers were taken over from an earlier run
  std::string micro_lenses;  ///< of a plenoptic camera: the content of micro_lenses_<camera>.csv
  std::string vignetting;    ///< of vignetting_<camera>.tiff; empty without white images
  SampleView sample;         ///< of the frame with most markers
};

struct DetectOptions {
  bool plenoptic = false;  ///< raw images of a camera with micro lenses
  /// White images of the camera: its vignetting is corrected before detection. May be empty.
  std::vector<FrameImage> white_images = {};
  std::string bayer = {};  ///< "RGGB" and the like: raw mosaics, white images too; else empty
  int threads = 0;         ///< 0: all cores
  /// Where results of single images are kept and found again; null: nowhere. What decides them but
  /// is not here (program and target) belongs to the store.
  StageStore* store = nullptr;
  /// Takes pictures for a person's eye (name and file content), from several threads; empty: none
  /// are made.
  std::function<void(const std::string& name, const std::string& content)> keep = {};
  /// Called after each image with the number of images done; false stops (`Stopped` is thrown).
  std::function<bool(size_t done)> progress;
};

/// Finds the target in all images of one camera, several images at a time. An image that cannot be
/// read, or whose size differs from that of most, is left out with its reason. Throws `Error` of
/// kind kJob when no image can be read, and as `AverageWhiteImages` does for the white images, or
/// of kind kInput when these are of another size.
ImageDetections DetectImages(const std::vector<FrameImage>& images,
                             const Target& target,
                             const DetectOptions& options);

namespace internal {

/// Tells the white images of a camera, and how they are to be read, from others.
std::string WhiteKey(const DetectOptions& options);

}  // namespace internal

}  // namespace plenocal
