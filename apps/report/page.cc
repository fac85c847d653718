// SPDX-License-Identifier: Apache-2.0
#include "apps/report/page.h"

#include <fmt/format.h>

#include <array>

#include "calib/base/json_text.h"

namespace plenocal {

// web/src/entry/report.html with script and style: made by the build (cmake/embed.cmake).
std::string_view PageShell();

namespace {

// Marks of direction turn the text behind them around: U+202A to U+202E and U+2066 to U+2069.
std::string WithoutDirectionMarks(std::string text) {
  constexpr std::string_view kReplacement = "\uFFFD";
  const auto is_mark = [&](size_t i) {
    const auto last = static_cast<unsigned char>(text[i + 2]);
    return (text[i + 1] == '\x80' && last >= 0xAA && last <= 0xAE) ||
           (text[i + 1] == '\x81' && last >= 0xA6 && last <= 0xA9);
  };
  for (size_t i = text.find('\xE2'); i != std::string::npos && i + 2 < text.size();
       i = text.find('\xE2', i + 1)) {
    if (is_mark(i)) text.replace(i, 3, kReplacement);
  }
  return text;
}

// As text of a script element: nothing in it can end the element.
std::string ScriptText(const nlohmann::json& data) {
  const std::string json = JsonText(data, -1);
  std::string text;
  text.reserve(json.size());
  for (const char& c : json) text += c == '<' ? "\\u003c" : std::string_view(&c, 1);
  return text;
}

}  // namespace

std::string MakePage(std::string_view title, const PageText& text, const nlohmann::json& data) {
  const std::array<std::pair<std::string_view, std::string>, 3> parts{
      {{"{{title}}", HtmlText(title)},
       {"{{text}}",
        fmt::format("<h1>{}</h1>\n{}", HtmlText(title), WithoutDirectionMarks(text.Html()))},
       {"{{data}}", WithoutDirectionMarks(ScriptText(data))}}};
  std::string page;
  std::string_view rest = PageShell();
  for (const auto& [mark, part] : parts) {
    const size_t place = rest.find(mark);
    page += rest.substr(0, place);
    page += part;
    rest.remove_prefix(place + mark.size());
  }
  return page.append(rest);
}

}  // namespace plenocal
