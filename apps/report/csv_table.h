// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <string_view>
#include <vector>

namespace plenocal {

/// A table of our own results: a header line, then rows of as many cells. Cells refer to `text`,
/// which must outlive the table. Every failure throws `Error` of kind kInput with file and line.
class CsvTable {
 public:
  /// `name` stands for the file in messages.
  CsvTable(std::string_view text, std::string name);

  [[nodiscard]] size_t Rows() const { return width_ == 0 ? 0 : cells_.size() / width_; }
  [[nodiscard]] const std::vector<std::string_view>& Header() const { return header_; }
  [[nodiscard]] bool Has(std::string_view column) const;
  /// The place of a column; throws when there is none.
  [[nodiscard]] size_t Column(std::string_view column) const;
  [[nodiscard]] std::string_view Text(size_t row, size_t column) const {
    return cells_[row * width_ + column];
  }
  /// NaN for an empty cell.
  [[nodiscard]] double Number(size_t row, size_t column) const;
  [[nodiscard]] int Integer(size_t row, size_t column) const;
  [[noreturn]] void Fail(size_t row, const std::string& message) const;

 private:
  std::string name_;
  size_t width_ = 0;
  std::vector<std::string_view> header_, cells_;
};

}  // namespace plenocal
