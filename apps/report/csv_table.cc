// SPDX-License-Identifier: Apache-2.0
#include "apps/report/csv_table.h"

#include <fmt/format.h>

#include <algorithm>
#include <charconv>
#include <limits>

#include "calib/error.h"

namespace plenocal {

CsvTable::CsvTable(std::string_view text, std::string name) : name_(std::move(name)) {
  size_t row = 0;
  while (!text.empty()) {
    const size_t newline = text.find('\n');
    std::string_view line = text.substr(0, newline);
    text.remove_prefix(newline == std::string_view::npos ? text.size() : newline + 1);
    if (line.ends_with('\r')) line.remove_suffix(1);
    if (line.empty()) continue;
    std::vector<std::string_view>& target = width_ == 0 ? header_ : cells_;
    const size_t before = target.size();
    for (size_t begin = 0; begin != std::string_view::npos;) {
      const size_t comma = line.find(',', begin);
      target.push_back(line.substr(begin, comma - begin));
      begin = comma == std::string_view::npos ? comma : comma + 1;
    }
    if (width_ == 0) {
      width_ = header_.size();
      continue;
    }
    if (target.size() - before != width_) {
      Fail(row, fmt::format("{} cells where the header has {}", target.size() - before, width_));
    }
    ++row;
  }
  if (width_ == 0) throw Error(ErrorKind::kInput, name_ + ": is empty");
}

bool CsvTable::Has(std::string_view column) const {
  return std::find(header_.begin(), header_.end(), column) != header_.end();
}

size_t CsvTable::Column(std::string_view column) const {
  const auto found = std::find(header_.begin(), header_.end(), column);
  if (found == header_.end()) {
    throw Error(ErrorKind::kInput, fmt::format("{}: column '{}' is missing", name_, column));
  }
  return static_cast<size_t>(found - header_.begin());
}

double CsvTable::Number(size_t row, size_t column) const {
  const std::string_view text = Text(row, column);
  if (text.empty()) return std::numeric_limits<double>::quiet_NaN();
  double value = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (error != std::errc() || end != text.data() + text.size()) {
    Fail(row, fmt::format("{}: expected a number, found '{}'", header_[column], text));
  }
  return value;
}

int CsvTable::Integer(size_t row, size_t column) const {
  const std::string_view text = Text(row, column);
  int value = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (error != std::errc() || end != text.data() + text.size()) {
    Fail(row, fmt::format("{}: expected an integer, found '{}'", header_[column], text));
  }
  return value;
}

void CsvTable::Fail(size_t row, const std::string& message) const {
  throw Error(ErrorKind::kInput, fmt::format("{}:{}: {}", name_, row + 2, message));
}

}  // namespace plenocal
