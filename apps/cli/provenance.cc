// SPDX-License-Identifier: Apache-2.0
#include "apps/cli/provenance.h"

#include <fmt/format.h>

#include <fstream>
#include <iterator>

namespace plenocal {
namespace {

std::string FileText(const std::filesystem::path& path) {
  std::ifstream file(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(file), std::istreambuf_iterator<char>()};
}

}  // namespace

std::vector<std::pair<std::string, std::string>> ProvenanceOf(const ConsoleOptions& options,
                                                              const std::string& command,
                                                              const Session& session,
                                                              const std::filesystem::path& out) {
  return {{"plenocal_version", PLENOCAL_VERSION},
          {"command",
           fmt::format(
               "{} {} {} -o {}", options.program, command, session.path.string(), out.string())},
          {"folder", std::filesystem::current_path().string()},
          {"session", session.path.string()},
          {"target", session.target.string()},
          {"session_text", FileText(session.path)},
          {"target_text", FileText(session.target)}};
}

}  // namespace plenocal
