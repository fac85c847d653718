// SPDX-License-Identifier: Apache-2.0
//
// Poses of a rig before a target.
#pragma once

#include <string>
#include <vector>

#include "apps/simulate/render/observer.h"
#include "apps/simulate/spec/simulation_spec.h"

namespace plenocal::simulate {

/// One instant of a simulated session.
struct Frame {
  std::string name;
  std::string kind;  ///< "good"; "partial": the target is at the rim of an image; "given"
  RigidTransform T_rig_target;
  double time = 0;  ///< s, of a rig that moves
  /// Per camera, of a rig that moves: where the rig is when the camera takes its image.
  std::vector<RigidTransform> T_rig_target_of_camera = {};

  [[nodiscard]] const RigidTransform& PoseFor(std::size_t camera) const {
    return T_rig_target_of_camera.empty() ? T_rig_target : T_rig_target_of_camera[camera];
  }
};

/// The rig's poses before the target, all from the seed; of several targets (in the frame of the
/// first) each has its turn. Throws `Error` of kind kJob when no pose of the specified kind shows
/// the target.
std::vector<Frame> MakePoses(const SimulationSpec& spec,
                             const Observer& observer,
                             const std::vector<TrueTarget>& targets);

}  // namespace plenocal::simulate
