// SPDX-License-Identifier: Apache-2.0
//
// The folder for the results of a run, and the cache of its detections.
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "calib/files/session.h"
#include "calib/io/detection_cache.h"
#include "calib/io/output_folder.h"
#include "engine/session/session_options.h"

namespace plenocal {

/// Without `Commit` no result stays.
class RunFolders {
 public:
  /// Without `SessionOptions::out` there is no folder. Throws `Error` where results named so
  /// would replace inputs.
  RunFolders(const SessionOptions& options,
             const Session& session,
             const std::vector<std::string>& results);

  /// Puts the files into the folder. Throws `Error` of kind kJob.
  void Commit();

  /// Null: none is wanted.
  [[nodiscard]] OutputFolder* out() const { return out_.get(); }
  DetectionCache* cache() { return &cache_; }

 private:
  std::unique_ptr<OutputFolder> out_;
  DetectionCache cache_;
  bool owns_cache_;  // no other run uses it: what is not used leaves it
};

}  // namespace plenocal
