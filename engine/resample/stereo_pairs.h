// SPDX-License-Identifier: Apache-2.0
//
// Images of two cameras in pairs, and pictures of a pair.
#pragma once

#include <array>
#include <string>
#include <vector>

#include "calib/camera/observation.h"
#include "calib/files/frame_images.h"

namespace plenocal {

/// Images of both cameras of a pair.
using StereoImages = std::array<std::vector<FrameImage>, 2>;

struct StereoPairs {
  StereoImages images;            ///< equal numbers, the n-th of both belong together
  std::vector<LeftOut> left_out;  ///< images without counterpart
  bool by_number = false;         ///< paired by the numbers in their names; these are the frames
};

/// Pairs images by their frames; where no frames are equal, by the last number in them ("left01"
/// and "right01"). One image each is a pair whatever the names are. Throws `Error` of kind kInput
/// when there is no pair, or when one file would be both images of a pair.
StereoPairs PairImages(StereoImages images);

/// PNG of a rectified pair side by side with horizontal lines, on which corresponding points lie:
/// 8 bits, in colour. `first`, `second`: encoded images of one size.
std::string DrawPair(const std::string& first, const std::string& second);

}  // namespace plenocal
