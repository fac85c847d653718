// SPDX-License-Identifier: Apache-2.0
//
// Raw plenoptic images from files to the content of result files. No OpenCV type here: the command
// line includes this header without it.
#pragma once

#include <functional>
#include <map>
#include <string>
#include <vector>

#include "calib/files/frame_images.h"
#include "detectors/plenoptic/plenoptic_source.h"
#include "targets/target.h"

namespace plenocal {

struct Reconstruction;         // detectors/plenoptic/depth/reconstruction.h
struct ReconstructionOptions;  // likewise

/// The result files of one frame: name -> content.
using FrameFiles = std::map<std::string, std::string>;

struct FocusRequest {
  std::vector<FrameImage> raw_images;
  PlenopticSource camera;
  double scale = 2;                ///< raw px a pixel of the results
  const Target* target = nullptr;  ///< when set, the depth of its markers is flattened
  int threads = 0;                 ///< 0: all cores
  std::function<void(const std::string&)> message;
  /// Called before each image with the number of images done; false stops (`Stopped` is thrown).
  std::function<bool(size_t done)> progress;
  /// Takes the results of a frame, with one line about them.
  std::function<void(const std::string& frame, const FrameFiles& files, const std::string& summary)>
      result;
};

/// Focuses the images one after another, each on all threads. An image that cannot be focused is
/// left out with a message; throws `Error` for what is wrong with the camera's files and when no
/// image is left.
void FocusImages(const FocusRequest& request);

/// How a loop over raw images reports what it does.
struct LoopReports {
  /// Called before each image with the number of images begun; false stops (`Stopped` is thrown).
  std::function<bool(size_t begun)> progress;
  std::function<void(const std::string&)> message;
};

/// Reads and reconstructs raw images one after another and passes each to `take` with the OpenCV
/// depth of its file. An image for which any of this throws `Error` is left out with a message.
/// Returns the number of images taken; throws the first image's `Error` when none was.
size_t ReconstructImages(
    const std::vector<FrameImage>& images,
    const PlenopticCamera& camera,
    const ReconstructionOptions& options,
    const LoopReports& reports,
    const std::function<void(const FrameImage& raw, const Reconstruction& view, int depth)>& take);

}  // namespace plenocal
