// SPDX-License-Identifier: Apache-2.0
//
// Two targets of one print, which only their mutual pose distinguishes.
#pragma once

#include <map>
#include <optional>
#include <string>
#include <vector>

#include "calib/start/camera_guess.h"

namespace plenocal {

struct IdenticalBoards {
  size_t first = 0, second = 0;  ///< numbers of the targets
  std::string first_name, second_name;
  std::optional<RigidTransform> T_first_second = {};  ///< known
};

/// Exchanges the markers of both targets in the views so that their mutual pose is one in all of
/// them: the pose that most images with both agree on. Boards of other sizes have it in one order
/// only; of boards of one size the first is the one that is farther left in the first image with
/// both. A target alone in an image is assigned by another camera's image of the frame where the
/// extrinsics of both follow from other frames; else its points are left out. Returns what was left
/// out. `markers`: each in its target's own frame. Throws `Error` of kind kJob when no image shows
/// both.
std::vector<LeftOut> TellApart(const IdenticalBoards& prints,
                               const std::map<int, Eigen::Vector3d>& markers,
                               std::vector<CameraInput>* cameras);

}  // namespace plenocal
