// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <vector>

namespace plenocal {

/// An attenuation image, reduced for display.
struct AttenuationMap {
  int columns = 0, rows = 0;
  std::vector<float> values;                     ///< highest of each block, row by row
  std::vector<float> middle_row, middle_column;  ///< full resolution
};

/// From a TIFF file's content, at most `longer` cells along the longer side. Throws `Error` of kind
/// kInput; `name` stands for the file in its message.
AttenuationMap ReadAttenuationMap(const std::string& tiff, const std::string& name, int longer);

}  // namespace plenocal
