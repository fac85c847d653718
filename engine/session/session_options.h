// SPDX-License-Identifier: Apache-2.0
//
// Options of the runs that detect the target in a session's images.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

namespace plenocal {

struct Session;

struct SessionOptions {
  std::filesystem::path out;         ///< folder for the results; empty: none is written
  bool keep = false;                 ///< write pictures of the stages into `out`/images
  std::vector<std::string> exclude;  ///< rules beside the session's, in YAML
  std::filesystem::path cache;       ///< folder of the detections kept for later runs; empty: `out`
  int frames = 0;                    ///< most frames to use; 0: the session's number
  bool all = false;                  ///< use all frames
  bool fresh = false;                ///< detect again: ignore detections of earlier runs
};

/// Sets the number of frames in the session as `frames` and `all` have it, and adds the rules of
/// `exclude`. Throws `Error` that begins with the rule.
void UseOptions(const SessionOptions& options, Session* session);

}  // namespace plenocal
