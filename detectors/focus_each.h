// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <functional>
#include <string>
#include <vector>

#include "calib/session.h"
#include "detectors/focus.h"

namespace plenocal {

struct FocusEachOptions {
  FocusOptions focus;
  /// Called before each image with the number of images begun; false stops (`Stopped` is thrown).
  std::function<bool(size_t begun)> progress;
  std::function<void(const std::string&)> message;
};

/// Reads and focuses raw images one after another and gives each to `take` with the OpenCV depth of
/// its file. An image for which any of this throws `Error` is left out with a message. Returns how
/// many were taken; when it is none, throws what was wrong with the first.
size_t FocusEach(
    const std::vector<FrameImage>& images,
    const PlenopticCamera& camera,
    const FocusEachOptions& options,
    const std::function<void(const FrameImage& raw, const FocusedView& view, int depth)>& take);

}  // namespace plenocal
