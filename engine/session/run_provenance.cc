// SPDX-License-Identifier: Apache-2.0
#include "engine/session/run_provenance.h"

#include <fmt/format.h>

namespace plenocal {

std::vector<std::pair<std::string, std::string>> ProvenanceOf(const std::string& command,
                                                              const Session& session,
                                                              const std::filesystem::path& out) {
  return {{"plenocal_version", PLENOCAL_VERSION},
          {"command", fmt::format("{} {} -o {}", command, session.path.string(), out.string())},
          {"folder", std::filesystem::current_path().string()},
          {"session", session.path.string()},
          {"target", session.target.file.string()},
          {"session_text", session.text},
          {"target_text", session.target.Text()}};
}

}  // namespace plenocal
