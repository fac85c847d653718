// SPDX-License-Identifier: Apache-2.0
//
// The key `pairing`: which images of several cameras belong to one frame.
#pragma once

#include <optional>

#include "calib/io/yaml.h"

namespace plenocal {

/// The rule by which images of several cameras belong to one frame.
struct Pairing {
  enum class By { kName, kTime };
  std::optional<By> by = {};             ///< nothing: by time if all cameras have times
  std::optional<double> tolerance = {};  ///< s; nothing: from the scatter of the times
};

/// The key `pairing` of sessions and recordings. Throws `Error` with file, line and key.
Pairing ReadPairing(const YamlNode& node);

}  // namespace plenocal
