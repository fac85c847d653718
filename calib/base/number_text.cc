// SPDX-License-Identifier: Apache-2.0
#include "calib/base/number_text.h"

#include <fmt/format.h>

#include <array>
#include <charconv>
#include <cmath>
#include <cstdint>

namespace plenocal {
namespace {

template <typename T>
std::optional<T> Parse(std::string_view text) {
  T value{};
  const char* const end = text.data() + text.size();
  const auto [after, error] = std::from_chars(text.data(), end, value);
  if (error != std::errc() || after != end) return std::nullopt;
  return value;
}

// Powers of ten that doubles hold exactly.
constexpr std::array<double, 10> kPowersOfTen{1, 1e1, 1e2, 1e3, 1e4, 1e5, 1e6, 1e7, 1e8, 1e9};

// The multiple of 10^-decimals that is nearest to a value >= 0; nothing where the value is large or
// rounding of the product could decide between two.
std::optional<int64_t> NearestMultiple(double value, int decimals) {
  constexpr double kMost = 1e13, kRounding = 2e-3;  // of a product below `kMost`
  if (static_cast<size_t>(decimals) >= kPowersOfTen.size()) return std::nullopt;
  const double scaled = value * kPowersOfTen[static_cast<size_t>(decimals)];
  if (!(scaled < kMost)) return std::nullopt;
  const double whole = std::floor(scaled), rest = scaled - whole;
  if (std::abs(rest - 0.5) < kRounding) return std::nullopt;
  return static_cast<int64_t>(whole) + (rest > 0.5 ? 1 : 0);
}

// A multiple of 10^-decimals without trailing zeros after the point.
void AppendMultiple(int64_t multiple, int decimals, std::string* text) {
  const auto power = static_cast<int64_t>(kPowersOfTen[static_cast<size_t>(decimals)]);
  char digits[20];
  const auto whole = std::to_chars(digits, digits + sizeof digits, multiple / power);
  text->append(digits, whole.ptr);
  int64_t rest = multiple % power;
  if (rest == 0) return;
  for (; rest % 10 == 0; rest /= 10) --decimals;
  char* const end = digits + decimals;
  for (char* digit = end; digit != digits; rest /= 10) {
    *--digit = static_cast<char>('0' + rest % 10);
  }
  text->push_back('.');
  text->append(digits, end);
}

}  // namespace

std::optional<double> ParseDouble(std::string_view text) { return Parse<double>(text); }
std::optional<int> ParseInt(std::string_view text) { return Parse<int>(text); }

std::optional<Length> ParseLength(std::string_view text) {
  // Fractions, so that 36 mm and 0.036 m are the same number.
  struct Unit {
    std::string_view name;
    double numerator, denominator;
  };
  static constexpr Unit kUnits[] = {{"m", 1, 1},
                                    {"cm", 1, 1e2},
                                    {"mm", 1, 1e3},
                                    {"um", 1, 1e6},
                                    {"\u00b5m", 1, 1e6},
                                    {"\u03bcm", 1, 1e6},
                                    {"nm", 1, 1e9},
                                    {"in", 254, 1e4},
                                    {"inch", 254, 1e4}};
  if (text.size() > 1 && text[0] == '+' && text[1] != '-') text.remove_prefix(1);
  double value = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (error != std::errc() || !std::isfinite(value)) return std::nullopt;
  text.remove_prefix(static_cast<size_t>(end - text.data()));
  if (text.empty()) return Length{value, false};
  while (text.starts_with(' ')) text.remove_prefix(1);
  for (const Unit& unit : kUnits) {
    if (text == unit.name) return Length{value * unit.numerator / unit.denominator, true};
  }
  return std::nullopt;
}

void AppendFixed(double value, int decimals, std::string* text) {
  if (const auto multiple = NearestMultiple(std::abs(value), decimals)) {
    if (value < 0 && *multiple > 0) text->push_back('-');
    AppendMultiple(*multiple, decimals, text);
    return;
  }
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

std::string Counted(size_t count, std::string_view noun, std::string_view plural) {
  if (count == 1) return fmt::format("1 {}", noun);
  if (!plural.empty()) return fmt::format("{} {}", count, plural);
  return fmt::format("{} {}s", count, noun);
}

std::string YamlNumber(double value) {
  if (std::isnan(value)) return ".nan";
  if (std::isinf(value)) return value > 0 ? ".inf" : "-.inf";
  std::string text = fmt::format("{:.12g}", value == 0 ? 0.0 : value);
  // YAML 1.1, as PyYAML reads it, takes 1e-08 for a text.
  const size_t exponent = text.find('e');
  if (exponent != std::string::npos && text.find('.') == std::string::npos) {
    text.insert(exponent, ".0");
  }
  return text;
}

}  // namespace plenocal
