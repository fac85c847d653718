// SPDX-License-Identifier: Apache-2.0
//
// The part of calibration.yaml about the run that made it.
#pragma once

#include <filesystem>
#include <string>
#include <utility>
#include <vector>

#include "calib/files/session.h"

namespace plenocal {

/// Keys and values of the run `<command> <session> -o <out>`, with the texts of session and target
/// as they are now.
std::vector<std::pair<std::string, std::string>> ProvenanceOf(const std::string& command,
                                                              const Session& session,
                                                              const std::filesystem::path& out);

}  // namespace plenocal
