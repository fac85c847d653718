// SPDX-License-Identifier: Apache-2.0
//
// Input and output of detection in the images of one camera. No OpenCV type here: the command line
// includes this header without it.
#pragma once

#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "calib/camera/bayer.h"
#include "calib/camera/image_circle.h"
#include "calib/camera/lens_type_optics.h"
#include "calib/camera/micro_lens_array.h"
#include "calib/camera/observation.h"
#include "calib/files/frame_images.h"
#include "calib/io/detection_cache.h"
#include "calib/traits/image_traits.h"

namespace plenocal {

/// One frame for the report: contents of JPEG files.
struct SampleView {
  std::string frame;  ///< its name; empty: there is none
  std::string
      picture;        ///< the image, of a plenoptic camera the focused one, with its markers drawn
  std::string depth;  ///< of a plenoptic camera, virtual depth in colours
};

/// Detections in the images of one camera.
struct ImageDetections {
  std::vector<View> views;  ///< only images with markers, in the order of the images
  ImageSize image_size{};
  std::optional<ImageCircle> image_circle;  ///< of ordinary cameras
  std::vector<LeftOut> left_out;            ///< images and markers, with reasons
  std::vector<std::string> warnings;        ///< of the white images of a plenoptic camera
  size_t reused = 0;         ///< images whose markers were taken over from an earlier run
  std::string micro_lenses;  ///< of a plenoptic camera: the content of micro_lenses_<camera>.csv
  LatticeErrors lattice_errors;       ///< of its centres
  std::string vignetting;             ///< of vignetting_<camera>.tiff; empty without white images
  SampleView sample;                  ///< of the frame with most markers
  std::vector<BlurMeasurement> blur;  ///< of markers in micro images; of ordinary cameras none
  CameraTraits traits;                ///< of all images of that size
};

/// What an image of many shows, in little memory.
struct ImageSketch {
  ImageSize size{};
  std::vector<Observation> points;  ///< not yet corrected by the distortion of all images together
  double blur = 0;                  ///< px, as in `ImageTraits`
  std::string why;                  ///< there are no points; empty when there are
};

/// What was found in one image.
struct ImageReport {
  std::string frame;
  size_t points = 0;
  std::string why;  ///< there are none; empty when there are
};

struct DetectOptions {
  /// White images of the camera: its vignetting is corrected before detection. May be empty.
  std::vector<FrameImage> white_images = {};
  std::optional<BayerOrder> bayer = {};  ///< of raw mosaics, which the white images are then too
  bool tilted_array = false;             ///< the micro lenses may be tilted against the sensor
  int threads = 0;                       ///< 0: all cores
  /// Keeps the results of single images for later runs; null: they are not kept. Its keys must
  /// include what these results depend on and is not here: program and target.
  DetectionCache* cache = nullptr;
  /// Receives pictures for viewing (name and file content), from several threads; empty: none are
  /// made.
  std::function<void(const std::string& name, const std::string& content)> keep = {};
  /// Called for each image when it is done, one call at a time; empty: not called.
  std::function<void(const ImageReport&)> report = {};
  /// Called after each image with the number of images done; false stops (`Stopped` is thrown).
  std::function<bool(size_t done)> progress;
};

}  // namespace plenocal
