// SPDX-License-Identifier: Apache-2.0
//
// Limits of the numbers that a calling program gives.
#pragma once

#include "calib/base/format_error.h"

namespace plenocal {

/// Throws `Error` of kind kInput for a number outside of [lowest, highest], and for NaN.
inline void RequireWithin(const char* name, double value, double lowest, double highest) {
  if (value >= lowest && value <= highest) return;
  throw InputError("{}: expected a number from {} to {}, found {}", name, lowest, highest, value);
}

}  // namespace plenocal
