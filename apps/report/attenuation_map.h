// SPDX-License-Identifier: Apache-2.0
//
// Reduces an attenuation image to a small map for the report.
#pragma once

#include <nlohmann/json.hpp>
#include <string>

namespace plenocal {

/// `Vignetting` of the schema, from a TIFF file's content. `pitch` of the micro images, px; 0:
/// there are none. Throws `Error` of kind kInput; `name` stands for the file in its message.
nlohmann::json VignettingJson(const std::string& tiff, const std::string& name, double pitch);

}  // namespace plenocal
