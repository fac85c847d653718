// SPDX-License-Identifier: Apache-2.0
//
// Chessboard corners of mrcal's corners.vnl, a table with blanks between the columns. The corners
// of an image count from 0 in the order of the lines, which is plenocal's order of a chessboard
// (rows of equal y one after another). `level` (each halves the resolution) and `weight` become
// sigmas relative to 1 px at full resolution; corners with "-" or a weight that is not positive are
// left out, as mrcal does.
#include <fmt/format.h>

#include <cmath>
#include <map>
#include <optional>
#include <string>

#include "calib/base/quoted_text.h"
#include "calib/io/csv.h"
#include "calib/io/input_file.h"
#include "engine/formats/import_format.h"

namespace plenocal {
namespace {

bool IsEmpty(const CsvReader& table, size_t column) { return table.Text(column) == "-"; }

/// Weights of corners, relative to one at full resolution.
class Weights {
 public:
  explicit Weights(const CsvReader& table)
      : level_(table.Find("level")), weight_(table.Find("weight")) {}

  /// The weight of the present row; not positive: the row is left out.
  [[nodiscard]] double Read(const CsvReader& table) const {
    const std::optional<size_t> column = level_ ? level_ : weight_;
    if (!column) return 1;
    if (IsEmpty(table, *column)) return 0;
    const double value = table.Number(*column), weight = level_ ? std::exp2(-value) : value;
    if (std::isinf(weight) || (weight > 0 && std::isinf(1 / weight)) || (level_ && weight == 0)) {
      table.FailAt(*column, fmt::format("no corner has {}", value));
    }
    return weight;
  }

 private:
  std::optional<size_t> level_, weight_;
};

/// The frame of an image. Two images of one name are refused.
std::string FrameOf(const std::string& file,
                    const CsvReader& table,
                    std::map<std::string, std::string>* files) {
  std::string frame = std::filesystem::path(file).stem().string();
  if (const auto defect = FrameNameDefect(frame)) table.Fail("the image's name " + *defect);
  if (const std::string& other = files->emplace(frame, file).first->second; other != file) {
    table.Fail(fmt::format(
        "'{}' and '{}' would both be frame '{}'; import the images of one camera at a time",
        other,
        file,
        frame));
  }
  return frame;
}

ImportedFile ReadCornersVnl(const ImportSource& source) {
  const std::string text = ReadTextFile(source.path);
  CsvReader table(
      text, source.path.string(), CsvSyntax::kVnlog, "filename", "# filename x y level");
  const size_t name = table.Column("filename"), x = table.Column("x"), y = table.Column("y");
  const Weights weights(table);
  std::map<std::string, int> next;           // per image: marker of its next row
  std::map<std::string, std::string> files;  // per frame: its image
  std::string csv = "frame,marker,x,y,sigma\n";
  while (table.Next()) {
    const std::string file(table.Text(name));
    const int marker = next[file]++;
    // mrcal writes one line "file - - -" for an image without target.
    if (IsEmpty(table, x) || IsEmpty(table, y)) continue;
    const double weight = weights.Read(table);
    if (!(weight > 0)) continue;
    for (const size_t column : {x, y}) static_cast<void>(table.Number(column));
    csv += fmt::format("{},{},{},{},{}\n",
                       CsvCell(FrameOf(file, table, &files)),
                       marker,
                       table.Text(x),
                       table.Text(y),
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
