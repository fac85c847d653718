// SPDX-License-Identifier: Apache-2.0
#include "calib/io/csv.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>

#include "calib/base/format_error.h"
#include "calib/base/number_text.h"
#include "calib/base/quoted_text.h"
#include "calib/io/input_file.h"

namespace plenocal {
namespace {

constexpr std::string_view kBlanks = " \t\r";
constexpr std::string_view kByteOrderMark = "\xEF\xBB\xBF";

std::string_view Trim(std::string_view text) {
  const size_t first = text.find_first_not_of(kBlanks);
  if (first == std::string_view::npos) return text.substr(0, 0);
  return text.substr(first, text.find_last_not_of(kBlanks) - first + 1);
}

}  // namespace

CsvReader::CsvReader(const std::filesystem::path& path,
                     CsvSyntax syntax,
                     std::string_view first_column,
                     std::string_view example)
    : text_(ReadTextFile(path)), name_(path.string()), syntax_(syntax), rest_(text_) {
  ReadHeader(first_column, example);
}

CsvReader::CsvReader(std::string_view text,
                     std::string name,
                     CsvSyntax syntax,
                     std::string_view first_column,
                     std::string_view example)
    : name_(std::move(name)), syntax_(syntax), rest_(text) {
  ReadHeader(first_column, example);
}

void CsvReader::ReadHeader(std::string_view first_column, std::string_view example) {
  if (rest_.starts_with(kByteOrderMark)) rest_.remove_prefix(kByteOrderMark.size());
  const bool has_header =
      syntax_ == CsvSyntax::kCsv ? NextLine(&header_) : NextLegend(first_column);
  if (!has_header) {
    FailAtLine(1,
               fmt::format("expected a header line {}, found nothing",
                           example.empty() ? "with the names of the columns"
                                           : fmt::format("such as '{}'", example)));
  }
  for (size_t i = 0; i < header_.size(); ++i) {
    if (std::find(header_.begin(), header_.begin() + static_cast<std::ptrdiff_t>(i), header_[i]) !=
        header_.begin() + static_cast<std::ptrdiff_t>(i)) {
      Fail(fmt::format("column '{}' stands in the header twice; remove one", header_[i]));
    }
  }
}

CsvReader::CsvReader(std::string_view text,
                     std::string name,
                     CsvSyntax syntax,
                     GivenColumns columns)
    : name_(std::move(name)), syntax_(syntax), rest_(text), given_(std::move(columns)) {
  if (rest_.starts_with(kByteOrderMark)) rest_.remove_prefix(kByteOrderMark.size());
  header_.assign(given_.names.begin(), given_.names.end());
  while (line_ < given_.skip && !rest_.empty()) TakeLine();
}

std::optional<size_t> CsvReader::Find(std::string_view column) const {
  const auto found = std::find(header_.begin(), header_.end(), column);
  if (found == header_.end()) return std::nullopt;
  return static_cast<size_t>(found - header_.begin());
}

size_t CsvReader::Column(std::string_view column) const {
  if (const std::optional<size_t> found = Find(column)) return *found;
  Fail(fmt::format("column '{}' is missing; the header has {}", column, fmt::join(header_, ",")));
}

bool CsvReader::Next() {
  if (!NextLine(&cells_)) return false;
  const size_t missing = header_.size() - std::min(header_.size(), cells_.size());
  if (cells_.size() > header_.size() || missing > given_.optional) {
    Fail(fmt::format(
        "expected {} columns{}, found {} (is the file truncated?)",
        header_.size(),
        given_.names.empty() ? " as in the header" : fmt::format(" ({})", fmt::join(header_, ",")),
        cells_.size()));
  }
  // Views of the line, so that messages find their place in it.
  while (cells_.size() < header_.size())
    cells_.push_back(cells_.back().substr(cells_.back().size()));
  return true;
}

bool CsvReader::NextLine(std::vector<std::string_view>* cells) {
  while (!rest_.empty()) {
    const std::string_view line = TakeLine();
    if (line.empty() || line.front() == '#') continue;
    cells->clear();
    if (syntax_ == CsvSyntax::kCsv) {
      SplitAtCommas(line, cells);
    } else {
      SplitAtBlanks(line, cells);
    }
    return true;
  }
  return false;
}

bool CsvReader::NextLegend(std::string_view first_column) {
  while (!rest_.empty()) {
    std::string_view line = TakeLine();
    if (line.empty() || line.starts_with("##") || line.starts_with("#!")) continue;
    if (line.front() != '#') Fail("expected the header line '# ...' before the first row");
    line.remove_prefix(1);
    header_.clear();
    SplitAtBlanks(line, &header_);
    if (header_.empty()) continue;
    if (first_column.empty() || header_.front() == first_column) return true;
  }
  return false;
}

std::string_view CsvReader::TakeLine() {
  const size_t newline = rest_.find('\n');
  const std::string_view line = rest_.substr(0, newline);
  rest_.remove_prefix(newline == std::string_view::npos ? rest_.size() : newline + 1);
  ++line_;
  begin_ = line.data();
  return Trim(line);
}

void CsvReader::SplitAtCommas(std::string_view line, std::vector<std::string_view>* cells) {
  for (size_t begin = 0;;) {
    begin = std::min(line.find_first_not_of(kBlanks, begin), line.size());
    const bool quoted = begin < line.size() && line[begin] == '"';
    const size_t comma =
        quoted ? TakeQuoted(line, begin, cells) : std::min(line.find(',', begin), line.size());
    if (!quoted) cells->push_back(Trim(line.substr(begin, comma - begin)));
    if (comma == line.size()) return;
    begin = comma + 1;
  }
}

// Adds the cell whose quotation mark is at `begin`; returns where the comma after it, or the end
// of the line is.
size_t CsvReader::TakeQuoted(std::string_view line,
                             size_t begin,
                             std::vector<std::string_view>* cells) {
  size_t end = line.find('"', begin + 1);
  const bool has_quotes = end != std::string_view::npos && line.substr(end).starts_with("\"\"");
  std::string text;
  for (size_t from = begin + 1; end != std::string_view::npos; end = line.find('"', from)) {
    text += line.substr(from, end - from);
    if (!line.substr(end).starts_with("\"\"")) break;
    text += '"';
    from = end + 2;
  }
  const size_t next =
      end == std::string_view::npos ? end : line.find_first_not_of(kBlanks, end + 1);
  if (end == std::string_view::npos || (next != std::string_view::npos && line[next] != ',')) {
    Fail(fmt::format("a cell in quotation marks does not end with one: {}",
                     Escaped(line.substr(begin))));
  }
  cells->push_back(has_quotes ? unquoted_.emplace_back(std::move(text))
                              : line.substr(begin + 1, end - begin - 1));
  return std::min(next, line.size());
}

void CsvReader::SplitAtBlanks(std::string_view line, std::vector<std::string_view>* cells) const {
  while (true) {
    line = Trim(line);
    if (line.empty()) return;
    const size_t size = std::min(line.find_first_of(kBlanks), line.size());
    cells->push_back(line.substr(0, size));
    line.remove_prefix(size);
  }
}

double CsvReader::Number(size_t column) const {
  const std::optional<double> value = ParseDouble(cells_[column]);
  if (!value || !std::isfinite(*value)) {
    FailAt(column, fmt::format("expected a number, found '{}'", cells_[column]));
  }
  return *value;
}

std::optional<double> CsvReader::NumberIfAny(size_t column) const {
  if (cells_[column].empty()) return std::nullopt;
  return Number(column);
}

int CsvReader::Integer(size_t column) const {
  if (const std::optional<int> value = ParseInt(cells_[column])) return *value;
  // Other programs write "7.0".
  const std::optional<double> value = ParseDouble(cells_[column]);
  constexpr double kLargest = std::numeric_limits<int>::max();
  if (!value || !(std::abs(*value) <= kLargest) || *value != std::trunc(*value)) {
    FailAt(column, fmt::format("expected a whole number, found '{}'", cells_[column]));
  }
  return static_cast<int>(*value);
}

void CsvReader::FailAt(size_t column, const std::string& message) const {
  // A cell with quotes inside is a copy: its row is named from the first character.
  const char* const cell = cells_[column].data();
  const bool in_line = !std::less<>()(cell, begin_) && !std::less<>()(rest_.data(), cell);
  throw InputError(
      "{}:{}:{}: {}: {}", name_, line_, in_line ? cell - begin_ + 1 : 1, header_[column], message);
}

void CsvReader::FailAtLine(int line, const std::string& message) const {
  throw InputError("{}:{}: {}", name_, line, message);
}

}  // namespace plenocal
