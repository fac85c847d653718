// SPDX-License-Identifier: Apache-2.0
//
// Tracks of scene points from the images of a rig: its ordinary cameras together, each plenoptic
// camera by itself.
#pragma once

#include <cstddef>
#include <functional>
#include <map>
#include <opencv2/core.hpp>
#include <string>
#include <utility>
#include <vector>

#include "engine/scene/track/feature_tracker.h"
#include "engine/scene/track/plenoptic_tracker.h"

namespace plenocal {

/// Images of a rig.
struct RigImages {
  const std::vector<BundleCamera>* cameras = nullptr;
  std::map<size_t, PlenopticCamera> optics;  ///< of the plenoptic ones, by index
  std::vector<std::string> frames;           ///< names
  /// The image of a camera in a frame: of an ordinary one grey with 8 bits, of a plenoptic one as
  /// in its file; empty where there is none. May throw `Error` for one that cannot be read.
  std::function<cv::Mat(size_t camera, size_t frame)> read;
  int threads = 0;  ///< 0: all cores
};

struct FollowedPoints {
  std::vector<std::vector<View>> views;  ///< per camera
  cv::Mat descriptors;                   ///< row i is of track number `first_number` + i
  std::vector<int> group;                ///< of each row: tracks of equal groups look alike
  /// A track and the one of the first group that looks like the same point, to about a pixel.
  std::vector<std::pair<int, int>> alike;
  std::vector<LeftOut> left_out;  ///< images that cannot be used
};

/// Follows points through `frames` (indices), in their order. `done` is called before each image
/// of a group with the number of images done and of all; it may throw.
FollowedPoints FollowPoints(const RigImages& images,
                            const std::vector<size_t>& frames,
                            const FeatureOptions& options,
                            int first_number,
                            const std::function<void(size_t done, size_t total)>& done);

}  // namespace plenocal
