// SPDX-License-Identifier: Apache-2.0
//
// Session and target files, to be completed, from images without them.
#pragma once

#include <filesystem>
#include <set>
#include <string>
#include <vector>

#include "calib/base/run.h"
#include "detectors/boards/propose_target.h"
#include "engine/recording/find_cameras.h"

namespace plenocal {

struct InitRequest {
  std::filesystem::path place;                     ///< folder, recording, video or archive
  std::filesystem::path session = "session.yaml";  ///< to write; the target's file beside it
};

/// A camera as it will stand in the session.
struct InitCamera : FoundCamera {
  bool recorded = false;  ///< in a recording, whose frames are paired by time
  bool plenoptic = false;
  std::set<std::string> frames;
};

struct FoundSession {
  std::vector<InitCamera> cameras;
  TargetProposals proposals = {};
  std::filesystem::path target = {};  ///< the target's file
};

/// Finds cameras, white images and target and writes the two files. Throws `Error`: of kind kInput
/// where one of them exists; and `Stopped`.
FoundSession InitSession(const InitRequest& request, const Run& run);

}  // namespace plenocal
