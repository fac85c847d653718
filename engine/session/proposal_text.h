// SPDX-License-Identifier: Apache-2.0
//
// Advice when the target is not known, or is not the one in the images.
#pragma once

#include <string>
#include <vector>

#include "calib/base/run.h"
#include "calib/files/frame_images.h"
#include "detectors/boards/propose_target.h"
#include "targets/target.h"

namespace plenocal {

/// Looks at the images of an ordinary camera. Prints progress. Throws `Stopped` after Ctrl-C.
TargetProposals LookForTargets(const std::vector<FrameImage>& images, const Run& run);

/// "13 of 14 images", "all 13 images".
std::string OfImages(size_t count, size_t all);

/// Looks at the cameras' images and throws `Error` of kind kInput with the target that they show.
[[noreturn]] void FailWithProposal(const std::vector<std::string>& cameras,
                                   const std::vector<std::vector<std::string>>& images,
                                   const Run& run);

/// How `target` must be changed to be the one that the images show: "all 13 images show 9 x 6 inner
/// corners: set columns: 9, rows: 6"; empty when they show none.
std::string MendOf(const TargetProposals& proposals, const Target& target);

}  // namespace plenocal
