// SPDX-License-Identifier: Apache-2.0
#include "engine/formats/lenses/cahvor.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <Eigen/Geometry>
#include <Eigen/LU>
#include <algorithm>
#include <array>
#include <cmath>
#include <deque>

#include "calib/base/format_error.h"
#include "calib/base/number_text.h"
#include "engine/formats/lens_form.h"
#include "models/formula/model.h"

namespace plenocal {
namespace {

// The lenses of CAHVOR. Coefficients: k_1 k_2 tau_x tau_y alpha_s e_0 e_1 e_2, as of CAHVORE.
const LensTable& CahvorLenses() {
  static const LensTable kTable{
      "cahvor",
      {{"pinhole", "cahvor", "0 0 0 0 0 0 0 0"},
       {"pinhole-radial3", "cahvor", "A_0 A_1 0 0 0 0 0 0"},
       {"pinhole-radial3+tilt", "cahvor", "A_0 A_1 tau_x tau_y 0 0 0 0"},
       {"pinhole-radial3+tilt+skew", "cahvor", "A_0 A_1 tau_x tau_y alpha_s 0 0 0"}}};
  return kTable;
}

struct CahvorePart {
  std::string_view name;
  size_t first;  // of its parameters, among the coefficients
  std::vector<std::string> symbols;
};

// The lenses of CAHVORE: one of a linearity, alone and with each choice of parts, fewest first.
class CahvoreLenses {
 public:
  explicit CahvoreLenses(const std::string& lens) : table_{"cahvor", {}} {
    static const std::array<CahvorePart, 4> kParts{{{"pupil", 5, {"e_0", "e_1", "e_2"}},
                                                    {"radial2", 0, {"k_1", "k_2"}},
                                                    {"tilt", 2, {"tau_x", "tau_y"}},
                                                    {"skew", 4, {"alpha_s"}}}};
    for (unsigned chosen = 0; chosen < 1U << kParts.size(); ++chosen) {
      std::string& model = texts_.emplace_back(lens);
      std::vector<std::string> symbols(8, "0");
      for (size_t i = 0; i < kParts.size(); ++i) {
        if ((chosen >> i & 1U) == 0) continue;
        model += fmt::format("+{}", kParts[i].name);
        std::ranges::copy(kParts[i].symbols,
                          symbols.begin() + static_cast<std::ptrdiff_t>(kParts[i].first));
      }
      const std::string& order = texts_.emplace_back(fmt::format("{}", fmt::join(symbols, " ")));
      table_.forms.emplace_back(model, "cahvore", order);
    }
    std::ranges::stable_sort(
        table_.forms, {}, [](const LensForm& form) { return std::ranges::count(form.model, '+'); });
  }

  [[nodiscard]] const LensTable& Table() const { return table_; }

 private:
  std::deque<std::string> texts_;  // of the table
  LensTable table_;
};

struct LensWithLinearity {
  double linearity;
  std::string_view model;
};
constexpr std::array kLensesWithLinearity{LensWithLinearity{1, "pinhole"},
                                          LensWithLinearity{0, "equidistant"},
                                          LensWithLinearity{-0.5, "equisolid"},
                                          LensWithLinearity{-1, "orthographic"}};
constexpr std::string_view kFormulaPrefix = "linearity-";

// The inverse, of the lens of a model with parts.
std::optional<double> LinearityOf(std::string_view model) {
  const std::string_view lens = model.substr(0, model.find('+'));
  for (const LensWithLinearity& each : kLensesWithLinearity) {
    if (each.model == lens) return each.linearity;
  }
  if (!lens.starts_with(kFormulaPrefix)) return std::nullopt;
  std::string number(lens.substr(kFormulaPrefix.size()));
  std::ranges::replace(number, 'p', '.');
  std::ranges::replace(number, 'm', '-');
  return ParseDouble(number);
}

/// The part `tilt` as a homography; its last row is that of a rotation.
Eigen::Matrix3d TiltMatrix(double tau_x, double tau_y) {
  const double cx = std::cos(tau_x), sx = std::sin(tau_x), cy = std::cos(tau_y),
               sy = std::sin(tau_y);
  Eigen::Matrix3d R, P;
  R << cy, sy * sx, -sy * cx, 0, cx, sx, sy, -cy * sx, cy * cx;
  P << R(2, 2), 0, -R(0, 2), 0, R(2, 2), -R(1, 2), 0, 0, 1;
  return P * R;
}

/// A homography as an upper triangle after a tilt.
struct TiltedMatrix {
  Eigen::Matrix3d K;
  double tau_x = 0, tau_y = 0;
};

TiltedMatrix SplitTilt(const Eigen::Matrix3d& homography) {
  TiltedMatrix split;
  const double norm = homography.row(2).norm();
  const Eigen::Vector3d n = homography.row(2) / norm;
  split.tau_y = std::asin(n.x());
  split.tau_x = std::atan2(-n.y(), n.z());
  split.K = homography * TiltMatrix(split.tau_x, split.tau_y).inverse() / norm;
  return split;
}

}  // namespace

std::string LensOfLinearity(double linearity, const std::string& where) {
  for (const LensWithLinearity& lens : kLensesWithLinearity) {
    if (lens.linearity == linearity) return std::string(lens.model);
  }
  if (!(std::abs(linearity) < 1)) {
    throw InputError("{}: linearity {}: expected -1 to 1", where, linearity);
  }
  const std::string size = fmt::format("{}", std::abs(linearity));
  std::string name = fmt::format("{}{}{}", kFormulaPrefix, linearity < 0 ? "m" : "", size);
  std::ranges::replace(name, '.', 'p');
  const YamlNode formula =
      YamlNode::Parse(fmt::format("source: Gennery, CAHVORE with linearity {}\n"
                                  "radius: {}({}*theta)/{}\ndomain: [{}*theta < pi/2]\n",
                                  linearity,
                                  linearity > 0 ? "tan" : "sin",
                                  size,
                                  size,
                                  size),
                      where);
  AddFormulaModel(name, formula, where);
  return name;
}

CalibratedCamera FromCahvor(const Cahvor& cahvor, ImageSize image_size, const std::string& where) {
  const double scale = 1 + cahvor.R[0];
  const Eigen::Vector3d A = cahvor.HVA.row(2);
  if (!(scale > 0)) throw InputError("{}: R: expected a first number above -1", where);
  if (!(A.norm() > 0 && cahvor.O.norm() > 0 && A.dot(cahvor.O) > 0 &&
        cahvor.HVA.determinant() > 0)) {
    throw InputError("{}: A, H, V and O are no camera", where);
  }
  // Columns: the axes of a frame with z along O, of which x is near that of the image.
  const Eigen::Vector3d z = cahvor.O.normalized();
  const Eigen::Vector3d y = z.cross(Eigen::Vector3d(cahvor.HVA.row(0).cross(A).cross(A) * -1));
  Eigen::Matrix3d axes;
  axes << y.normalized().cross(z), y.normalized(), z;
  // The rotation about O that makes K an upper triangle; the tilt changes a little with it.
  constexpr int kMost = 100;
  TiltedMatrix split;
  for (int i = 0; i < kMost; ++i) {
    split = SplitTilt(cahvor.HVA * axes * Eigen::Vector3d(scale, scale, 1).asDiagonal());
    const double phi = std::atan2(split.K(1, 0), split.K(1, 1));
    if (std::abs(phi) < 1e-16) break;
    axes *= Eigen::AngleAxisd(-phi, Eigen::Vector3d::UnitZ()).matrix();
  }
  const Eigen::Matrix3d& K = split.K;
  Lens lens{"cahvor",
            K(0, 0),
            K(1, 1),
            K(0, 2),
            K(1, 2),
            {cahvor.R[1] / scale,
             cahvor.R[2] / scale,
             split.tau_x,
             split.tau_y,
             K(0, 1) / K(0, 0),
             cahvor.E[0],
             cahvor.E[1],
             cahvor.E[2]}};
  CalibratedCamera camera;
  if (cahvor.linearity) {
    lens.name = "cahvore";
    const CahvoreLenses lenses(LensOfLinearity(*cahvor.linearity, where));
    camera = FromLens(lens, image_size, lenses.Table(), where);
  } else {
    camera = FromLens(lens, image_size, CahvorLenses(), where);
  }
  camera.T_camera_rig = {axes.transpose(), -(axes.transpose() * cahvor.C)};
  return camera;
}

Cahvor ToCahvor(const CalibratedCamera& camera) {
  const std::string_view model = camera.model->name;
  const auto holds = [&](const LensForm& form) { return form.model == model; };
  const bool is_cahvor = std::ranges::any_of(CahvorLenses().forms, holds);
  Cahvor cahvor;
  if (!is_cahvor) cahvor.linearity = LinearityOf(model);
  const Lens lens =
      cahvor.linearity
          ? ToLens(camera, CahvoreLenses(std::string(model.substr(0, model.find('+')))).Table())
          : ToLens(camera, CahvorLenses());
  const std::vector<double>& k = lens.coefficients;
  Eigen::Matrix3d K;
  K << lens.f_x, lens.f_x * k[4], lens.c_x, 0, lens.f_y, lens.c_y, 0, 0, 1;
  Eigen::Matrix3d M = K * TiltMatrix(k[2], k[3]);
  // H and V are orthogonal but for A when (H x A) . (V x A) = 0; a factor 1 / s of the first two
  // columns, which R_0 = s - 1 takes back, divides the product's first two terms by s^2 and the
  // third one by s^4.
  const Eigen::Vector3d H = M.row(0), V = M.row(1), A = M.row(2);
  const Eigen::Vector3d terms = H.cross(A).cwiseProduct(V.cross(A));
  const double first = terms[0] + terms[1], third = terms[2];
  constexpr double kRounding = 1e-12;
  double s = 1;
  if (std::abs(first + third) > kRounding * H.cross(A).norm() * V.cross(A).norm()) {
    if (!(first * third < 0)) {
      throw JobError(
          "camera '{}': a skew of {} without a tilt has no place in cahvor", camera.name, k[4]);
    }
    s = std::sqrt(-third / first);
  }
  M *= Eigen::Vector3d(1 / s, 1 / s, 1).asDiagonal();
  cahvor.HVA = M * camera.T_camera_rig.R / M.row(2).norm();
  cahvor.C = camera.T_camera_rig.Inverse().t;
  cahvor.O = camera.T_camera_rig.R.row(2);
  cahvor.R = {s - 1, s * k[0], s * k[1]};
  cahvor.E = {k[5], k[6], k[7]};
  return cahvor;
}

}  // namespace plenocal
