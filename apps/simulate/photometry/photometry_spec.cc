// SPDX-License-Identifier: Apache-2.0
#include "apps/simulate/photometry/photometry_spec.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "apps/simulate/spec_values.h"

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

std::array<double, 2> ReadRange(const YamlNode& node) {
  const std::vector<double> range = node.AsNumbers(2);
  if (!(range[0] > 0 && range[1] >= range[0])) node.Fail("expected [least, largest] in ms");
  return {range[0], range[1]};
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
  if (node.Has("gamma")) {
    double gamma = 1;
    ReadNumber(node, "gamma", 0.2, 5, &gamma);
    return PowerLaw(gamma);
  }
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
  node.CheckKeys({"contrast", "structure", "light", "gloss", "shading", "fold", "fold_angle"});
  WallSpec wall;
  ReadNumber(node, "contrast", 0, 0.5, &wall.contrast);
  ReadNumber(node, "structure", 1e-6, 10, &wall.structure);
  ReadNumber(node, "light", 0, 0.9, &wall.light);
  ReadNumber(node, "gloss", 0, 1, &wall.gloss);
  ReadNumber(node, "shading", -0.5, 0.5, &wall.shading);
  if (node.Has("fold")) {
    wall.fold = 0;
    ReadNumber(node, "fold", -100, 100, &*wall.fold);
  }
  ReadNumber(node, "fold_angle", -1, 1, &wall.fold_angle);
  return wall;
}

ExposureSpec ReadExposureSpec(const YamlNode& node, const std::vector<std::string>& cameras) {
  node.CheckKeys({"range", "nominal", "order", "known", "error", "late"});
  ExposureSpec exposures;
  const std::array<double, 2> range = ReadRange(node.At("range"));
  exposures.least = range[0];
  exposures.largest = range[1];
  exposures.nominal = range[1];
  ReadNumber(node, "nominal", 1e-6, 1e6, &exposures.nominal);
  if (node.Has("order")) {
    static constexpr std::array<std::string_view, 2> kOrders{"sweep", "random"};
    exposures.sweep = ReadChoice(node.At("order"), kOrders) == 0;
  }
  if (node.Has("known")) exposures.known = node.At("known").AsBool();
  ReadNumber(node, "error", 0, 0.5, &exposures.error);
  if (!node.Has("late")) return exposures;
  const YamlNode late = node.At("late");
  late.CheckKeys({"camera", "change", "share"});
  exposures.late_camera = late.At("camera").AsString();
  if (std::ranges::find(cameras, exposures.late_camera) == cameras.end()) {
    late.At("camera").Fail(fmt::format("no camera is named '{}'", exposures.late_camera));
  }
  ReadNumber(late, "change", -0.9, 10, &exposures.late_change);
  ReadNumber(late, "share", 0, 1, &exposures.late_share);
  return exposures;
}

}  // namespace plenocal::simulate
