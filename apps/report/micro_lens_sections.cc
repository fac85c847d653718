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

namespace {

double PitchOf(const Eigen::MatrixXd& lattice) {
  return (lattice.row(1).norm() + lattice.row(2).norm()) / 2;
}

}  // namespace

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

bool MicroLensTable::HasLattice() const {
  constexpr size_t kLeast = 6;
  return has_lattice_ && lenses_.size() >= kLeast;
}

Eigen::MatrixXd MicroLensTable::Lattice(Eigen::MatrixXd* off) const {
  const auto count = static_cast<Eigen::Index>(lenses_.size());
  Eigen::MatrixXd A(count, 3), b(count, 2);
  for (Eigen::Index i = 0; i < count; ++i) {
    const Lens& lens = lenses_[static_cast<size_t>(i)];
    A.row(i) << 1, lens.column, lens.row;
    b.row(i) = lens.centre.transpose();
  }
  Eigen::MatrixXd fit =
      SolveSymmetric(Eigen::MatrixXd(A.transpose() * A), Eigen::MatrixXd(A.transpose() * b));
  if (off != nullptr) *off = b - A * fit;
  return fit;
}

MicroLensVisibility MicroLensTable::Visibility(ImageSize image_size) const {
  std::vector<Eigen::Vector2d> centres;
  for (const Lens& lens : lenses_) centres.push_back(lens.centre);
  return {image_size, PitchOf(Lattice(nullptr)), std::move(centres)};
}

Json MicroLensTable::GridSection(ImageSize image_size) const {
  if (!HasLattice()) return nullptr;
  Eigen::MatrixXd off;
  const Eigen::MatrixXd fit = Lattice(&off);
  std::vector<ResidualRow> deviations;
  std::map<int, int> types;
  for (size_t i = 0; i < lenses_.size(); ++i) {
    const auto row = static_cast<Eigen::Index>(i);
    const Eigen::Vector2d& centre = lenses_[i].centre;
    deviations.push_back(
        {.values = {centre.x(), centre.y()}, .residual = {off(row, 0), off(row, 1)}});
    ++types[lenses_[i].type];
  }
  Json by_type = Json::array();
  for (const auto& [type, lenses] : types) by_type.push_back({{"type", type}, {"lenses", lenses}});
  return {{"lenses", lenses_.size()},
          {"types", by_type},
          {"pitch", Short(PitchOf(fit), 6)},
          {"rms", Short(std::sqrt(off.squaredNorm() / static_cast<double>(lenses_.size())))},
          {"field", FieldJson(image_size, std::move(deviations))}};
}

}  // namespace plenocal
