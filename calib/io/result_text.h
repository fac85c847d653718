// SPDX-License-Identifier: Apache-2.0
//
// Check of the text of a result file before it is written.
#pragma once

#include <string_view>

namespace plenocal {

/// Throws `Error` of kind kJob for the text of a result file that has NaN among its numbers: a
/// defect of the program, whose result nobody could use. `name` is that of the file; only files of
/// numbers (csv, yaml, txt) are looked at. Infinite numbers are results.
void RefuseNan(std::string_view name, std::string_view content);

}  // namespace plenocal
