// SPDX-License-Identifier: Apache-2.0
//
// Which target do these images show? No OpenCV type here: the command line includes this header
// without it.
#pragma once

#include <cstddef>
#include <functional>
#include <string>
#include <vector>

#include "calib/files/frame_images.h"

namespace plenocal {

/// A key of target.yaml whose value must be measured on the target.
struct MeasuredKey {
  std::string name;  ///< "square"
  std::string what;  ///< "side of a square, such as 25 mm"
};

/// A target as far as images show it: all but its size.
struct TargetProposal {
  std::string what;   ///< "chessboard with 9 x 6 inner corners"
  std::string shows;  ///< the same of a target whose type is known: "9 x 6 inner corners"
  /// The target in one word (`TargetOfWord`) with names in capitals for what must be measured:
  /// "chessboard:9x6:SIZE"; empty: no target type describes it.
  std::string word = {};
  std::string keys = {};                  ///< lines of target.yaml, without those in `measure`
  std::vector<MeasuredKey> measure = {};  ///< keys whose values images cannot show: "square"
  size_t images = 0;                      ///< that show it
};

/// What a set of images shows.
struct TargetProposals {
  std::vector<TargetProposal> found;  ///< that of most images first
  size_t looked_at = 0;               ///< of many images only some are looked at
};

struct ProposeOptions {
  int threads = 0;  ///< 0: all cores
  /// Called after each image with how many of how many are done; false stops (`Stopped` is thrown).
  std::function<bool(size_t done, size_t all)> progress = {};
};

/// Looks for chessboards, AprilTags, ArUco markers and ChArUco boards, and grids of circles of any
/// size in the images of an ordinary camera. Images that cannot be read show nothing.
TargetProposals ProposeTargets(const std::vector<FrameImage>& images,
                               const ProposeOptions& options);

}  // namespace plenocal
