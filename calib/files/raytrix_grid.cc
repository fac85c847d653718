// SPDX-License-Identifier: Apache-2.0
#include "calib/files/raytrix_grid.h"

#include <fmt/format.h>

#include <Eigen/Geometry>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <map>
#include <numbers>
#include <optional>
#include <pugixml.hpp>
#include <string>
#include <string_view>
#include <utility>

#include "calib/base/format_error.h"
#include "calib/base/number_text.h"
#include "calib/camera/lens_lattice.h"
#include "calib/io/input_file.h"

namespace plenocal {
namespace {

using Eigen::Matrix2d;
using Eigen::Vector2d;

[[noreturn]] void Refuse(const std::filesystem::path& path, const std::string& reason) {
  throw InputError("{}: {}", path.string(), reason);
}

double Number(const std::filesystem::path& path, const pugi::xml_node& parent, const char* name) {
  const std::optional<double> value = ParseDouble(parent.child(name).text().get());
  if (!value || !std::isfinite(*value)) {
    Refuse(path, fmt::format("<{}>: <{}>: expected a number", parent.name(), name));
  }
  return *value;
}

/// Element `name` with its children x and y, y turned down.
Vector2d Point(const std::filesystem::path& path, const pugi::xml_node& parent, const char* name) {
  const pugi::xml_node node = parent.child(name);
  if (!node) Refuse(path, fmt::format("<{}> has no <{}>", parent.name(), name));
  return {Number(path, node, "x"), -Number(path, node, "y")};
}

pugi::xml_node Load(const std::filesystem::path& path, pugi::xml_document* document) {
  const pugi::xml_parse_result parsed =
      document->load_string(ReadTextFile(path, InputLimit::kDocument).c_str(),
                            pugi::parse_default | pugi::parse_trim_pcdata);
  if (!parsed) {
    Refuse(path,
           fmt::format("cannot be read as XML: {}; expected a calibration file of RxLive",
                       parsed.description()));
  }
  const pugi::xml_node root = document->child("RayCalibData");
  if (!root) Refuse(path, "has no <RayCalibData>; expected a calibration file of RxLive");
  return root;
}

// Each type is one of the three interleaved sets: its number by `kThreeInterleaved`.
using TypeOfColour = std::map<int, int>;

// `to_nodes` maps an offset in the file to lattice coordinates.
TypeOfColour ReadTypes(const std::filesystem::path& path,
                       const pugi::xml_node& root,
                       const Matrix2d& to_nodes) {
  TypeOfColour type_of_colour;
  for (const pugi::xml_node& type : root.children("lens_type")) {
    const Vector2d node = to_nodes * Point(path, type, "offset");
    constexpr double kFarthest = 1000;  // lenses
    if (!(node.norm() < kFarthest)) Refuse(path, "<lens_type>: <offset>: is no neighbouring lens");
    const std::optional<int> id = ParseInt(type.attribute("id").value());
    if (!id) Refuse(path, "<lens_type>: id: expected a whole number");
    type_of_colour[kThreeInterleaved.Set(
        {static_cast<int>(std::lround(node.x())), static_cast<int>(std::lround(node.y()))})] = *id;
  }
  if (type_of_colour.size() != 1 && type_of_colour.size() != 3) {
    Refuse(path,
           fmt::format("has {} interleaved <lens_type>s; expected 1 or 3", type_of_colour.size()));
  }
  return type_of_colour;
}

// Adds all micro lenses of the lattice whose centres lie in the image.
void FillImage(const Vector2d& origin,
               const Matrix2d& basis,
               const TypeOfColour& type_of_colour,
               MicroLensArray* array) {
  const ImageSize image_size = array->image_size;
  // Lattice coordinates of the image's corners bound those of all micro lenses.
  Vector2d low(1e9, 1e9), high = -low;
  for (const double x : {-0.5, image_size[0] - 0.5}) {
    for (const double y : {-0.5, image_size[1] - 0.5}) {
      const Vector2d corner = basis.inverse() * (Vector2d(x, y) - origin);
      low = low.cwiseMin(corner);
      high = high.cwiseMax(corner);
    }
  }
  for (int row = static_cast<int>(std::floor(low.y())); row <= high.y(); ++row) {
    for (int column = static_cast<int>(std::floor(low.x())); column <= high.x(); ++column) {
      const Vector2d centre = origin + basis * Vector2d(column, row);
      if (!IsInside(centre, image_size)) continue;
      const int colour = array->types == 1 ? 0 : kThreeInterleaved.Set({column, row});
      array->lenses.push_back({.row = row,
                               .column = column,
                               .centre = centre,
                               .type = array->types == 1 ? 0 : type_of_colour.at(colour)});
    }
  }
}

/// centre = origin + basis (column, row) by least squares.
struct RegularLattice {
  Vector2d origin{0, 0};
  Matrix2d basis;

  explicit RegularLattice(const MicroLensArray& array) {
    Eigen::Matrix3d normal = Eigen::Matrix3d::Zero();
    Eigen::Matrix<double, 3, 2> right = Eigen::Matrix<double, 3, 2>::Zero();
    for (const MicroLens& lens : array.lenses) {
      const Eigen::Vector3d row(1, lens.column, lens.row);
      normal += row * row.transpose();
      right += row * lens.centre.transpose();
    }
    const Eigen::Matrix<double, 3, 2> solved = normal.inverse() * right;
    origin = solved.row(0);
    basis = solved.bottomRows<2>().transpose();
  }
};

std::string PointXml(std::string_view name, std::string_view units, const Vector2d& p, int indent) {
  const std::string space(static_cast<size_t>(indent), ' ');
  return fmt::format(
      "{0}<{1} units=\"{2}\">\n{0}  <x>{3:.12f}</x>\n{0}  <y>{4:.12f}</y>\n{0}</{1}>\n",
      space,
      name,
      units,
      p.x(),
      -p.y());  // y up
}

/// The type of each interleaved set; nothing where types are arranged otherwise.
std::optional<TypeOfColour> TypesOfSets(const MicroLensArray& array) {
  TypeOfColour type_of_colour;
  for (const MicroLens& lens : array.lenses) {
    const int set = array.types == 1 ? 0 : kThreeInterleaved.Set({lens.column, lens.row});
    if (type_of_colour.emplace(set, lens.type).first->second != lens.type) return std::nullopt;
  }
  if (array.types != 1 && array.types != 3) return std::nullopt;
  return type_of_colour;
}

/// Steps (column, row) of the bases of a lattice in a file of RxLive: those nearest to the x axis
/// or, of a lattice turned by more than 15 degrees from it, those nearest to the y axis.
struct RaytrixBases {
  Eigen::Matrix2i steps = Eigen::Matrix2i::Identity();
  double along = 0;  // of base x, rad, y up

  explicit RaytrixBases(const Matrix2d& basis) {
    const double rotation = -std::atan2(basis(1, 0), basis(0, 0));
    if (std::abs(rotation) < std::numbers::pi / 12) return;
    along = std::numbers::pi / 2;
    if (rotation > 0) {
      steps << 1, 1, -1, 0;
    } else {
      steps << 0, 1, -1, -1;
    }
  }
};

std::string TypesXml(const TypeOfColour& type_of_colour,
                     const MicroLens& middle,
                     const Eigen::Vector2i& step,
                     const Vector2d& base_x) {
  std::map<int, Vector2d> offsets;
  for (const int steps : {0, 1, -1}) {
    const int set =
        kThreeInterleaved.Set({middle.column + steps * step.x(), middle.row + steps * step.y()});
    offsets.emplace(type_of_colour.size() == 1 ? 0 : type_of_colour.at(set),
                    static_cast<double>(steps) * base_x);
  }
  std::string text;
  for (const auto& [type, offset] : offsets) {
    text += fmt::format("  <lens_type id=\"{}\">\n", type);
    text += PointXml("offset", "lens", offset, 4);
    text +=
        "    <depth_range units=\"virtual_depth\">\n      <min>1</min>\n      <max>100</max>\n"
        "    </depth_range>\n  </lens_type>\n";
  }
  return text;
}

}  // namespace

std::string RayCalibDataXml(const MicroLensArray& array) {
  if (array.Lattice() != LatticeKind::kHexagonal) {
    throw InputError("RayCalibData holds hexagonal lattices, this one is rectangular");
  }
  const std::optional<TypeOfColour> type_of_colour = TypesOfSets(array);
  if (!type_of_colour) {
    throw InputError(
        "RayCalibData holds arrays of one lens type or of three interleaved "
        "ones; this one has {} in another pattern",
        array.types);
  }
  const RegularLattice lattice(array);
  const RaytrixBases raytrix(lattice.basis);
  const Vector2d image_middle((array.image_size[0] - 1) / 2.0, (array.image_size[1] - 1) / 2.0);
  const auto offset = [&](const MicroLens& lens) -> Vector2d {
    return lattice.origin + lattice.basis * Vector2d(lens.column, lens.row) - image_middle;
  };
  const MicroLens& middle = *std::ranges::min_element(array.lenses, {}, [&](const MicroLens& lens) {
    return std::pair(lens.type, offset(lens).norm());
  });
  const Matrix2d neighbours = lattice.basis * raytrix.steps.cast<double>();
  const double diameter = neighbours.col(0).norm();
  // The bases are along an axis; <rotation> is the whole angle.
  const double rotation = -std::atan2(neighbours(1, 0), neighbours(0, 0));
  const Matrix2d bases = Eigen::Rotation2Dd(rotation - raytrix.along) * neighbours / diameter;
  return fmt::format("<RayCalibData version=\"1.0\">\n{}",
                     PointXml("offset", "pix", offset(middle), 2)) +
         fmt::format("  <diameter units=\"pix\">{:.12f}</diameter>\n", diameter) +
         fmt::format("  <rotation units=\"rad\">{:.12f}</rotation>\n", rotation) +
         "  <lens_border units=\"pix\">1</lens_border>\n  <tcp units=\"virtual_depth\">2</tcp>\n" +
         PointXml("lens_base_x", "lens", bases.col(0), 2) +
         PointXml("lens_base_y", "lens", bases.col(1), 2) +
         PointXml("sub_grid_base", "lens", 2 * (bases.col(0) + bases.col(1)), 2) +
         "  <distortion type=\"radial\">\n    <function>constant</function>\n"
         "    <parameter count=\"0\">0</parameter>\n" +
         PointXml("offset", "pix", {0, 0}, 4) + "  </distortion>\n" +
         TypesXml(*type_of_colour, middle, raytrix.steps.col(0), bases.col(0)) +
         "</RayCalibData>\n";
}

std::string UnusedRayCalibData(const std::filesystem::path& path) {
  pugi::xml_document document;
  const std::string function = Load(path, &document).child("distortion").child_value("function");
  if (function.empty() || function == "constant") return "";
  return fmt::format(
      "{}: its lens distortion ({}) is not used, as the file does not state in what unit the radius "
      "is; micro-image centres towards the border may be off by some px, which white images alone "
      "do not suffer",
      path.string(),
      function);
}

MicroLensArray ReadRayCalibData(const std::filesystem::path& path, ImageSize image_size) {
  pugi::xml_document document;
  const pugi::xml_node root = Load(path, &document);
  const double diameter = Number(path, root, "diameter");
  constexpr double kLeast = 4;  // px: a smaller micro image shows nothing, and many fill the memory
  if (!(diameter >= kLeast)) {
    Refuse(path, fmt::format("<diameter>: expected at least {} pixels", kLeast));
  }
  constexpr double kFewest = 4;  // micro lenses along the shorter side, for a lattice through them
  if (const int side = std::min(image_size[0], image_size[1]); diameter > side / kFewest) {
    Refuse(path,
           fmt::format("<diameter>: {:.6g} px, expected at most a quarter of the image's shorter "
                       "side ({} px)",
                       diameter,
                       side));
  }
  // Before `bases` is filled: Eigen's assertions want all of it, also while an error is thrown.
  const Vector2d base_x = Point(path, root, "lens_base_x");
  const Vector2d base_y = Point(path, root, "lens_base_y");
  Matrix2d bases;
  bases << base_x, base_y;
  // With y down, angles turn the other way.
  const double sixty = std::numbers::pi / 3;
  const double angle = -Number(path, root, "rotation");
  const double lacking = std::remainder(angle - std::atan2(bases(1, 0), bases(0, 0)), sixty);
  const Matrix2d to_px = diameter * Eigen::Rotation2Dd(lacking).toRotationMatrix();
  bases = to_px * bases;
  // Neighbours in a hexagonal lattice: the lenses' distance long, 60 or 120 degrees apart.
  constexpr double kTolerance = 0.1;  // of the distance, and of the angle's cosine
  const Vector2d lengths = bases.colwise().norm() / diameter;
  const double cosine = base_x.dot(base_y) / (base_x.norm() * base_y.norm());
  if (!((lengths.array() - 1).abs().maxCoeff() < kTolerance) ||
      !(std::abs(std::abs(cosine) - 0.5) < kTolerance)) {
    Refuse(path, "<lens_base_x> and <lens_base_y> span no hexagonal lattice");
  }
  const Matrix2d basis = CanonicalLatticeBasis(bases);
  // The offset of the lens at the middle of the image.
  const Vector2d offset = Point(path, root, "offset");
  if (!(offset.norm() < image_size[0] + image_size[1])) {
    Refuse(path,
           fmt::format(
               "<offset>: ({:.6g}, {:.6g}) px is outside of the image", offset.x(), -offset.y()));
  }
  const Vector2d origin = Vector2d((image_size[0] - 1) / 2.0, (image_size[1] - 1) / 2.0) + offset;

  const TypeOfColour type_of_colour = ReadTypes(path, root, basis.inverse() * to_px);
  MicroLensArray array;
  array.image_size = image_size;
  array.types = static_cast<int>(type_of_colour.size());
  array.e_column = basis.col(0);
  array.e_row = basis.col(1);
  FillImage(origin, basis, type_of_colour, &array);
  if (array.lenses.empty()) Refuse(path, "no micro lens lies in the image");
  NumberLensTypes(&array);
  array.errors = ErrorsOfNominalGrid(image_size);
  return array;
}

}  // namespace plenocal
