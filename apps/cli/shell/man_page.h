// SPDX-License-Identifier: Apache-2.0
//
// Man pages of the program and its commands.
#pragma once

#include <map>
#include <string>

namespace CLI {
class App;
}

namespace plenocal {

/// Pages for man(1) with the text of `--help`, by file name: plenocal.1 of `app` and
/// plenocal-<command>.1 of each of its commands.
std::map<std::string, std::string> ManPages(const CLI::App& app);

}  // namespace plenocal
