// SPDX-License-Identifier: Apache-2.0
#include "engine/formats/word_lines.h"

#include <fmt/format.h>

#include <charconv>
#include <cmath>
#include <sstream>

#include "calib/base/format_error.h"
#include "calib/io/input_file.h"
#include "engine/formats/exact_numbers.h"

namespace plenocal {

void WordLine::Fail(const std::string& message) const {
  throw InputError("{}: {}", where, message);
}

template <typename Value>
bool WordLine::IsWhole(size_t i, Value* value) const {
  if (i >= words.size()) Fail(fmt::format("expected more than {} words", words.size()));
  const char* const end = words[i].data() + words[i].size();
  const auto [after, error] = std::from_chars(words[i].data(), end, *value);
  return error == std::errc() && after == end;
}

double WordLine::Number(size_t i) const {
  double value = 0;
  if (!IsWhole(i, &value) || !std::isfinite(value)) {
    Fail(fmt::format("expected a number, found '{}'", words[i]));
  }
  return value;
}

std::uint64_t WordLine::Count(size_t i) const {
  std::uint64_t value = 0;
  if (!IsWhole(i, &value)) Fail(fmt::format("expected a whole number, found '{}'", words[i]));
  return value;
}

int WordLine::Pixels(size_t i) const {
  constexpr double kMost = 1e6;  // no image has more columns
  const double value = Number(i);
  if (value < 1 || value != std::floor(value) || value > kMost) {
    Fail(fmt::format("expected a number of pixels, found '{}'", words[i]));
  }
  return static_cast<int>(value);
}

std::vector<double> WordLine::NumbersFrom(size_t first) const {
  std::vector<double> numbers;
  for (size_t i = first; i < words.size(); ++i) numbers.push_back(Number(i));
  return numbers;
}

std::vector<WordLine> ReadAllLines(const std::filesystem::path& path) {
  std::istringstream text(ReadTextFile(path));
  std::vector<WordLine> lines;
  for (std::string line; std::getline(text, line);) {
    WordLine& read = lines.emplace_back();
    read.where = fmt::format("{}:{}", path.string(), lines.size());
    std::istringstream words(line);
    for (std::string word; words >> word;) read.words.push_back(word);
  }
  return lines;
}

std::vector<WordLine> ReadWordLines(const std::filesystem::path& path) {
  std::vector<WordLine> lines = ReadAllLines(path);
  for (WordLine& line : lines) {
    for (size_t i = 0; i < line.words.size(); ++i) {
      const size_t comment = line.words[i].find('#');
      if (comment == std::string::npos) continue;
      line.words[i].resize(comment);
      line.words.resize(comment == 0 ? i : i + 1);
    }
  }
  std::erase_if(lines, [](const WordLine& line) { return line.words.empty(); });
  if (lines.empty()) throw InputError("{}: holds no cameras", path.string());
  return lines;
}

std::string BlankSeparated(std::span<const double> values) {
  std::string text;
  for (const double value : values) {
    if (!text.empty()) text += ' ';
    text += RealText(value);
  }
  return text;
}

}  // namespace plenocal
