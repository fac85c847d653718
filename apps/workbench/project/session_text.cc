// SPDX-License-Identifier: Apache-2.0
#include "apps/workbench/project/session_text.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <iterator>
#include <optional>
#include <regex>
#include <vector>

#include "calib/base/format_error.h"
#include "calib/base/quoted_text.h"
#include "calib/io/yaml.h"

namespace plenocal::workbench {
namespace {

std::string RuleLine(const ExcludeRule& rule) {
  std::vector<std::string> parts;
  if (!rule.camera.empty()) parts.push_back("camera: " + YamlText(rule.camera));
  if (!rule.frame.empty()) parts.push_back("frame: " + YamlText(rule.frame));
  if (!rule.markers.empty()) {
    parts.push_back(fmt::format("markers: [{}]", fmt::join(rule.markers, ", ")));
  }
  if (!rule.note.empty()) parts.push_back("note: " + YamlText(rule.note));
  return fmt::format("  - {{{}}}\n", fmt::join(parts, ", "));
}

/// Begin of the line `exclude:`, and begin and end of the lines of its block.
struct Block {
  size_t heading = 0, begin = 0, end = 0;
};

size_t EndOfLine(const std::string& text, size_t begin) {
  const size_t end = text.find('\n', begin);
  return end == std::string::npos ? text.size() : end + 1;
}

std::optional<Block> FindBlock(const std::string& text) {
  for (size_t line = 0; line < text.size(); line = EndOfLine(text, line)) {
    if (text.compare(line, 8, "exclude:") != 0) continue;
    Block block{line, EndOfLine(text, line), 0};
    block.end = block.begin;
    // Its items are indented or begin with "- ".
    for (size_t next = block.begin; next < text.size() && (text[next] == ' ' || text[next] == '-');
         next = EndOfLine(text, next)) {
      block.end = EndOfLine(text, next);
    }
    return block;
  }
  return std::nullopt;
}

}  // namespace

std::string WithRule(const std::string& text, const ExcludeRule& rule) {
  const std::optional<Block> block = FindBlock(text);
  std::string changed = text;
  if (!changed.empty() && changed.back() != '\n') changed += '\n';
  if (!block) return changed + "exclude:\n" + RuleLine(rule);
  if (block->end == block->begin && changed.find_first_of("[{", block->heading) < block->begin) {
    throw InputError("'exclude' stands in one line; edit the session's text");
  }
  std::string line = RuleLine(rule);
  // Items of a list have one indentation.
  const size_t dash = text.find('-', block->begin);
  if (block->end > block->begin && dash < block->end) {
    size_t begin = dash;
    while (begin > block->begin && text[begin - 1] == ' ') --begin;
    line = text.substr(begin, dash - begin) + line.substr(2);
  }
  return changed.insert(std::min(block->end, changed.size()), line);
}

std::string WithoutRule(const std::string& text, const ExcludeRule& rule) {
  const std::optional<Block> block = FindBlock(text);
  const std::string wanted = RuleLine(rule).substr(2);
  size_t lines = 0;
  std::optional<std::pair<size_t, size_t>> found;
  for (size_t line = block ? block->begin : text.size(); block && line < block->end;
       line = EndOfLine(text, line)) {
    ++lines;
    const size_t dash = text.find('-', line), end = EndOfLine(text, line);
    if (dash >= end) continue;
    std::string item = text.substr(dash, end - dash);
    if (item.back() != '\n') item += '\n';
    if (item == wanted) found = {line, end};
  }
  if (!found) {
    throw InputError("no line of 'exclude' is this rule; edit the session's text");
  }
  std::string changed = text;
  if (lines == 1) return changed.erase(block->heading, block->end - block->heading);
  return changed.erase(found->first, found->second - found->first);
}

std::string WithModel(const std::string& text,
                      const std::string& camera,
                      const std::string& model) {
  const YamlNode cameras = YamlNode::Parse(text, "session").At("cameras");
  const YamlNode now = cameras.At(camera).At("model");
  size_t begin = 0;
  for (int line = 1; line < now.Line(); ++line) begin = EndOfLine(text, begin);
  const std::string line = text.substr(begin, EndOfLine(text, begin) - begin);
  const std::regex pattern(R"(\bmodel:\s*["']?([\w-]+))");
  const std::sregex_iterator found(line.begin(), line.end(), pattern), none;
  if (std::distance(found, none) != 1 || found->str(1) != now.AsString()) {
    throw InputError(
        "line {} of the session has not the model of '{}' alone; edit the "
        "session's text",
        now.Line(),
        camera);
  }
  std::string changed = text;
  return changed.replace(begin + static_cast<size_t>(found->position(1)),
                         static_cast<size_t>(found->length(1)),
                         model);
}

}  // namespace plenocal::workbench
