// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>

#include "apps/commands.h"
#include "apps/image_module.h"

namespace plenocal {

void RunTarget(const PrintCommand& command) {
  for (const std::filesystem::path& file : PrintTargetByModule(command)) {
    fmt::print("written to {}\n", file.string());
  }
}

}  // namespace plenocal
