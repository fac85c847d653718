// SPDX-License-Identifier: Apache-2.0
#include "apps/simulate/spec/photometry_spec.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "apps/simulate/spec/spec_values.h"

namespace plenocal::simulate {
namespace {

constexpr double kFullLight = 255;

ToneSpec PowerLaw(double gamma) {
  const auto light = [gamma](double grey) {
    return kFullLight * std::pow(grey / kFullLight, gamma);
  };
  ResponseCurve::Table table;
  ToneSpec tone;
  for (size_t k = 0; k < table.size(); ++k) table[k] = light(static_cast<double>(k));
  for (size_t k = 0; k < tone.borders.size(); ++k) {
    tone.borders[k] = light(static_cast<double>(k) + 0.5);
  }
  tone.curve = ResponseCurve(table);
  return tone;
}

}  // namespace

double VignettingSpec::At(double x, double y, const ImageSize& size) const {
  const Eigen::Vector2d last(size[0] - 1, size[1] - 1);
  const Eigen::Vector2d half_diagonal =
      Eigen::Vector2d::Constant(Eigen::Vector2d(size[0], size[1]).norm() / 2);
  const Eigen::Vector2d r = (Eigen::Vector2d(x, y) - centre.value_or(last / 2))
                                .cwiseQuotient(half_diagonal.cwiseProduct(axes));
  const double r2 = r.squaredNorm();
  const double lost = ((polynomial[2] * r2 + polynomial[1]) * r2 + polynomial[0]) * r2;
  constexpr double kLeast = 0.01;  // of a lens that does see the pixel
  return std::max(1 + lost, kLeast);
}

ToneSpec ReadToneSpec(const YamlNode& node, const std::filesystem::path& spec) {
  node.CheckKeys({"gamma", "file"});
  if (node.Has("gamma") == node.Has("file")) node.Fail("expected either 'gamma' or 'file'");
  if (node.Has("gamma")) return PowerLaw(NumberWithin(node.At("gamma"), 0.2, 5));
  const ResponseCurve curve = ReadResponse(PathBeside(spec, node.At("file")));
  return {curve, curve.MakeBorders()};
}

VignettingSpec ReadVignettingSpec(const YamlNode& node) {
  VignettingSpec vignetting;
  node.CheckKeys({"polynomial", "centre", "axes"});
  const YamlNode polynomial = node.At("polynomial");
  const std::vector<double> values = polynomial.AsNumbers(0);
  if (values.empty() || values.size() > vignetting.polynomial.size()) {
    polynomial.Fail("expected one to three coefficients, of r^2, r^4 and r^6");
  }
  vignetting.polynomial = {};
  std::ranges::copy(values, vignetting.polynomial.begin());
  if (node.Has("centre")) {
    const std::vector<double> centre = node.At("centre").AsNumbers(2);
    vignetting.centre = Eigen::Vector2d(centre[0], centre[1]);
  }
  if (node.Has("axes")) {
    const std::vector<double> axes = node.At("axes").AsNumbers(2);
    if (!(axes[0] > 0 && axes[1] > 0)) node.At("axes").Fail("expected two positive numbers");
    vignetting.axes = {axes[0], axes[1]};
  }
  return vignetting;
}

WallSpec ReadWallSpec(const YamlNode& node) {
  WallSpec wall;
  ReadKeys(node,
           {{"contrast", &wall.contrast, 0, 0.5},
            {"structure", &wall.structure, 1e-6, 10},
            {"light", &wall.light, 0, 0.9},
            {"gloss", &wall.gloss, 0, 1},
            {"shading", &wall.shading, -0.5, 0.5},
            {"fold", &wall.fold, -100, 100},
            {"fold_angle", &wall.fold_angle, -1, 1}});
  return wall;
}

ExposureSpec ReadExposureSpec(const YamlNode& node, const std::vector<std::string>& cameras) {
  ExposureSpec exposures;
  std::optional<double> nominal;
  ReadKeys(node,
           {{"nominal", &nominal, 1e-6, 1e6},
            {"known", &exposures.known},
            {"error", &exposures.error, 0, 0.5}},
           {"range", "order", "late"});
  const YamlNode range = node.At("range");
  const std::vector<double> limits = range.AsNumbers(2);
  if (!(limits[0] > 0 && limits[1] >= limits[0])) range.Fail("expected [least, largest] in ms");
  exposures.least = limits[0];
  exposures.largest = limits[1];
  exposures.nominal = nominal.value_or(limits[1]);
  static constexpr std::array<std::string_view, 2> kOrders{"sweep", "random"};
  if (node.Has("order")) exposures.sweep = ReadChoice(node.At("order"), kOrders) == 0;
  if (!node.Has("late")) return exposures;
  const YamlNode late = node.At("late");
  ReadKeys(late,
           {{"change", &exposures.late_change, -0.9, 10}, {"share", &exposures.late_share, 0, 1}},
           {"camera"});
  exposures.late_camera = late.At("camera").AsString();
  if (std::ranges::find(cameras, exposures.late_camera) == cameras.end()) {
    late.At("camera").Fail(fmt::format("no camera is named '{}'", exposures.late_camera));
  }
  return exposures;
}

}  // namespace plenocal::simulate
