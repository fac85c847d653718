// SPDX-License-Identifier: Apache-2.0
//
// Targets in one word: chessboard:9x6:25mm.
#include <fmt/format.h>

#include <algorithm>
#include <cctype>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "calib/base/format_error.h"
#include "calib/base/names.h"
#include "calib/base/number_text.h"
#include "calib/io/input_file.h"
#include "targets/code_books.h"
#include "targets/target.h"

namespace plenocal {
namespace {

std::vector<std::string> Split(std::string_view text) {
  std::vector<std::string> parts;
  for (size_t begin = 0; begin <= text.size();) {
    const size_t end = std::min(text.find(':', begin), text.size());
    parts.emplace_back(text.substr(begin, end - begin));
    begin = end + 1;
  }
  return parts;
}

/// A value of the word and the key that it belongs to.
struct WordKey {
  std::string name;
  std::optional<std::string> otherwise;  ///< its value where the word leaves it out
};

std::vector<WordKey> KeysOf(const TargetType& type) {
  std::vector<WordKey> keys;
  for (const std::string& part : Split(type.word)) {
    const size_t equal = part.find('=');
    keys.push_back({part.substr(0, equal), std::nullopt});
    if (equal != std::string::npos) keys.back().otherwise = part.substr(equal + 1);
  }
  return keys;
}

// chessboard:COLUMNSxROWS:SQUARE
std::string FormOf(const TargetType& type) {
  std::string form = fmt::format("{}:COLUMNSxROWS", type.name);
  for (const WordKey& key : KeysOf(type)) {
    std::string name = key.name;
    std::ranges::transform(
        name, name.begin(), [](unsigned char c) { return static_cast<char>(std::toupper(c)); });
    form += key.otherwise ? fmt::format("[:{}]", name) : fmt::format(":{}", name);
  }
  return form;
}

[[noreturn]] void Refuse(const std::string& word, const std::string& message) {
  throw InputError("{}: {}", word, message);
}

TargetType TypeOf(const std::string& word, const std::string& name) {
  std::vector<std::string_view> names;
  for (const TargetType& type : TargetTypes()) {
    if (type.word.empty()) continue;
    if (type.name == name) return type;
    names.push_back(type.name);
  }
  Refuse(word, fmt::format("expected a target type, got '{}'{}", name, SuggestName(name, names)));
}

// "columns: 9\nrows: 6\n" of "9x6".
std::string CountsYaml(const std::string& word, const TargetType& type, const std::string& text) {
  const size_t x = text.find_first_of("xX");
  const auto columns = ParseInt(text.substr(0, x));
  const auto rows = x == std::string::npos ? std::nullopt : ParseInt(text.substr(x + 1));
  if (!columns || !rows) {
    Refuse(word, fmt::format("expected {}, got '{}' for columns and rows", FormOf(type), text));
  }
  return fmt::format("columns: {}\nrows: {}\n", *columns, *rows);
}

// OpenCV's name of a dictionary that may lack its "DICT_", in any case.
std::string DictionaryName(const std::string& text) {
  const auto same = [](std::string_view a, std::string_view b) {
    return std::ranges::equal(
        a, b, [](unsigned char c, unsigned char d) { return std::tolower(c) == std::tolower(d); });
  };
  for (const internal::CodeBook& book : internal::kArucoDictionaries) {
    if (same(book.name, text) || same(book.name, "DICT_" + text)) return std::string(book.name);
  }
  return text;
}

std::string YamlOfWord(const std::string& word) {
  std::vector<std::string> parts = Split(word);
  const TargetType type = TypeOf(word, parts[0]);
  std::string yaml = fmt::format("plenocal: 1\ntype: {}\n", type.name);
  std::string more;
  while (parts.size() > 1 && parts.back().find('=') != std::string::npos) {
    const size_t equal = parts.back().find('=');
    more = fmt::format(
        "{}: {}\n{}", parts.back().substr(0, equal), parts.back().substr(equal + 1), more);
    parts.pop_back();
  }
  const std::vector<WordKey> keys = KeysOf(type);
  if (parts.size() < 2 || parts.size() > keys.size() + 2) {
    Refuse(word, fmt::format("expected {}", FormOf(type)));
  }
  yaml += CountsYaml(word, type, parts[1]);
  for (size_t k = 0; k < keys.size(); ++k) {
    const bool given = k + 2 < parts.size();
    if (!given && !keys[k].otherwise) {
      Refuse(word, fmt::format("'{}' is missing; expected {}", keys[k].name, FormOf(type)));
    }
    const std::string value = given ? parts[k + 2] : *keys[k].otherwise;
    yaml += fmt::format(
        "{}: {}\n", keys[k].name, keys[k].name == "dictionary" ? DictionaryName(value) : value);
  }
  return yaml + more;
}

}  // namespace

Target TargetOfWord(const std::string& word) {
  const std::string yaml = YamlOfWord(word);
  constexpr std::string_view kName = "target";
  try {
    return ReadTarget(YamlNode::Parse(yaml, std::string(kName)));
  } catch (const Error& error) {
    // Line and column are those of a file that nobody has seen.
    const std::string message = error.what();
    const size_t place = message.starts_with(kName) ? message.find(": ") + 2 : 0;
    Refuse(word, message.substr(place));
  }
}

TargetSource TargetNamed(const std::string& target) {
  if (IsThere(target)) return {.file = target, .keys = std::nullopt};
  if (target.find('\n') != std::string::npos) {
    return {.file = {}, .keys = YamlNode::Parse(target, "target")};
  }
  if (target.find(':') != std::string::npos) {
    const std::string yaml = TargetOfWord(target).nominal_yaml;
    return {.file = {}, .keys = YamlNode::Parse(yaml, target)};
  }
  throw InputError(
      "--target {}: no such file; give target.yaml, or a target in one word "
      "such as chessboard:9x6:25mm",
      target);
}

}  // namespace plenocal
