// SPDX-License-Identifier: Apache-2.0
//
// Scripts for completion in bash and zsh.
#pragma once

#include <string>

namespace CLI {
class App;
}

namespace plenocal {

/// Scripts that complete the commands, options and fixed values of `app` in a shell, and file
/// names elsewhere.
std::string BashCompletion(const CLI::App& app);
std::string ZshCompletion(const CLI::App& app);

}  // namespace plenocal
