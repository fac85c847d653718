// SPDX-License-Identifier: Apache-2.0
//
// Targets at true scale as files to print.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

namespace plenocal {

/// The target to print and the file to write.
struct PrintRequest {
  std::string target;         ///< a file, or a target in one word
  std::filesystem::path out;  ///< .svg, .pdf or .png
  std::string paper = "fit";  ///< a name as of --paper
  double dpi = 300;           ///< of PNG
  bool numbers = false;       ///< draws the markers' numbers and the target's axes, too: to look at
};

/// Writes the target at true scale with a ruler; what does not fit on one page is spread over
/// several, the tags of an arrangement in space one by one with their ids and cut marks. Several
/// pages of SVG or PNG become FILE-1, FILE-2, ... Returns the files written. Throws `Error`.
std::vector<std::filesystem::path> PrintTarget(const PrintRequest& request);

}  // namespace plenocal
