// SPDX-License-Identifier: Apache-2.0
#include "apps/report/page.h"

#include <fmt/format.h>

#include <map>

#include "apps/report/page_parts.h"

namespace plenocal {
namespace {

// As text of a script element: nothing in it can end the element.
std::string ScriptText(const nlohmann::json& data) {
  const std::string json = data.dump(-1, ' ', false, nlohmann::json::error_handler_t::replace);
  std::string text;
  text.reserve(json.size());
  for (const char c : json) {
    if (c == '<') {
      text += "\\u003c";
    } else {
      text += c;
    }
  }
  return text;
}

std::string FilledPage(const std::map<std::string_view, std::string_view>& parts) {
  std::string page;
  std::string_view rest = kPageHtml;
  while (true) {
    const size_t open = rest.find("{{");
    page += rest.substr(0, open);
    if (open == std::string_view::npos) return page;
    const size_t close = rest.find("}}", open);
    page += parts.at(rest.substr(open + 2, close - open - 2));
    rest.remove_prefix(close + 2);
  }
}

}  // namespace

std::string MakePage(std::string_view title,
                     std::initializer_list<std::string_view> scripts,
                     const nlohmann::json& data) {
  std::string all = fmt::format("{}\n{}\n", kPlotsJs, kElementsJs);
  for (const std::string_view script : scripts) all += fmt::format("{}\n", script);
  const std::string text = ScriptText(data);
  return FilledPage({{"title", title},
                     {"style", kPageCss},
                     {"library", kChartLibrary},
                     {"scripts", all},
                     {"data", text}});
}

}  // namespace plenocal
