// SPDX-License-Identifier: Apache-2.0
//
// Numbers and lengths from text and as text, independent of the locale.
#pragma once

#include <cstddef>
#include <optional>
#include <string>
#include <string_view>

namespace plenocal {

/// The number that all of `text` is, in the notation of C; nothing for anything else. Independent
/// of the locale. Infinite and NaN are numbers here.
std::optional<double> ParseDouble(std::string_view text);
std::optional<int> ParseInt(std::string_view text);

/// A length as a person writes it.
struct Length {
  double metres = 0;
  bool has_unit = false;  ///< stated with the number; without one a length is in metres
};
/// "0.025", "25 mm", "2.5cm", "1 in": a finite number, then one of m, cm, mm, um, nm, in; nothing
/// for anything else.
std::optional<Length> ParseLength(std::string_view text);

/// Appends `value` with up to `decimals` digits after the point, without trailing zeros: "12.5".
/// Plain and quick, for tables of coordinates in pixels.
void AppendFixed(double value, int decimals, std::string* text);

/// "1 image", "2 images". A noun with another plural than that with an s has it in `plural`.
std::string Counted(size_t count, std::string_view noun, std::string_view plural = {});

/// `value` with 12 significant digits as YAML reads it (".inf", ".nan" included).
std::string YamlNumber(double value);

}  // namespace plenocal
