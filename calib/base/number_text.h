// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

namespace plenocal {

/// Appends `value` with up to `decimals` digits after the point, without trailing zeros: "12.5".
/// Plain and quick, for tables of coordinates in pixels.
void AppendFixed(double value, int decimals, std::string* text);

/// `value` with 12 significant digits as YAML reads it (".inf", ".nan" included).
std::string YamlNumber(double value);

/// `text` in double quotes as YAML reads it.
std::string YamlQuoted(const std::string& text);

}  // namespace plenocal
