// SPDX-License-Identifier: Apache-2.0
//
// The text of `plenocal --version`.
#pragma once

#include <string>

namespace plenocal {

/// The text of `plenocal --version`: version and git commit of the program, then the versions of
/// the libraries that it was built with. The commit is "unknown" when the sources were no git
/// repository, and ends in "+" when they had changes.
std::string VersionText();

}  // namespace plenocal
