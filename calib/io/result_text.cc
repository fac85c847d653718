// SPDX-License-Identifier: Apache-2.0
#include "calib/io/result_text.h"

#include <algorithm>

#include "calib/base/format_error.h"

namespace plenocal {
namespace {

// Characters between the numbers of a file of this name; none for other files.
std::string_view SeparatorsOf(std::string_view name) {
  if (name.ends_with(".csv")) return ",\n";
  if (name.ends_with(".yaml")) return " ,:[]{}\n";
  if (name.ends_with(".txt")) return " \n";
  return {};
}

bool EndsInQuotes(std::string_view line) {
  bool quoted = false;
  for (size_t i = 0; i < line.size(); ++i) {
    if (line[i] == '"') quoted = !quoted;
    if (line[i] == '\\') ++i;
  }
  return quoted;
}

}  // namespace

void RefuseNan(std::string_view name, std::string_view content) {
  constexpr std::string_view kNan = "nan";
  const std::string_view separators = SeparatorsOf(name);
  if (separators.empty()) return;
  const auto separates = [&](size_t place) {
    return place >= content.size() || separators.find(content[place]) != std::string_view::npos;
  };
  for (size_t at = content.find(kNan); at != std::string_view::npos;
       at = content.find(kNan, at + 1)) {
    if (!separates(at + kNan.size())) continue;
    size_t begin = at;
    while (begin > 0 && (content[begin - 1] == '.' || content[begin - 1] == '-')) --begin;
    if (begin > 0 && !separates(begin - 1)) continue;
    const size_t line = content.substr(0, at).rfind('\n') + 1;  // 0 in the first line
    if (EndsInQuotes(content.substr(line, begin - line))) continue;
    constexpr size_t kShown = 80;
    const std::string_view shown = content.substr(line, content.find('\n', line) - line);
    throw JobError(
        "internal error: {}:{}: a result is no number: '{}'; report this defect with "
        "the input",
        name,
        std::ranges::count(content.substr(0, line), '\n') + 1,
        shown.substr(0, kShown));
  }
}

}  // namespace plenocal
