// SPDX-License-Identifier: Apache-2.0
#include "calib/micro_lens_array.h"

#include <fmt/format.h>

#include <Eigen/LU>
#include <array>
#include <charconv>
#include <cmath>
#include <fstream>
#include <map>
#include <optional>
#include <set>
#include <sstream>
#include <string_view>

#include "calib/error.h"
#include "calib/hexagonal_lattice.h"

namespace plenocal {
namespace {

/// Sets rows, columns and the lattice vectors from the centres.
void IndexFromCentres(const std::filesystem::path& path, MicroLensArray* array) {
  std::vector<Eigen::Vector2d> centres;
  for (const MicroLens& lens : array->lenses) centres.push_back(lens.centre);
  const auto basis = FindLatticeBasis(centres, array->image_size);
  if (!basis) {
    throw Error(ErrorKind::kInput,
                fmt::format("{}: the centres are no hexagonal lattice", path.string()));
  }
  const auto nodes = IndexLattice(centres, *basis, array->image_size);
  for (size_t i = 0; i < nodes.size(); ++i) {
    if (!nodes[i]) {
      throw Error(ErrorKind::kInput,
                  fmt::format("{}:{}: the micro lens at ({:.2f}, {:.2f}) is off the lattice of the "
                              "others",
                              path.string(),
                              i + 2,
                              centres[i].x(),
                              centres[i].y()));
    }
    array->lenses[i].row = nodes[i]->row;
    array->lenses[i].column = nodes[i]->column;
  }
}

std::vector<std::string> Split(const std::string& line) {
  std::vector<std::string> cells;
  std::stringstream stream(line);
  std::string cell;
  while (std::getline(stream, cell, ',')) {
    const size_t begin = cell.find_first_not_of(" \t\r");
    const size_t end = cell.find_last_not_of(" \t\r");
    cells.push_back(begin == std::string::npos ? "" : cell.substr(begin, end - begin + 1));
  }
  return cells;
}

}  // namespace

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
  std::ifstream file(path);
  if (!file) {
    throw Error(ErrorKind::kInput,
                fmt::format("{}: cannot be opened; check the path", path.string()));
  }
  std::string line;
  std::getline(file, line);
  std::map<std::string, size_t> columns;
  const std::vector<std::string> header = Split(line);
  for (size_t i = 0; i < header.size(); ++i) columns[header[i]] = i;
  for (const char* needed : {"x", "y", "type"}) {
    if (!columns.contains(needed)) {
      throw Error(ErrorKind::kInput,
                  fmt::format("{}:1: expected a header with the columns index,x,y,type, found '{}'",
                              path.string(),
                              line));
    }
  }

  MicroLensArray array;
  array.image_size = image_size;
  std::set<int> types;
  for (int number = 2; std::getline(file, line); ++number) {
    if (line.find_first_not_of(" \t\r") == std::string::npos) continue;
    const std::vector<std::string> cells = Split(line);
    // The value of a column; `fallback` where the file does not have it.
    const auto value = [&](const std::string& name, double fallback) {
      const auto column = columns.find(name);
      if (column == columns.end()) return fallback;
      double parsed = 0;
      const std::string cell = column->second < cells.size() ? cells[column->second] : "";
      const auto [end, code] = std::from_chars(cell.data(), cell.data() + cell.size(), parsed);
      if (code != std::errc() || end != cell.data() + cell.size() || !std::isfinite(parsed)) {
        throw Error(
            ErrorKind::kInput,
            fmt::format(
                "{}:{}: {}: expected a number, found '{}'", path.string(), number, name, cell));
      }
      return parsed;
    };
    array.lenses.push_back({.row = static_cast<int>(value("row", 0)),
                            .column = static_cast<int>(value("column", 0)),
                            .centre = {value("x", 0), value("y", 0)},
                            .type = static_cast<int>(value("type", 0)),
                            .usable = value("usable", 1) != 0});
    types.insert(array.lenses.back().type);
    if (array.lenses.back().type < 0) {
      throw Error(ErrorKind::kInput,
                  fmt::format("{}:{}: type: expected 0 or more", path.string(), number));
    }
  }
  if (array.lenses.empty()) {
    throw Error(ErrorKind::kInput, fmt::format("{}: has no micro lenses", path.string()));
  }
  array.types = *types.rbegin() + 1;
  if (!columns.contains("row") || !columns.contains("column")) IndexFromCentres(path, &array);
  SetLatticeVectors(&array);
  return array;
}

}  // namespace plenocal
