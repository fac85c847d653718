// SPDX-License-Identifier: Apache-2.0
#include "apps/report/page_text.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <map>

#include "calib/base/number_text.h"

namespace plenocal {
namespace {

int ExponentOf(const std::string& scientific) {
  return std::stoi(scientific.substr(scientific.find('e') + 1));
}

// "1.20e-07" -> "1.20e-7".
std::string Exponential(double value, int decimals) {
  const std::string text = fmt::format("{:.{}e}", value, decimals);
  const int exponent = ExponentOf(text);
  return fmt::format(
      "{}e{}{}", text.substr(0, text.find('e')), exponent < 0 ? '-' : '+', std::abs(exponent));
}

// "1.20" -> "1.2", "1.20e-7" -> "1.2e-7".
std::string WithoutNeedlessZeros(const std::string& text) {
  if (text.find('.') == std::string::npos) return text;
  const size_t end = std::min(text.find('e'), text.size());
  size_t last = text.find_last_not_of('0', end - 1);
  if (text[last] == '.') --last;
  return text.substr(0, last + 1) + text.substr(end);
}

}  // namespace

std::string HtmlText(std::string_view text) {
  static const std::map<char, std::string_view> kEntities{
      {'&', "&amp;"}, {'<', "&lt;"}, {'>', "&gt;"}, {'"', "&quot;"}, {'\'', "&#39;"}};
  std::string html;
  html.reserve(text.size());
  for (const char& c : text) {
    const auto entity = kEntities.find(c);
    html += entity == kEntities.end() ? std::string_view(&c, 1) : entity->second;
  }
  return html;
}

std::string BriefNumber(const nlohmann::json& value, int digits) {
  if (!value.is_number()) return "–";
  const auto number = value.get<double>();
  const std::string scientific = fmt::format("{:.{}e}", number, digits - 1);
  const int exponent = ExponentOf(scientific);
  constexpr int kLeast = -7, kMost = 21;  // between which JavaScript writes no exponent
  if (exponent < kLeast || exponent >= kMost) {
    return WithoutNeedlessZeros(Exponential(number, digits - 1));
  }
  return WithoutNeedlessZeros(fmt::format(
      "{:.{}f}", ParseDouble(scientific).value_or(number), std::max(0, digits - 1 - exponent)));
}

std::pair<std::string, std::string> NumberWithSigma(double value, const nlohmann::json& sigma) {
  if (!sigma.is_number()) return {BriefNumber(value, 6), "not determined"};
  const auto error = sigma.get<double>();
  if (!(error > 0)) return {BriefNumber(value, 9), "fixed"};
  const int digits = 1 - static_cast<int>(std::floor(std::log10(error)));
  const double size = std::abs(value);
  constexpr double kLarge = 1e6, kSmall = 1e-4;
  constexpr int kMostDecimals = 9;
  if (size >= kLarge || (value != 0 && size < kSmall) || digits > kMostDecimals) {
    const int exponent = static_cast<int>(std::floor(std::log10(size > 0 ? size : 1)));
    const int significant = std::clamp(exponent + digits + 1, 2, 15);
    return {Exponential(value, significant - 1), Exponential(error, 1)};
  }
  const int shown = std::max(digits, 0);
  return {fmt::format("{:.{}f}", value, shown), fmt::format("{:.{}f}", error, shown)};
}

void PageText::Element(std::string_view tag, std::string_view text) {
  html_ += fmt::format("<{0}>{1}</{0}>\n", tag, HtmlText(text));
}

void PageText::Box(std::string_view grade,
                   std::string_view headline,
                   const std::vector<std::string>& lines) {
  html_ += fmt::format(
      "<div class=\"verdict {}\"><strong>{}</strong>\n", HtmlText(grade), HtmlText(headline));
  for (const std::string& line : lines) Element("div", line);
  html_ += "</div>\n";
}

void PageText::Findings(const nlohmann::json& findings) {
  if (findings.empty()) return;
  html_ += "<ul class=\"findings\">\n";
  for (const nlohmann::json& finding : findings) {
    html_ += fmt::format("<li class=\"{}\">{} <em>{}</em></li>\n",
                         HtmlText(finding.at("grade").get<std::string>()),
                         HtmlText(finding.at("what").get<std::string>()),
                         HtmlText(finding.at("remedy").get<std::string>()));
  }
  html_ += "</ul>\n";
}

void PageText::Table(std::string_view caption,
                     const std::vector<std::string>& head,
                     const std::vector<std::vector<std::string>>& rows) {
  html_ += fmt::format("<div class=\"scroll\"><table><caption>{}</caption>\n", HtmlText(caption));
  if (!head.empty()) {
    html_ += "<thead><tr>";
    for (const std::string& cell : head) {
      html_ += fmt::format("<th scope=\"col\">{}</th>", HtmlText(cell));
    }
    html_ += "</tr></thead>\n";
  }
  html_ += "<tbody>\n";
  for (const std::vector<std::string>& row : rows) {
    html_ += fmt::format("<tr><th scope=\"row\">{}</th>", HtmlText(row.front()));
    for (size_t i = 1; i < row.size(); ++i) html_ += fmt::format("<td>{}</td>", HtmlText(row[i]));
    html_ += "</tr>\n";
  }
  html_ += "</tbody></table></div>\n";
}

}  // namespace plenocal
