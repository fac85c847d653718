// SPDX-License-Identifier: Apache-2.0
//
// The plan of `plenocal fleet`: rigs, their sessions, and the files made of them.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

namespace plenocal {

/// One calibration of a rig.
struct FleetRun {
  std::string date;  ///< what the last * of the rig's `sessions` stands for
  std::filesystem::path session;
};

struct FleetRig {
  std::string name;
  std::vector<FleetRun> runs;  ///< by date
};

/// Sessions of many rigs at many dates (docs/fleet.md).
struct FleetPlan {
  std::filesystem::path path;
  std::vector<FleetRig> rigs;
  int shards = 1;                   ///< jobs of detection a session
  std::vector<std::string> models;  ///< that `try` compares; empty: no trial
};

/// Reads plan.yaml. Throws `Error` with file, line and key.
FleetPlan ReadFleetPlan(const std::filesystem::path& path);

/// The Snakefile that makes all calibrations of a plan, their comparisons and the overview, with
/// `program` as command; it lies in the folder of the results.
std::string Snakefile(const FleetPlan& plan, const std::filesystem::path& program);

/// The page on all calibrations that are in `results`: verdicts, drift, what to recalibrate.
std::string FleetPage(const FleetPlan& plan, const std::filesystem::path& results);

}  // namespace plenocal
