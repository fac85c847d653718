// SPDX-License-Identifier: Apache-2.0
//
// The cameras of a session with one camera model after the other, judged by held-out frames.
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "assess/missing/missing_families.h"
#include "assess/stress/stress.h"
#include "assess/text/trial_text.h"
#include "calib/base/run.h"
#include "calib/files/session.h"
#include "engine/session/run_folders.h"
#include "engine/session/session_options.h"

namespace plenocal {

struct TryRequest : SessionOptions {
  std::vector<std::string> models;  ///< empty: all that measure what the cameras measure
  std::string camera;               ///< the camera whose model is varied; empty: all of one type
  int folds = 5;                    ///< of the cross-validation
  bool stress = false;              ///< stress tests of the recommended model
  /// Command of the caller, for `provenance` in the models' calibration.yaml.
  std::string command = "plenocal try";
};

struct SessionTrial {
  Session session;
  MarkerFreedom marker_freedom = {};  ///< that the session gives the target
  ModelChoice models;
  ModelChoice targets;                  ///< with the recommended model
  std::vector<TrialRow> rows;           ///< of `models`
  std::vector<MissingFamily> missing;   ///< of the recommended model with all frames
  std::vector<StressTest> stress;       ///< likewise, where asked for
  std::unique_ptr<RunFolders> folders;  ///< with the result files, to be committed
};

/// Throws `Error`, and `Stopped`.
SessionTrial TrySession(const Session& session, const TryRequest& request, const Run& run);

}  // namespace plenocal
