// SPDX-License-Identifier: Apache-2.0
//
// Writes what a page holds for readers without script, and for the first moment of those with it.
#pragma once

#include <nlohmann/json.hpp>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

namespace plenocal {

/// HTML of headings, boxes and tables. All that is added is shown as text, whatever it holds.
class PageText {
 public:
  void Heading(std::string_view text) { Element("h2", text); }
  void Subheading(std::string_view text) { Element("h3", text); }
  void Paragraph(std::string_view text) { Element("p", text); }
  /// `grade`: good, usable or bad.
  void Box(std::string_view grade,
           std::string_view headline,
           const std::vector<std::string>& lines);
  /// Findings of `VerdictJson`.
  void Findings(const nlohmann::json& findings);
  /// Of each row the first cell is its name.
  void Table(std::string_view caption,
             const std::vector<std::string>& head,
             const std::vector<std::vector<std::string>>& rows);
  [[nodiscard]] const std::string& Html() const { return html_; }

 private:
  void Element(std::string_view tag, std::string_view text);

  std::string html_;
};

/// With '&', '<', '>' and quotes as entities.
std::string HtmlText(std::string_view text);

/// The numbers of a page without script are written as those of its components are
/// (web/src/base/numbers.ts). `value` with significant digits, without needless zeros; a dash when
/// it is null.
std::string BriefNumber(const nlohmann::json& value, int digits = 3);

/// Value and standard error with the digits that the standard error justifies. `sigma`: null where
/// the value is not determined, 0 where it is fixed.
std::pair<std::string, std::string> NumberWithSigma(double value, const nlohmann::json& sigma);

}  // namespace plenocal
