// SPDX-License-Identifier: Apache-2.0
#include "calib/camera/micro_lens_array.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <Eigen/LU>
#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <numbers>
#include <optional>

#include "calib/base/format_error.h"
#include "calib/base/linear_algebra.h"
#include "calib/base/number_text.h"
#include "calib/camera/camera_model.h"
#include "calib/camera/lens_lattice.h"
#include "calib/io/csv.h"
#include "calib/io/yaml.h"

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

// True where an array's lattice vectors and the lattice fitted to its centres are as of one made.
bool IsRegular(const MicroLensArray& array, const SmoothLattice& lattice) {
  Eigen::Matrix2d basis;
  basis << array.e_column, array.e_row;
  // The area of a cell: of a hexagonal lattice sqrt(3)/2 of the lengths' product, of a rectangular
  // one all of it.
  const double cell = std::abs(basis.determinant());
  const double product = array.e_column.norm() * array.e_row.norm();
  const int longer = std::max(array.image_size[0], array.image_size[1]);
  if (!(array.Pitch() < longer && cell > 0.5 * product)) return false;
  // Odd rows that are counted from half a pitch farther scatter by a quarter of it.
  if (!(lattice.Sigma() < array.Pitch() / 8)) return false;
  // Where a row's number is left out, a cell is counted as two.
  return std::ranges::all_of(array.lenses, [&](const MicroLens& lens) {
    const double here = std::abs(lattice.Basis(lens.column, lens.row).determinant());
    return std::max(here, cell) < std::numbers::sqrt2 * std::min(here, cell);
  });
}

// The lattice vectors of an array from a file; a lattice that no array has is refused.
void SetLatticeOfFile(const std::filesystem::path& path, MicroLensArray* array) {
  try {
    if (IsRegular(*array, SetLatticeVectors(array))) return;
  } catch (const Error& error) {
    throw InputError("{}: {}", path.string(), error.what());
  }
  throw InputError("{}: rows and columns do not belong to the centres", path.string());
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

SmoothLattice SetLatticeVectors(MicroLensArray* array) {
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
  return lattice;
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

namespace {

// Terms of the polynomials of a degree at a place in an image.
Eigen::VectorXd TermsAt(const Eigen::Vector2d& position, int degree, ImageSize image_size) {
  const Eigen::Vector2d size(image_size[0], image_size[1]);
  const Eigen::Vector2d middle = (size.array() - 1) / 2;
  return SmoothLattice::Monomials((position - middle) / (size.maxCoeff() / 2), degree);
}

// The least degree with so many monomials.
int DegreeOf(Eigen::Index terms) {
  int degree = 0;
  while (SmoothLattice::CountMonomials(degree) < terms) ++degree;
  return degree;
}

LatticeErrors MakeErrors(const Eigen::MatrixXd& covariance, ImageSize image_size) {
  return {image_size, {covariance.data(), covariance.data() + covariance.size()}};
}

// Sums over the measurements in a block of nodes, by their precision.
struct Block {
  double weight = 0;
  Eigen::Vector2d residual{0, 0};
  Eigen::VectorXd terms;
};

}  // namespace

Eigen::MatrixXd LatticeErrors::Covariance() const {
  const auto terms = std::lround(std::sqrt(covariance.size()));
  return Eigen::Map<const Eigen::MatrixXd>(covariance.data(), terms, terms);
}

Eigen::MatrixXd LatticeErrors::Root() const {
  const SymmetricEigen eigen = DecomposeSymmetric(Covariance());
  return eigen.vectors * eigen.values.cwiseMax(0).cwiseSqrt().asDiagonal();
}

Eigen::VectorXd LatticeErrors::Terms(const Eigen::Vector2d& position) const {
  return TermsAt(position, DegreeOf(Covariance().rows()), image_size);
}

LatticeErrors ErrorsOfNominalGrid(ImageSize image_size) {
  constexpr double kOffset = 0.1, kScale = 1e-4;  // px; of each of scale, rotation and shears
  // Two coefficients of independent errors make each of these: their mean has half the variance.
  const double slope = std::numbers::sqrt2 * kScale * std::max(image_size[0], image_size[1]) / 2;
  const Eigen::Vector3d sigma(kOffset, slope, slope);
  return MakeErrors(sigma.cwiseAbs2().asDiagonal().toDenseMatrix(), image_size);
}

LatticeErrors ErrorsOfFit(const SmoothLattice& lattice,
                          std::span<const LatticeMeasurement> measurements,
                          ImageSize image_size) {
  constexpr size_t kFewest = 60, kMany = 300;
  constexpr int kSide = 5;  // of a block, nodes
  if (measurements.size() < kFewest) return ErrorsOfNominalGrid(image_size);
  // A lower degree that fits as well leaves out terms that are there, if small.
  const int degree = std::max(lattice.Degree(), measurements.size() < kMany ? 3 : 5);
  const int terms = SmoothLattice::CountMonomials(degree);
  Eigen::MatrixXd information = Eigen::MatrixXd::Zero(terms, terms);
  std::map<std::array<int, 2>, Block> blocks;
  double squares = 0, count = 0;
  for (const LatticeMeasurement& m : measurements) {
    const Eigen::Vector2d residual = m.position - lattice.Position(m.node.column, m.node.row);
    if (residual.norm() > SmoothLattice::kTukeyWidth * lattice.Sigma() * m.sigma) continue;
    const double weight = 1 / (m.sigma * m.sigma);
    const Eigen::VectorXd of_place = TermsAt(m.position, degree, image_size);
    information += weight * of_place * of_place.transpose();
    const auto block_of = [](int index) { return (index - (index % kSide + kSide) % kSide); };
    Block& block = blocks[{block_of(m.node.column), block_of(m.node.row)}];
    if (block.terms.size() == 0) block.terms = Eigen::VectorXd::Zero(terms);
    block.weight += weight;
    block.residual += weight * residual;
    block.terms += weight * of_place;
    squares += weight * residual.squaredNorm();
    ++count;
  }
  const Eigen::MatrixXd inverse = PseudoInverse(information);
  double of_blocks = 0, expected = 0;  // squares of sums, and these of independent errors
  for (const auto& [place, block] : blocks) {
    of_blocks += block.residual.squaredNorm();
    expected += 2 * (block.weight - block.terms.dot(inverse * block.terms));
  }
  const double variance =
      std::max(squares / (2 * (count - terms)), expected > 0 ? of_blocks / expected : 0);
  return MakeErrors(variance * inverse, image_size);
}

std::string FormatLatticeErrors(const LatticeErrors& errors) {
  if (!errors.AreKnown()) return {};
  const Eigen::MatrixXd C = errors.Covariance();
  std::string text = fmt::format("plenocal: 1\nimage_size: [{}]\ncovariance:  # px^2\n",
                                 fmt::join(errors.image_size, ", "));
  for (Eigen::Index row = 0; row < C.rows(); ++row) {
    std::vector<std::string> numbers;
    for (Eigen::Index column = 0; column <= row; ++column) {
      numbers.push_back(YamlNumber(C(row, column)));
    }
    text += fmt::format("  - [{}]\n", fmt::join(numbers, ", "));
  }
  return text;
}

LatticeErrors ReadLatticeErrors(const std::filesystem::path& path, ImageSize image_size) {
  const YamlNode root = YamlNode::ReadFile(path);
  static constexpr std::array<std::string_view, 2> kKeys{"image_size", "covariance"};
  root.CheckVersion();
  root.CheckKeys({"plenocal", kKeys[0], kKeys[1]});
  root.RequireKeys(kKeys, "image_size: [2048, 2048]\ncovariance: [[4e-6]]\n");
  const YamlNode size = root.At(kKeys[0]), covariance = root.At(kKeys[1]);
  const std::vector<double> stated = size.AsNumbers(2);
  if (stated[0] != image_size[0] || stated[1] != image_size[1]) {
    size.Fail(fmt::format("the camera's images are {} pixels: the lattice is of another array",
                          fmt::join(image_size, " x ")));
  }
  const std::vector<YamlNode> lines = covariance.Elements();
  Eigen::MatrixXd C(lines.size(), lines.size());
  for (Eigen::Index row = 0; row < C.rows(); ++row) {
    const auto count = static_cast<size_t>(row + 1);
    const std::vector<double> numbers = lines[count - 1].AsNumbers(count);
    C.row(row).head(row + 1) = Eigen::Map<const Eigen::RowVectorXd>(numbers.data(), row + 1);
    C.col(row).head(row + 1) = C.row(row).head(row + 1);
  }
  const int degree = DegreeOf(C.rows());
  if (SmoothLattice::CountMonomials(degree) != C.rows() || degree > SmoothLattice::kMaxDegree) {
    covariance.Fail("expected the lower triangle of 1, 3, 6, 10, 15, 21, 28 or 36 rows");
  }
  constexpr double kRounding = 1e-9;  // of numbers with 12 digits
  const Eigen::VectorXd spectrum = DecomposeSymmetric(C).values;
  const double largest = spectrum.cwiseAbs().maxCoeff(), side = std::max(stated[0], stated[1]);
  if (!(spectrum[0] >= -kRounding * largest && largest < side * side)) {
    covariance.Fail("expected px^2: no negative variance, and no error as large as the image");
  }
  return MakeErrors(C, image_size);
}

}  // namespace plenocal
