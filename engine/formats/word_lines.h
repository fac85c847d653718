// SPDX-License-Identifier: Apache-2.0
//
// Text files of words between blanks: COLMAP, DSO.
#pragma once

#include <cstdint>
#include <filesystem>
#include <span>
#include <string>
#include <vector>

namespace plenocal {

/// The words of one line. All members throw `Error` of kind kInput with file and line.
struct WordLine {
  std::string where;  ///< file:line
  std::vector<std::string> words;

  [[noreturn]] void Fail(const std::string& message) const;
  /// Word `i` as a finite number.
  [[nodiscard]] double Number(size_t i) const;
  /// Word `i` as a whole number that is not negative.
  [[nodiscard]] std::uint64_t Count(size_t i) const;
  /// Word `i` as a positive number of pixels.
  [[nodiscard]] int Pixels(size_t i) const;
  /// All words from `first` on as numbers.
  [[nodiscard]] std::vector<double> NumbersFrom(size_t first) const;

 private:
  /// Reads word `i`; whether all of it is the value.
  template <typename Value>
  bool IsWhole(size_t i, Value* value) const;
};

/// All lines, also those without words.
std::vector<WordLine> ReadAllLines(const std::filesystem::path& path);

/// The lines that are not empty; '#' begins a comment. Throws `Error` of kind kInput when there is
/// none.
std::vector<WordLine> ReadWordLines(const std::filesystem::path& path);

/// Numbers with all their digits, blanks between.
std::string BlankSeparated(std::span<const double> values);

}  // namespace plenocal
