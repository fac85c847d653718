// SPDX-License-Identifier: Apache-2.0
//
// Estimated trajectories against their ground truth.
#pragma once

#include <filesystem>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <vector>

#include "apps/evaluate/trajectory_metrics.h"
#include "apps/evaluate/truth_uncertainty.h"
#include "calib/base/run.h"

namespace plenocal {

/// Estimated trajectories and their ground truth.
struct EvaluateRequest {
  std::vector<std::string> estimates;  ///< files, or NAME=FILE
  std::filesystem::path truth;         ///< both segments, the whole path, or groundtruth.yaml
  std::string camera;                  ///< of groundtruth.yaml; empty: its first
  std::filesystem::path start, end;    ///< or one file per segment
  std::filesystem::path times;         ///< times of KITTI poses; empty: none
  double tolerance = 0.01;             ///< s between an estimated pose and its ground truth
  int delta = 1;                       ///< poses between the two ends of a relative error
  std::vector<std::string> monocular;  ///< runs without scale; see `monocular_runs`
  enum class MonocularRuns { kNone, kListed, kAll } monocular_runs = MonocularRuns::kNone;
};

/// One run of an algorithm: what was measured, or why nothing could be.
struct EvaluatedRun {
  std::string name;
  std::filesystem::path path;
  bool monocular = false;
  std::optional<LoopMetrics> loop;
  std::optional<LoopMetricErrors> loop_errors;
  std::optional<PathErrors> errors;
  std::string failure;
};

struct Evaluation {
  std::vector<EvaluatedRun> runs;
  bool has_loop = false;  ///< start and end of a loop are known, not its whole path
  double tolerance = 0;   ///< s, as requested
  int delta = 0;          ///< poses, likewise
};

/// Measures all runs. Beside others a failed run is a result. Throws `Error`: of kind kJob when all
/// runs fail; and `Stopped`.
Evaluation EvaluateRuns(const EvaluateRequest& request, const Run& listener);

/// The tables for the terminal.
std::string EvaluationText(const Evaluation& evaluation);
/// The metrics of one run, or {runs: {name: metrics}} of several.
nlohmann::ordered_json EvaluationJson(const Evaluation& evaluation);

}  // namespace plenocal
