// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>

namespace plenocal::fuzz {

/// A request to the workbench as its server has it after the headers: "METHOD TARGET", lines of
/// headers, an empty line, the body. It is answered as by the server, in a new folder with a
/// session; requests that would start the program are not. Throws `Error` for one that is refused.
void AnswerWorkbenchRequest(const std::filesystem::path& path);

}  // namespace plenocal::fuzz
