// SPDX-License-Identifier: Apache-2.0
#include "calib/base/quoted_text.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cstdint>

#include "calib/base/names.h"

namespace plenocal {
namespace {

// A character of UTF-8 text: its code and bytes; no code for a byte that begins none.
struct Character {
  std::optional<std::uint32_t> code;
  std::string_view bytes;
};

// The first character of `text`, which is not empty. Overlong forms, surrogates and codes above
// U+10FFFF are no UTF-8.
Character FirstCharacter(std::string_view text) {
  const auto byte = [&](size_t i) { return static_cast<unsigned char>(text[i]); };
  const unsigned char lead = byte(0);
  if (lead < 0x80) return {lead, text.substr(0, 1)};
  const size_t size = lead >= 0xf0 ? 4 : lead >= 0xe0 ? 3 : 2;
  const Character invalid{std::nullopt, text.substr(0, 1)};
  if (lead < 0xc2 || lead > 0xf4 || text.size() < size) return invalid;
  std::uint32_t code = lead & (0xffU >> (size + 1));
  for (size_t i = 1; i < size; ++i) {
    if ((byte(i) & 0xc0U) != 0x80) return invalid;
    code = code << 6U | (byte(i) & 0x3fU);
  }
  constexpr std::array<std::uint32_t, 5> kLeast{0, 0, 0x80, 0x800, 0x10000};
  const bool surrogate = code >= 0xd800 && code < 0xe000;
  if (code < kLeast[size] || code > 0x10ffff || surrogate) return invalid;
  return {code, text.substr(0, size)};
}

template <typename Visit>
void ForEachCharacter(std::string_view text, const Visit& visit) {
  while (!text.empty()) {
    const Character character = FirstCharacter(text);
    visit(character);
    text.remove_prefix(character.bytes.size());
  }
}

// Control characters, separators of lines, marks of the direction of writing and what is no
// character: none of them is visible, and readers of YAML differ in them.
bool IsInvisible(std::uint32_t code) {
  return code < 0x20 || (code >= 0x7f && code < 0xa0) || code == 0x2028 || code == 0x2029 ||
         (code >= 0x200b && code <= 0x200f) || (code >= 0x202a && code <= 0x202e) ||
         (code >= 0x2066 && code <= 0x2069) || code == 0xfeff || (code & 0xfffeU) == 0xfffe;
}

std::string EscapeOf(std::uint32_t code) {
  switch (code) {
    case '\n':
      return "\\n";
    case '\t':
      return "\\t";
    case '\r':
      return "\\r";
    default:
      return code > 0xffff ? fmt::format("\\U{:08x}", code) : fmt::format("\\u{:04x}", code);
  }
}

// Words that a reader of YAML 1.1 or 1.2 takes for something else than text.
bool IsYamlWord(std::string_view text) {
  static const std::vector<std::string_view> kWords =
      Words("null true false yes no on off y n nan inf none undefined");
  std::string lower(text);
  for (char& c : lower) c = c >= 'A' && c <= 'Z' ? static_cast<char>(c - 'A' + 'a') : c;
  return std::ranges::find(kWords, lower) != kWords.end();
}

bool IsLetter(char c) { return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || c == '_'; }
bool IsDigit(char c) { return c >= '0' && c <= '9'; }

// The first character of a name that is not among those for which `is_allowed` holds.
template <typename Allowed>
std::optional<std::string> CharacterDefect(std::string_view name, const Allowed& is_allowed) {
  std::optional<std::string> defect;
  ForEachCharacter(name, [&](const Character& c) {
    if (defect || (c.code && is_allowed(*c.code))) return;
    defect = c.code ? fmt::format("has a '{}'", Escaped(c.bytes)) : "is not UTF-8";
  });
  return defect;
}

}  // namespace

std::string Escaped(std::string_view text, std::string_view kept) {
  std::string escaped;
  ForEachCharacter(text, [&](const Character& c) {
    if (!c.code) {
      escaped += fmt::format("\\x{:02x}", static_cast<unsigned char>(c.bytes[0]));
    } else if (IsInvisible(*c.code) && kept.find(c.bytes) == std::string_view::npos) {
      escaped += EscapeOf(*c.code);
    } else {
      escaped += c.bytes;
    }
  });
  return escaped;
}

std::string YamlQuoted(std::string_view text) {
  std::string quoted = "\"";
  ForEachCharacter(text, [&](const Character& c) {
    if (!c.code) {
      quoted += "\\ufffd";
    } else if (IsInvisible(*c.code)) {
      quoted += EscapeOf(*c.code);
    } else {
      if (*c.code == '"' || *c.code == '\\') quoted += '\\';
      quoted += c.bytes;
    }
  });
  return quoted + "\"";
}

std::string YamlText(std::string_view text) {
  const bool plain = !text.empty() && (IsLetter(text[0]) || text[0] == '/') && !IsYamlWord(text) &&
                     std::ranges::all_of(text, [](char c) {
                       return IsLetter(c) || IsDigit(c) || c == '-' || c == '.' || c == '/';
                     });
  return plain ? std::string(text) : YamlQuoted(text);
}

std::string CsvCell(std::string_view text) {
  const auto is_blank = [](char c) { return c == ' ' || c == '\t'; };
  const bool plain = !text.empty() && text.find_first_of(",\"\r\n") == std::string_view::npos &&
                     text[0] != '#' && !is_blank(text.front()) && !is_blank(text.back()) &&
                     text != "nan";  // no number
  if (plain || text.empty()) return std::string(text);
  std::string quoted = "\"";
  for (const char c : text) {
    if (c == '"') quoted += '"';
    quoted += c;
  }
  return quoted + "\"";
}

std::optional<std::string> CameraNameDefect(std::string_view name) {
  constexpr const char* kUse = "; it becomes part of file names: use letters, digits, '_' and '-'";
  constexpr size_t kLongest = 100;  // file names have up to 255 bytes
  const std::optional<std::string> defect = CharacterDefect(name, [](std::uint32_t code) {
    constexpr std::string_view kRefused = "/\\,;:*?\"'<>|`$ ";
    return !IsInvisible(code) && code != 0xa0 &&
           (code > 0x7f || kRefused.find(static_cast<char>(code)) == std::string_view::npos);
  });
  if (defect) return *defect + kUse;
  if (name.empty()) return fmt::format("is empty{}", kUse);
  if (name[0] == '.' || name[0] == '-') return fmt::format("begins with '{}'{}", name[0], kUse);
  if (name.size() > kLongest) return fmt::format("is longer than {} bytes{}", kLongest, kUse);
  return std::nullopt;
}

std::optional<std::string> FrameNameDefect(std::string_view name) {
  if (name.empty()) return "is empty";
  return CharacterDefect(name, [](std::uint32_t code) { return !IsInvisible(code); });
}

}  // namespace plenocal
