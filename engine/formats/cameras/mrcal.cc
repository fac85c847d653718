// SPDX-License-Identifier: Apache-2.0
//
// cameramodel of mrcal: a Python dictionary, which is YAML in flow style. Its extrinsics map the
// reference to the camera, rotation vector first.
#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <string>
#include <tuple>
#include <utility>

#include "calib/base/format_error.h"
#include "calib/base/number_text.h"
#include "calib/files/calibration_file.h"
#include "calib/io/input_file.h"
#include "calib/io/yaml.h"
#include "engine/formats/camera_format.h"
#include "engine/formats/exact_numbers.h"
#include "engine/formats/lens_form.h"
#include "engine/formats/lenses/cahvor.h"
#include "models/formula/model.h"
#include "models/registry.h"
#include "models/splined.h"

namespace plenocal {
namespace {

constexpr std::string_view kLatLon = "latlon";

// Makes the lenses that are formulas here.
void AddFormulaOf(std::string_view lens, const std::string& where) {
  if (lens == "LENSMODEL_STEREOGRAPHIC") LensOfLinearity(0.5, where);
  if (lens != "LENSMODEL_LATLON") return;
  const YamlNode formula = YamlNode::Parse(
      "source: mrcal, LENSMODEL_LATLON\n"
      "map: ['atan2(X, hypot(Y, Z))', 'atan2(Y, Z)']\n"
      "domain: [Y^2 + Z^2 > 0]\n"
      "unmap: [sin(x), cos(x)*sin(y), cos(x)*cos(y)]\n",
      where);
  AddFormulaModel(std::string(kLatLon), formula, where);
}

const LensTable& MrcalLenses() {
  static const LensTable kTable{
      .tool = "mrcal",
      .forms = {{"pinhole", "LENSMODEL_PINHOLE", ""},
                {"spherical", "LENSMODEL_LONLAT", ""},
                {kLatLon, "LENSMODEL_LATLON", ""},
                {"linearity-0p5", "LENSMODEL_STEREOGRAPHIC", ""},
                {"pinhole-radial3", "LENSMODEL_OPENCV5", "A_0 A_1 0 0 A_2"},
                {"pinhole-radtan4", "LENSMODEL_OPENCV4", "k_1 k_2 p_1 p_2"},
                {"pinhole-radtan", "LENSMODEL_OPENCV5", "k_1 k_2 p_1 p_2 k_3"},
                {"pinhole-radtan8", "LENSMODEL_OPENCV8", "k_1 k_2 p_1 p_2 k_3 k_4 k_5 k_6"},
                {"pinhole-radtan12",
                 "LENSMODEL_OPENCV12",
                 "k_1 k_2 p_1 p_2 k_3 k_4 k_5 k_6 s_1 s_2 s_3 s_4"}},
      .has_all_coefficients = true};
  return kTable;
}

constexpr std::string_view kMrcalSpline = "LENSMODEL_SPLINED_STEREOGRAPHIC_";

// A spline's name holds its knots and its field of view.
Lens ToMrcalSpline(const SplineLens& lens, const CalibratedCamera& camera) {
  const double fov = camera.params[SplineLens::kFov];
  if (fov != std::round(fov)) {
    throw JobError(
        "camera '{}': mrcal's splines have a fov of whole degrees, this one has {}; "
        "calibrate with 'initial: {{fov: {:.0f}}}'",
        camera.name,
        fov,
        std::ceil(fov));
  }
  return {fmt::format("{}order={}_Nx={}_Ny={}_fov_x_deg={:.0f}",
                      kMrcalSpline,
                      lens.order,
                      lens.columns,
                      lens.rows,
                      fov),
          camera.params[0],
          camera.params[1],
          camera.params[2],
          camera.params[3],
          {camera.params.begin() + SplineLens::kFirstKnot, camera.params.end()}};
}

// The model of LENSMODEL_SPLINED_STEREOGRAPHIC_order=3_Nx=30_Ny=20_fov_x_deg=170, and its fov.
std::pair<const CameraModel*, int> ReadMrcalSpline(const YamlNode& name) {
  const std::string text = name.AsString();
  std::string_view rest = std::string_view(text).substr(kMrcalSpline.size());
  const auto take = [&](std::string_view key) {
    int number = 0;
    if (!rest.starts_with(key)) return number;
    const char* const end = rest.data() + rest.size();
    rest = {std::from_chars(rest.data() + key.size(), end, number).ptr, end};
    return number;
  };
  SplineLens lens;
  lens.order = take("order=");
  lens.columns = take("_Nx=");
  lens.rows = take("_Ny=");
  const int fov_deg = take("_fov_x_deg=");
  if (!rest.empty() || fov_deg <= 0 || (lens.order != 2 && lens.order != 3)) {
    name.Fail(fmt::format(
        "expected {}order=3_Nx=30_Ny=20_fov_x_deg=170, or other such numbers; the order is 2 or 3",
        kMrcalSpline));
  }
  try {
    return {FindModel(CameraModels(), Splined::NameOf(lens)), fov_deg};
  } catch (const Error& error) {
    name.Fail(error.what());
  }
}

// `name` is that of a spline, `intrinsics` all that the file holds.
CalibratedCamera FromMrcalSpline(const YamlNode& name, const YamlNode& intrinsics) {
  CalibratedCamera camera;
  int fov_deg = 0;
  std::tie(camera.model, fov_deg) = ReadMrcalSpline(name);
  camera.params = intrinsics.AsNumbers(camera.model->params.size() - 1);
  camera.params.insert(camera.params.begin() + SplineLens::kFov, fov_deg);
  if (!WithinBounds(*camera.model, camera.params.data())) {
    intrinsics.Fail("f_x and f_y must be positive, fov_x_deg between 0 and 360");
  }
  return camera;
}

std::string WriteMrcal(const std::vector<CalibratedCamera>& cameras) {
  const CalibratedCamera& camera = cameras[0];
  const SplineLens* const spline = Splined::LensOf(*camera.model);
  const Lens lens =
      spline != nullptr ? ToMrcalSpline(*spline, camera) : ToLens(camera, MrcalLenses());
  const Eigen::Vector3d w = LogRotation(camera.T_camera_rig.R), t = camera.T_camera_rig.t;
  return fmt::format(
      "{{\n    'lensmodel': '{}',\n    'intrinsics': [ {} ],\n    # rt_fromref\n"
      "    'extrinsics': [ {} ],\n    'imagersize': [ {}, {} ],\n}}\n",
      lens.name,
      RealList(lens.Numbers()),
      RealList(std::array{w.x(), w.y(), w.z(), t.x(), t.y(), t.z()}),
      camera.image_size[0],
      camera.image_size[1]);
}

constexpr std::string_view kMrcalCahvor = "LENSMODEL_CAHVOR",
                           kMrcalCahvore = "LENSMODEL_CAHVORE_linearity=";

/// Of fx fy cx cy alpha beta r0 r1 r2, where the angles are those of O; of CAHVORE e0 e1 e2 too.
Cahvor ReadMrcalCahvor(const YamlNode& lens,
                       const YamlNode& intrinsics,
                       const RigidTransform& T_camera_rig) {
  const std::string name = lens.AsString();
  Cahvor cahvor;
  if (name != kMrcalCahvor) {
    cahvor.linearity = ParseDouble(std::string_view(name).substr(kMrcalCahvore.size()));
    if (!cahvor.linearity) lens.Fail(fmt::format("expected {} and a number", kMrcalCahvore));
  }
  std::vector<double> p = intrinsics.AsNumbers(cahvor.linearity ? 12 : 9);
  p.resize(12);
  Eigen::Matrix3d K;
  K << p[0], 0, p[2], 0, p[1], p[3], 0, 0, 1;
  const Eigen::Vector3d o(
      std::sin(p[4]) * std::cos(p[5]), std::sin(p[5]), std::cos(p[4]) * std::cos(p[5]));
  cahvor.C = T_camera_rig.Inverse().t;
  cahvor.HVA = K * T_camera_rig.R;
  cahvor.O = T_camera_rig.R.transpose() * o;
  cahvor.R = {p[6], p[7], p[8]};
  cahvor.E = {p[9], p[10], p[11]};
  return cahvor;
}

std::vector<CalibratedCamera> ReadMrcal(const CameraSource& source) {
  std::string text = ReadTextFile(source.path, InputLimit::kDocument);
  // A packed blob that only mrcal reads.
  if (const size_t blob = text.find("'optimization_inputs'"); blob != std::string::npos) {
    const size_t end = text.find('\n', blob);
    text.erase(blob, end == std::string::npos ? end : end - blob);
  }
  const YamlNode root = YamlNode::Parse(text, source.path.string());
  const YamlNode lens = root.At(root.Has("lensmodel") ? "lensmodel" : "lens_model");
  const auto read_extrinsics = [&]() -> RigidTransform {
    const std::vector<double> rt = root.At("extrinsics").AsNumbers(6);
    return {ExpRotation({rt[0], rt[1], rt[2]}), {rt[3], rt[4], rt[5]}};
  };
  CalibratedCamera camera;
  if (lens.AsString() == kMrcalCahvor || lens.AsString().starts_with(kMrcalCahvore)) {
    const YamlNode intrinsics = root.At("intrinsics");
    const Cahvor cahvor = ReadMrcalCahvor(lens, intrinsics, read_extrinsics());
    return {FromCahvor(cahvor, ReadImageSize(root.At("imagersize")), source.path.string())};
  }
  if (lens.AsString().starts_with(kMrcalSpline)) {
    camera = FromMrcalSpline(lens, root.At("intrinsics"));
    camera.image_size = ReadImageSize(root.At("imagersize"));
  } else {
    const std::vector<double> intrinsics = root.At("intrinsics").AsNumbers(0);
    if (intrinsics.size() < 4) root.At("intrinsics").Fail("expected at least four numbers");
    AddFormulaOf(lens.AsString(), source.path.string());
    camera = FromLens(LensOfNumbers(lens.AsString(), intrinsics),
                      ReadImageSize(root.At("imagersize")),
                      MrcalLenses(),
                      source.path.string());
  }
  camera.T_camera_rig = read_extrinsics();
  return {camera};
}

}  // namespace

CameraFormat MrcalFormat() {
  return {.name = "mrcal",
          .file = "camera.cameramodel",
          .most_cameras = kAnyNumber,
          .holds_extrinsics = true,
          .write = WriteMrcal,
          .read = ReadMrcal,
          .has_file_per_camera = true};
}

}  // namespace plenocal
