// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>

#include "apps/commands.h"
#include "apps/image_module.h"
#include "models/registry.h"

namespace plenocal {

void RunSimulate(const SimulateCommand& command, const ConsoleOptions& options) {
  Console console(options.quiet);
  const std::string summary =
      SimulateByModule(command,
                       {.models = CameraModels(),
                        .program = options.program,
                        .threads = options.threads,
                        .progress = [&](const std::string& stage, size_t done, size_t total) {
                          console.Progress(stage, done, total);
                          return !Interrupted();
                        }});
  fmt::print("{}written to {}\n", summary, command.out.string());
}

}  // namespace plenocal
