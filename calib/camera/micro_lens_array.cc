// SPDX-License-Identifier: Apache-2.0
#include "calib/camera/micro_lens_array.h"

#include <fmt/format.h>

#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <map>
#include <optional>

#include "calib/base/format_error.h"
#include "calib/camera/camera_model.h"
#include "calib/camera/lens_lattice.h"
#include "calib/io/csv.h"

namespace plenocal {
namespace {

// Sets rows and columns from the centres. `lines`: of the micro lenses in the file.
void IndexFromCentres(const std::filesystem::path& path,
                      const std::vector<int>& lines,
                      MicroLensArray* array) {
  std::vector<Eigen::Vector2d> centres;
  for (const MicroLens& lens : array->lenses) centres.push_back(lens.centre);
  const auto basis = FindLatticeBasis(centres, array->image_size);
  if (!basis) {
    throw InputError("{}: the centres are neither a hexagonal nor a rectangular lattice",
                     path.string());
  }
  const auto nodes = IndexLattice(centres, *basis, array->image_size);
  for (size_t i = 0; i < nodes.size(); ++i) {
    if (!nodes[i]) {
      throw InputError(
          "{}:{}: the micro lens at ({:.2f}, {:.2f}) is off the lattice of "
          "the others",
          path.string(),
          lines[i],
          centres[i].x(),
          centres[i].y());
    }
    array->lenses[i].row = nodes[i]->row;
    array->lenses[i].column = nodes[i]->column;
  }
}

// A micro lens that an array may have: its lattice is fitted to them all.
void CheckMicroLens(const CsvReader& table, const MicroLens& lens, ImageSize image_size) {
  // Lenses beyond the image do no harm, but those in the middle of it must remain neighbours.
  const int around = image_size[0] + image_size[1];
  if (!IsInside(lens.centre, image_size, around)) {
    table.Fail(fmt::format("the micro lens at ({:.6g}, {:.6g}) is far outside of the image",
                           lens.centre.x(),
                           lens.centre.y()));
  }
  constexpr int kMost = 1'000'000;  // no image has more pixels in a row
  const auto [least, most] = std::minmax(lens.row, lens.column);
  if (least < -kMost || most > kMost) {
    table.Fail(fmt::format("row {}, column {}: no array has so many", lens.row, lens.column));
  }
}

// The lattice vectors of an array from a file; a lattice that no array has is refused.
void SetLatticeOfFile(const std::filesystem::path& path, MicroLensArray* array) {
  try {
    SetLatticeVectors(array);
  } catch (const Error& error) {
    throw InputError("{}: {}", path.string(), error.what());
  }
  Eigen::Matrix2d basis;
  basis << array->e_column, array->e_row;
  // The determinant of a hexagonal lattice is sqrt(3)/2 of the lengths' product, of a rectangular
  // one all of it.
  const double product = array->e_column.norm() * array->e_row.norm();
  if (!(std::isfinite(product) && std::abs(basis.determinant()) > 0.5 * product)) {
    throw InputError("{}: rows and columns do not belong to the centres", path.string());
  }
}

}  // namespace

LatticeKind MicroLensArray::Lattice() const {
  Eigen::Matrix2d basis;
  basis << e_column, e_row;
  return KindOfLattice(basis);
}

bool HasTilt(const CameraModel& model) {
  return model.plenoptic &&
         std::ranges::find(model.params, "t_x", &Param::name) != model.params.end();
}

void SetLatticeVectors(MicroLensArray* array) {
  std::vector<LatticeMeasurement> measurements;
  for (const MicroLens& lens : array->lenses) {
    measurements.push_back({.node = {lens.column, lens.row}, .position = lens.centre});
  }
  const SmoothLattice lattice = SmoothLattice::Fit(measurements);
  const Eigen::Vector2d middle =
      lattice.Coordinates({(array->image_size[0] - 1) / 2.0, (array->image_size[1] - 1) / 2.0});
  const Eigen::Matrix2d basis = lattice.Basis(middle.x(), middle.y());
  array->e_column = basis.col(0);
  array->e_row = basis.col(1);
}

std::optional<size_t> NumberLensTypes(MicroLensArray* array) {
  std::map<int, int> numbers;
  for (size_t i = 0; i < array->lenses.size(); ++i) {
    numbers.emplace(array->lenses[i].type, 0);
    if (numbers.size() > kMostLensTypes) return i;
  }
  int count = 0;
  for (auto& [type, number] : numbers) number = count++;
  for (MicroLens& lens : array->lenses) lens.type = numbers.at(lens.type);
  array->types = count;
  return std::nullopt;
}

std::string FormatMicroLenses(const MicroLensArray& array) {
  fmt::memory_buffer text;
  fmt::format_to(std::back_inserter(text), "index,x,y,type,row,column,usable\n");
  for (size_t i = 0; i < array.lenses.size(); ++i) {
    const MicroLens& lens = array.lenses[i];
    fmt::format_to(std::back_inserter(text),
                   "{},{:.5f},{:.5f},{},{},{},{}\n",
                   i,
                   lens.centre.x(),
                   lens.centre.y(),
                   lens.type,
                   lens.row,
                   lens.column,
                   lens.usable ? 1 : 0);
  }
  return fmt::to_string(text);
}

MicroLensArray ReadMicroLenses(const std::filesystem::path& path, ImageSize image_size) {
  CsvReader table(path);
  const size_t x = table.Column("x"), y = table.Column("y"), type = table.Column("type");
  const std::optional<size_t> row = table.Find("row"), column = table.Find("column"),
                              usable = table.Find("usable");
  MicroLensArray array;
  array.image_size = image_size;
  std::vector<int> lines;
  while (table.Next()) {
    array.lenses.push_back({.row = row ? table.Integer(*row) : 0,
                            .column = column ? table.Integer(*column) : 0,
                            .centre = {table.Number(x), table.Number(y)},
                            .type = table.Integer(type),
                            .usable = !usable || table.Integer(*usable) != 0});
    CheckMicroLens(table, array.lenses.back(), image_size);
    lines.push_back(table.Line());
  }
  if (array.lenses.empty()) {
    throw InputError("{}: has no micro lenses", path.string());
  }
  if (const std::optional<size_t> lens = NumberLensTypes(&array)) {
    table.FailAtLine(lines[*lens],
                     fmt::format("lens type {} is one too many; an array has at most {} types",
                                 array.lenses[*lens].type,
                                 kMostLensTypes));
  }
  if (!row || !column) IndexFromCentres(path, lines, &array);
  SetLatticeOfFile(path, &array);
  return array;
}

}  // namespace plenocal
