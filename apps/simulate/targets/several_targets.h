// SPDX-License-Identifier: Apache-2.0
//
// The targets of a simulation, which stay where they are with respect to each other.
#pragma once

#include <string>
#include <vector>

#include "apps/simulate/render/observer.h"
#include "apps/simulate/spec/simulation_spec.h"
#include "apps/simulate/targets/target_surface.h"
#include "targets/target.h"

namespace plenocal::simulate {

/// One target of a simulation.
struct TargetInRoom {
  std::string name;             ///< empty: there is no other
  Target target;                ///< as stated
  TrueTarget made;              ///< in its own frame
  RigidTransform T_target_own;  ///< to the first target's frame

  [[nodiscard]] bool IsOnlyOne() const { return name.empty(); }
};

/// The targets of a specification.
std::vector<TargetInRoom> MakeTargets(const SimulationSpec& spec);

/// A target's markers in the frame of the first, with the numbers that sessions give them
/// (`MarkerId`).
TrueTarget InFrameOfFirst(const TargetInRoom& target, size_t index);
/// All of them.
TrueTarget Together(const std::vector<TargetInRoom>& targets);
/// A target of type `markers` with all markers where they are stated, for `Together`; the only
/// target itself.
Target StatedTogether(const std::vector<TargetInRoom>& targets);

/// The boards of all targets in one.
TargetSurface JoinSurfaces(const std::vector<TargetInRoom>& targets, int seed);

/// The key `targets` or `target` of session.yaml.
std::string TargetsOfSession(const std::vector<TargetInRoom>& targets);
/// Name of a target's file.
std::string TargetFile(const TargetInRoom& target);

}  // namespace plenocal::simulate
