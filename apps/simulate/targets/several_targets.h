// SPDX-License-Identifier: Apache-2.0
//
// Several targets of a simulation that stay where they are with respect to each other.
#pragma once

#include <string>
#include <vector>

#include "apps/simulate/observer.h"
#include "apps/simulate/simulation_spec.h"
#include "apps/simulate/targets/target_surface.h"
#include "targets/target.h"

namespace plenocal::simulate {

/// One target of several.
struct TargetInRoom {
  std::string name;
  Target target;                ///< as stated
  TrueTarget made;              ///< in its own frame
  RigidTransform T_target_own;  ///< to the first target's frame
};

/// The targets of a specification with several; empty for one with one.
std::vector<TargetInRoom> MakeTargets(const SimulationSpec& spec, TagErrors tag_errors);

/// A target's markers in the frame of the first, with the numbers that sessions give them
/// (`kMarkersPerTarget`).
TrueTarget InFrameOfFirst(const TargetInRoom& target, size_t index);
/// All of them.
TrueTarget Together(const std::vector<TargetInRoom>& targets);
/// A target of type `markers` with all markers where they are stated, for `Together`.
Target StatedTogether(const std::vector<TargetInRoom>& targets);

/// The boards of all targets in one.
TargetSurface SurfaceOf(const std::vector<TargetInRoom>& targets, int seed);

/// The key `targets` of session.yaml.
std::string TargetsOfSession(const std::vector<TargetInRoom>& targets);
/// Name of a target's file.
std::string TargetFile(const TargetInRoom& target);

}  // namespace plenocal::simulate
