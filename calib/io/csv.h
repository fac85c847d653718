// SPDX-License-Identifier: Apache-2.0
//
// The reader of tables with commas or blanks.
#pragma once

#include <cstddef>
#include <deque>
#include <filesystem>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace plenocal {

/// Syntax of a table with a header line.
enum class CsvSyntax {
  kCsv,    ///< cells between commas; lines that begin with '#' are comments
  kVnlog,  ///< cells between blanks; header "# a b c", comments "## ..." and "#! ..."
};

/// Reads a table row by row; the only reader of CSV files. The header names the columns, which may
/// come in any order. Empty lines and comments are skipped, blanks around a cell and a byte order
/// mark are ignored. A cell of a CSV file may stand in double quotes (RFC 4180), then it keeps
/// commas and blanks; it ends in its line.
///
/// Every failure throws `Error` of kind kInput whose message starts with "file:line:column: " (the
/// column counts characters from 1; where no single cell is wrong, "file:line: ").
class CsvReader {
 public:
  /// Reads the header of a file.
  explicit CsvReader(const std::filesystem::path& path,
                     CsvSyntax syntax = CsvSyntax::kCsv,
                     std::string_view first_column = {},
                     std::string_view example = {});
  CsvReader(const CsvReader&) = delete;  // cells are views of the text
  CsvReader& operator=(const CsvReader&) = delete;

  /// Reads the header. `text` must outlive the reader; `name` stands for the file in messages. In
  /// vnlog the header is the first comment "# ..." that begins with `first_column`, if given.
  /// Throws for a text without header (`example` is shown then), or one that names a column twice.
  CsvReader(std::string_view text,
            std::string name,
            CsvSyntax syntax = CsvSyntax::kCsv,
            std::string_view first_column = {},
            std::string_view example = {});

  /// Names of the columns of a text without header.
  struct GivenColumns {
    std::vector<std::string> names;
    size_t optional = 0;  ///< of the last columns: a row may end before them, their cells are empty
    int skip = 0;         ///< lines at the beginning that are no rows
  };
  /// Reads a text without header.
  CsvReader(std::string_view text, std::string name, CsvSyntax syntax, GivenColumns columns);

  [[nodiscard]] const std::vector<std::string_view>& Header() const { return header_; }
  /// Index of a column, or nothing.
  [[nodiscard]] std::optional<size_t> Find(std::string_view column) const;
  /// Index of a column. Throws when the header does not name it.
  [[nodiscard]] size_t Column(std::string_view column) const;

  /// Goes to the next row; false at the end. Throws for a row with more or fewer cells than the
  /// header.
  bool Next();

  // Cells of the present row:
  [[nodiscard]] std::string_view Text(size_t column) const { return cells_[column]; }
  /// A finite number.
  [[nodiscard]] double Number(size_t column) const;
  /// A finite number; nothing for an empty cell.
  [[nodiscard]] std::optional<double> NumberIfAny(size_t column) const;
  [[nodiscard]] int Integer(size_t column) const;
  /// Line of the present row in the text, counted from 1.
  [[nodiscard]] int Line() const { return line_; }

  /// Throws with the place of the present row, of one of its cells, or of another line.
  [[noreturn]] void Fail(const std::string& message) const { FailAtLine(line_, message); }
  [[noreturn]] void FailAt(size_t column, const std::string& message) const;
  [[noreturn]] void FailAtLine(int line, const std::string& message) const;

 private:
  bool NextLine(std::vector<std::string_view>* cells);
  bool NextLegend(std::string_view first_column);
  std::string_view TakeLine();
  void SplitAtCommas(std::string_view line, std::vector<std::string_view>* cells);
  size_t TakeQuoted(std::string_view line, size_t begin, std::vector<std::string_view>* cells);
  void SplitAtBlanks(std::string_view line, std::vector<std::string_view>* cells) const;

  void ReadHeader(std::string_view first_column, std::string_view example);

  const std::string text_;  // of a file
  std::string name_;
  CsvSyntax syntax_;
  std::string_view rest_;        // text after the present line
  const char* begin_ = nullptr;  // of the present line
  int line_ = 0;
  GivenColumns given_;
  std::vector<std::string_view> header_, cells_;
  std::deque<std::string> unquoted_;  // texts of cells that have quotes inside
};

}  // namespace plenocal
