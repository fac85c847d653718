// SPDX-License-Identifier: Apache-2.0
//
// Runs of the program itself: every job of the workbench is a command line.
#pragma once

#include <sys/types.h>

#include <functional>
#include <string>
#include <vector>

namespace plenocal::workbench {

struct ChildResult {
  int status = -1;  ///< as a shell gives it: 128 + number when a signal ended the program
  std::string out, err;
};

/// Runs `plenocal <arguments>` in a folder, without a shell, and returns when it has ended.
/// `on_start` receives its process id; `on_event` each line of its `--events`, where the arguments
/// have `kEventsFile` for that. Throws `Error` of kind kJob when it cannot be started.
ChildResult RunChild(const std::vector<std::string>& arguments,
                     const std::string& folder,
                     const std::function<void(pid_t)>& on_start = {},
                     const std::function<void(const std::string&)>& on_event = {});

/// Why a child failed, in one line and never empty: the last message of the program, without its
/// name; else how the child ended. REQUIRES: its status is not 0.
std::string FailureOf(const ChildResult& child);

/// Number of the file that takes a child's events.
inline constexpr int kEventsFile = 3;

/// A command line that a shell takes as these arguments.
std::string CommandLineText(const std::vector<std::string>& arguments);

}  // namespace plenocal::workbench
