// SPDX-License-Identifier: Apache-2.0
//
// Chessboard corners of mrcal's corners.vnl, a table with blanks between the columns. The corners
// of an image count from 0 in the order of the lines, which is plenocal's order of a chessboard
// (rows of equal y one after another). `level` (each halves the resolution) and `weight` become
// sigmas relative to 1 px at full resolution; corners with "-" or a weight that is not positive are
// left out, as mrcal does.
#include <fmt/format.h>

#include <charconv>
#include <cmath>
#include <map>
#include <sstream>
#include <string>
#include <vector>

#include "apps/formats/import_format.h"
#include "calib/base/error.h"
#include "calib/base/input_file.h"

namespace plenocal {
namespace {

std::vector<std::string> Words(const std::string& line) {
  std::istringstream stream(line);
  std::vector<std::string> words;
  for (std::string word; stream >> word;) words.push_back(word);
  return words;
}

/// Goes through the rows of the table; all members throw `Error` of kind kInput with file and line.
class VnlTable {
 public:
  explicit VnlTable(const std::filesystem::path& path)
      : path_(path.string()), text_(ReadTextFile(path)) {}

  /// Moves to the next row; false after the last.
  bool Next() {
    for (std::string line; std::getline(text_, line);) {
      ++line_;
      words_ = Words(line);
      if (words_.empty() || words_[0].starts_with("##") || words_[0].starts_with("#!")) continue;
      if (words_[0].starts_with('#')) {
        ReadHeader();
        continue;
      }
      if (columns_.empty()) Fail("expected the line '# filename x y level' first");
      if (words_.size() != columns_.size()) {
        Fail(fmt::format("expected {} columns, found {}", columns_.size(), words_.size()));
      }
      return true;
    }
    return false;
  }

  [[nodiscard]] bool Has(const std::string& column) const { return columns_.contains(column); }
  [[nodiscard]] const std::string& Text(const std::string& column) const {
    return words_[columns_.at(column)];
  }
  [[nodiscard]] bool IsEmpty(const std::string& column) const { return Text(column) == "-"; }

  [[nodiscard]] double Number(const std::string& column) const {
    const std::string& word = Text(column);
    double value = 0;
    const char* const end = word.data() + word.size();
    const auto [after, error] = std::from_chars(word.data(), end, value);
    if (error != std::errc() || after != end || !std::isfinite(value)) {
      Fail(fmt::format("expected a number, found '{}'", word));
    }
    return value;
  }

  [[noreturn]] void Fail(const std::string& message) const {
    throw Error(ErrorKind::kInput, fmt::format("{}:{}: {}", path_, line_, message));
  }

 private:
  /// The first line with a single '#' names the columns, as in all vnlog files; a comment does not.
  void ReadHeader() {
    words_[0].erase(0, 1);
    if (words_[0].empty()) words_.erase(words_.begin());
    if (!columns_.empty() || words_.empty() || words_[0] != "filename") return;
    for (size_t i = 0; i < words_.size(); ++i) columns_[words_[i]] = i;
    for (const char* needed : {"x", "y"}) {
      if (!columns_.contains(needed)) Fail(fmt::format("column '{}' is missing", needed));
    }
  }

  std::string path_;
  std::istringstream text_;
  int line_ = 0;
  std::map<std::string, size_t> columns_;
  std::vector<std::string> words_;
};

/// Weight of a corner, relative to one at full resolution; not positive: left out.
double Weight(const VnlTable& table) {
  if (table.Has("level")) return table.IsEmpty("level") ? 0 : std::exp2(-table.Number("level"));
  if (table.Has("weight")) return table.IsEmpty("weight") ? 0 : table.Number("weight");
  return 1;
}

ImportedFile ReadCornersVnl(const ImportSource& source) {
  VnlTable table(source.path);
  std::map<std::string, int> next;  // per image: marker of its next row
  std::string csv = "frame,marker,x,y,sigma\n";
  while (table.Next()) {
    const std::string& file = table.Text("filename");
    const int marker = next[file]++;
    // mrcal writes one line "file - - -" for an image without target.
    if (table.IsEmpty("x") || table.IsEmpty("y")) continue;
    const double weight = Weight(table);
    if (!(weight > 0)) continue;
    for (const char* column : {"x", "y"}) static_cast<void>(table.Number(column));
    csv += fmt::format("{},{},{},{},{}\n",
                       std::filesystem::path(file).stem().string(),
                       marker,
                       table.Text("x"),
                       table.Text("y"),
                       1 / weight);
  }
  if (next.empty()) table.Fail("holds no corners");
  return {.content = csv, .message = {}};
}

}  // namespace

ImportFormat MrcalCornersFormat() {
  return {.name = "mrcal-corners",
          .source = "corners.vnl",
          .result = "detections_<file>.csv",
          .read = ReadCornersVnl};
}

}  // namespace plenocal
