// SPDX-License-Identifier: Apache-2.0
#include "apps/workbench/project/session_text.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <optional>
#include <regex>
#include <span>
#include <utility>
#include <vector>

#include "calib/base/format_error.h"
#include "calib/base/quoted_text.h"

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

/// Begin of the line of a key, and begin and end of the lines below that belong to it.
struct Block {
  size_t heading = 0, begin = 0, end = 0;
};

size_t EndOfLine(const std::string& text, size_t begin) {
  const size_t end = text.find('\n', begin);
  return end == std::string::npos ? text.size() : end + 1;
}

// The block of a key whose line is not indented, or of the first keys of a block.
std::optional<Block> FindBlock(const std::string& text, const std::string& key, const Block& in) {
  std::optional<size_t> level;  // indentation of the keys
  std::optional<Block> found;
  for (size_t line = in.begin; line < in.end; line = EndOfLine(text, line)) {
    const size_t first = text.find_first_not_of(' ', line);
    if (first == std::string::npos || text[first] == '#' || text[first] == '\n') continue;
    if (!level) level = first - line;
    if (first - line > *level || (text[first] == '-' && first - line == *level)) {
      if (found) found->end = EndOfLine(text, line);
      continue;
    }
    if (found) return found;
    const size_t quoted = text[first] == '"' || text[first] == '\'' ? 1 : 0;
    if (text.compare(first + quoted, key.size(), key) != 0) continue;
    if (text.compare(first + key.size() + 2 * quoted, 1, ":") != 0) continue;
    found = Block{line, EndOfLine(text, line), EndOfLine(text, line)};
  }
  return found;
}

Block WholeOf(const std::string& text) { return {0, 0, text.size()}; }

[[noreturn]] void LeaveToTheUser(const std::string& key) {
  throw InputError("'{}' stands in the text in a way that fields do not change; edit the text",
                   key);
}

// Where the value of a line "key: value  # comment" begins and ends, blanks before it included.
std::pair<size_t, size_t> ValueOf(const std::string& text, size_t key_end, size_t end) {
  size_t comment = text.find(" #", key_end);
  if (comment == std::string::npos || comment > end) comment = end;
  const size_t last = text.find_last_not_of(" \r\n", comment > key_end ? comment - 1 : comment);
  return {key_end, std::max(key_end, last + 1)};
}

// The value of a key of a map in braces, in one line.
std::string WithValueInBraces(
    std::string text, size_t begin, size_t end, const std::string& key, const std::string& value) {
  const std::string line = text.substr(begin, end - begin);
  const std::regex pattern(R"(([{,]\s*)" + key + R"(:\s*)([^,{}\[\]#]*[^,{}\[\]#\s])\s*[,}])");
  std::smatch found;
  if (std::ranges::count(line, '{') != 1 || !std::regex_search(line, found, pattern)) {
    LeaveToTheUser(key);
  }
  return text.replace(
      begin + static_cast<size_t>(found.position(2)), static_cast<size_t>(found.length(2)), value);
}

}  // namespace

std::string WithRule(const std::string& text, const ExcludeRule& rule) {
  const std::optional<Block> block = FindBlock(text, "exclude", WholeOf(text));
  std::string changed = text;
  if (!changed.empty() && changed.back() != '\n') changed += '\n';
  if (!block) return changed + "exclude:\n" + RuleLine(rule);
  if (block->end == block->begin && changed.find_first_of("[{", block->heading) < block->begin) {
    throw InputError("'exclude' stands in one line; edit the session's text");
  }
  std::string line = RuleLine(rule);
  // Items of a list have one indentation.
  const size_t dash = text.find('-', block->begin);
  if (dash < block->end) {
    size_t begin = dash;
    while (begin > block->begin && text[begin - 1] == ' ') --begin;
    line = text.substr(begin, dash - begin) + line.substr(2);
  }
  return changed.insert(std::min(block->end, changed.size()), line);
}

std::string WithoutRule(const std::string& text, const ExcludeRule& rule) {
  const std::optional<Block> block = FindBlock(text, "exclude", WholeOf(text));
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

std::string WithValue(const std::string& text,
                      const std::vector<std::string>& path,
                      const std::string& value) {
  static const std::regex kPlain(R"([\w.+ -]*)");
  if (!std::regex_match(value, kPlain) || value.starts_with('-')) {
    throw InputError("'{}' is no value that a field takes; edit the text", value);
  }
  const std::string& key = path.back();
  std::string changed = text;
  if (!changed.empty() && changed.back() != '\n') changed += '\n';
  Block block = WholeOf(changed);
  size_t indent = 0;
  for (const std::string& parent : std::span(path).first(path.size() - 1)) {
    const auto found = FindBlock(changed, parent, block);
    if (!found) {
      if (path.size() != 2 || value.empty()) LeaveToTheUser(key);
      return changed + fmt::format("{}:\n  {}: {}\n", parent, key, value);
    }
    block = *found;
    indent += 2;
  }
  if (path.size() > 1 && block.begin == block.end) {
    return WithValueInBraces(changed, block.heading, block.begin, key, value);
  }
  const auto found = FindBlock(changed, key, block);
  if (!found) {
    if (value.empty()) return text;
    if (block.begin < block.end && path.size() > 1) {
      const size_t first = changed.find_first_not_of(" \n", block.begin);
      indent = first - changed.rfind('\n', first) - 1;
    }
    return changed.insert(block.end, fmt::format("{:{}}{}: {}\n", "", indent, key, value));
  }
  const size_t colon = changed.find(':', found->heading) + 1;
  const auto [begin, end] = ValueOf(changed, colon, found->begin);
  const std::string now = changed.substr(begin, end - begin);
  const bool several =
      found->begin < found->end || now.find_first_of("[{|>&*") != std::string::npos;
  if (several) LeaveToTheUser(key);
  return changed.replace(begin, end - begin, value.empty() ? "" : " " + value);
}

std::string WithoutKey(const std::string& text, const std::string& key) {
  const auto found = FindBlock(text, key, WholeOf(text));
  std::string changed = text;
  return found ? changed.erase(found->heading, found->end - found->heading) : changed;
}

}  // namespace plenocal::workbench
