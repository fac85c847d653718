// SPDX-License-Identifier: Apache-2.0
//
// Errors with a formatted message.
#pragma once

#include <fmt/format.h>

#include <utility>

#include "calib/base/error.h"

namespace plenocal {

/// `Error` of kind kInput.
template <typename... Args>
Error InputError(fmt::format_string<Args...> message, Args&&... args) {
  return {ErrorKind::kInput, fmt::format(message, std::forward<Args>(args)...)};
}

/// `Error` of kind kJob.
template <typename... Args>
Error JobError(fmt::format_string<Args...> message, Args&&... args) {
  return {ErrorKind::kJob, fmt::format(message, std::forward<Args>(args)...)};
}

}  // namespace plenocal
