// SPDX-License-Identifier: Apache-2.0
#include "apps/report/micro_lens_sections.h"

#include <cmath>
#include <unordered_map>
#include <utility>

#include "calib/base/linear_algebra.h"
#include "calib/io/csv.h"
#include "engine/json/calibration_json.h"

namespace plenocal {

using Json = nlohmann::json;

MicroLensTable::MicroLensTable(const std::string& csv, const std::string& name) {
  CsvReader table(csv, name);
  const size_t x = table.Column("x"), y = table.Column("y"), type = table.Column("type");
  const std::optional<size_t> row = table.Find("row"), column = table.Find("column");
  has_lattice_ = row && column;
  while (table.Next()) {
    lenses_.push_back({{table.Number(x), table.Number(y)},
                       table.Integer(type),
                       has_lattice_ ? table.Integer(*row) : 0,
                       has_lattice_ ? table.Integer(*column) : 0});
  }
}

std::vector<int> MicroLensTable::TypesOf(const CalibratedCamera& camera) const {
  // Both files round the same centres, to different decimals.
  constexpr double kCell = 1, kSame = 0.05;  // px
  const auto key = [](int64_t column, int64_t row) { return column * 1'000'003 + row; };
  const auto cell = [](double value) { return static_cast<int64_t>(std::floor(value / kCell)); };
  std::unordered_map<int64_t, const Lens*> places;
  for (const Lens& lens : lenses_) {
    places[key(cell(lens.centre.x()), cell(lens.centre.y()))] = &lens;
  }
  const size_t context = camera.model->measured.size();
  std::vector<int> types;
  types.reserve(camera.residuals.size());
  for (const ResidualRow& row : camera.residuals) {
    const Eigen::Vector2d seen(row.values[context], row.values[context + 1]);
    int type = -1;
    for (const int64_t dx : {0, -1, 1}) {
      for (const int64_t dy : {0, -1, 1}) {
        const auto found = places.find(key(cell(seen.x()) + dx, cell(seen.y()) + dy));
        if (found != places.end() && (found->second->centre - seen).norm() < kSame) {
          type = found->second->type;
        }
      }
    }
    types.push_back(type);
  }
  return types;
}

Json MicroLensTable::GridSection(ImageSize image_size) const {
  constexpr size_t kLeast = 6;
  if (!has_lattice_ || lenses_.size() < kLeast) return nullptr;
  // centre = offset + column * e_column + row * e_row
  const auto count = static_cast<Eigen::Index>(lenses_.size());
  Eigen::MatrixXd A(count, 3), b(count, 2);
  for (Eigen::Index i = 0; i < count; ++i) {
    const Lens& lens = lenses_[static_cast<size_t>(i)];
    A.row(i) << 1, lens.column, lens.row;
    b.row(i) = lens.centre.transpose();
  }
  const Eigen::MatrixXd fit =
      SolveSymmetric(Eigen::MatrixXd(A.transpose() * A), Eigen::MatrixXd(A.transpose() * b));
  const Eigen::MatrixXd off = b - A * fit;

  std::vector<ResidualRow> deviations;
  std::map<int, int> types;
  for (Eigen::Index i = 0; i < count; ++i) {
    deviations.push_back({.values = {b(i, 0), b(i, 1)}, .residual = {off(i, 0), off(i, 1)}});
    ++types[lenses_[static_cast<size_t>(i)].type];
  }
  Json by_type = Json::array();
  for (const auto& [type, lenses] : types) by_type.push_back({{"type", type}, {"lenses", lenses}});
  return {{"lenses", lenses_.size()},
          {"types", by_type},
          {"pitch", Short((fit.row(1).norm() + fit.row(2).norm()) / 2, 6)},
          {"rms", Short(std::sqrt(off.squaredNorm() / static_cast<double>(count)))},
          {"field", FieldJson(image_size, std::move(deviations))}};
}

}  // namespace plenocal
