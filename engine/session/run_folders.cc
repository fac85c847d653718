// SPDX-License-Identifier: Apache-2.0
#include "engine/session/run_folders.h"

#include <dlfcn.h>
#include <fmt/format.h>

#include <algorithm>
#include <string_view>

#include "calib/files/session.h"

namespace plenocal {
namespace {

// The program, or the library or module that this code is in.
std::filesystem::path OwnFile() {
  Dl_info info{};
  const bool is_found = dladdr(reinterpret_cast<const void*>(&OpenDetectionCache), &info) != 0;
  // The name of a program is its first argument, which may be relative.
  const bool is_library =
      is_found && std::string_view(info.dli_fname).find(".so") != std::string_view::npos;
  return is_library ? info.dli_fname : "/proc/self/exe";
}

}  // namespace

DetectionCache OpenDetectionCache(const std::filesystem::path& out,
                                  const Session& session,
                                  EarlierDetections earlier) {
  // Given detections are not cached, and hashing the program takes as long as solving a small
  // session.
  const bool detects = !out.empty() && std::ranges::any_of(session.cameras, HasImages);
  const std::string program =
      detects
          ? fmt::format(
                "plenocal {} {} {}", PLENOCAL_VERSION, HashFile(OwnFile()), session.target.Text())
          : std::string();
  return {out.empty() ? out : out / ".cache", program, earlier == EarlierDetections::kIgnore};
}

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
