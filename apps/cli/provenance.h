// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <utility>
#include <vector>

#include "apps/cli/console.h"
#include "calib/files/session.h"

namespace plenocal {

/// The part of calibration.yaml about the run `plenocal <command> <session> -o <out>` that made it:
/// keys and values, with the texts of session and target as they are now.
std::vector<std::pair<std::string, std::string>> ProvenanceOf(const ConsoleOptions& options,
                                                              const std::string& command,
                                                              const Session& session,
                                                              const std::filesystem::path& out);

}  // namespace plenocal
