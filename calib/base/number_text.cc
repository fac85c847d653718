// SPDX-License-Identifier: Apache-2.0
#include "calib/number_text.h"

#include <fmt/format.h>

#include <charconv>
#include <cmath>

namespace plenocal {

void AppendFixed(double value, int decimals, std::string* text) {
  char buffer[400];
  const auto [end, error] =
      std::to_chars(buffer, buffer + sizeof buffer, value, std::chars_format::fixed, decimals);
  size_t size = static_cast<size_t>(end - buffer);
  if (decimals > 0 && std::isfinite(value)) {
    while (buffer[size - 1] == '0') --size;
    if (buffer[size - 1] == '.') --size;
  }
  if (size == 2 && buffer[0] == '-' && buffer[1] == '0') {
    text->push_back('0');
    return;
  }
  text->append(buffer, size);
}

std::string YamlNumber(double value) {
  if (std::isnan(value)) return ".nan";
  if (std::isinf(value)) return value > 0 ? ".inf" : "-.inf";
  return fmt::format("{:.12g}", value == 0 ? 0.0 : value);
}

std::string YamlQuoted(const std::string& text) {
  std::string quoted = "\"";
  for (const char c : text) {
    if (c == '"' || c == '\\') quoted += '\\';
    if (c == '\n') {
      quoted += "\\n";
    } else {
      quoted += c;
    }
  }
  return quoted + "\"";
}

}  // namespace plenocal
