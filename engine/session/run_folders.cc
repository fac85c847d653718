// SPDX-License-Identifier: Apache-2.0
#include "engine/session/run_folders.h"

#include "engine/observe/session_observations.h"

namespace plenocal {

RunFolders::RunFolders(const SessionOptions& options,
                       const Session& session,
                       const std::vector<std::string>& results)
    : out_(OpenOutput(options.out)),
      cache_(OpenDetectionCache(
          options.cache.empty() ? options.out : options.cache,
          session,
          options.fresh ? EarlierDetections::kIgnore : EarlierDetections::kReuse)),
      owns_cache_(options.cache.empty()) {
  if (out_) out_->RefuseInputs(results);
}

void RunFolders::Commit() {
  if (!out_) return;
  out_->Commit();
  if (owns_cache_) cache_.RemoveUnused();
}

}  // namespace plenocal
