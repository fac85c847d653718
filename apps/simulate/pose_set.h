// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <vector>

#include "apps/simulate/observer.h"
#include "apps/simulate/simulation_spec.h"

namespace plenocal::simulate {

/// One instant of a simulated session.
struct Frame {
  std::string name;
  std::string kind;  ///< "good"; "partial": the target is at the rim of an image; "given"
  RigidTransform T_rig_target;
};

/// The rig's poses before the target, all from the seed; of several targets (in the frame of the
/// first) each has its turn. Throws `Error` of kind kJob when no pose of the specified kind shows
/// the target.
std::vector<Frame> MakePoses(const SimulationSpec& spec,
                             const Observer& observer,
                             const std::vector<TrueTarget>& targets);

}  // namespace plenocal::simulate
