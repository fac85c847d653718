// SPDX-License-Identifier: Apache-2.0
//
// Runs `plenocal workbench`: server, page and folder together.
#pragma once

#include <filesystem>
#include <functional>
#include <string>

namespace plenocal::workbench {

struct WorkbenchOptions {
  std::filesystem::path place;  ///< folder, session file or result
  unsigned short port = 0;      ///< 0: a free one
};

/// Serves until `go_on` returns false. `on_open` receives the page's address, with the token after
/// '#': browsers do not send that part. Throws `Error`.
void RunWorkbench(const WorkbenchOptions& options,
                  const std::function<void(const std::string& address)>& on_open,
                  const std::function<bool()>& go_on);

}  // namespace plenocal::workbench
