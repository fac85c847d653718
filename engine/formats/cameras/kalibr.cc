// SPDX-License-Identifier: Apache-2.0
//
// camchain of Kalibr. T_cn_cnm1 maps camera n-1 to camera n. Double sphere: xi alpha fu fv pu pv.
#include <fmt/format.h>

#include <algorithm>
#include <charconv>
#include <cstddef>
#include <map>
#include <string_view>

#include "calib/base/quoted_text.h"
#include "calib/files/calibration_file.h"
#include "calib/files/checks/transform_keys.h"
#include "calib/io/yaml.h"
#include "engine/formats/camera_format.h"
#include "engine/formats/exact_numbers.h"
#include "engine/formats/lens_form.h"
#include "engine/formats/pose_matrices.h"

namespace plenocal {
namespace {

const LensTable& KalibrLenses() {
  static const LensTable kTable{
      .tool = "kalibr",
      .forms = {{"pinhole", "pinhole none", ""},
                {"pinhole-radial3", "pinhole radtan", "A_0 A_1 0 0"},
                {"pinhole-radtan4", "pinhole radtan", "k_1 k_2 p_1 p_2"},
                {"pinhole-radtan", "pinhole radtan", "k_1 k_2 p_1 p_2"},
                {"kannala-brandt4", "pinhole equidistant", "k_1 k_2 k_3 k_4"},
                {"fov", "pinhole fov", "omega"},
                {"eucm", "eucm none", "alpha beta"},
                {"double-sphere", "ds none", "xi alpha"},
                OmniForms()[0],
                OmniForms()[1]},
      .has_all_coefficients = true};
  return kTable;
}

Lens ToOmni(const Lens& ucm) {
  const double alpha = ucm.coefficients[0];
  return ScaledPlane(ucm, 1 / (1 - alpha), alpha / (1 - alpha));
}

/// Number of a projection's own parameters, which stand before the focal lengths.
const std::map<std::string_view, size_t> kOwnParams{
    {"pinhole", 0}, {"omni", 1}, {"eucm", 2}, {"ds", 2}};

/// The number of a key as "cam10"; the others are the first.
int NumberOf(const std::string& key) {
  int number = -1;
  if (key.starts_with("cam")) std::from_chars(key.data() + 3, key.data() + key.size(), number);
  return number;
}

std::string WriteKalibr(const std::vector<CalibratedCamera>& cameras) {
  std::string text;
  for (size_t i = 0; i < cameras.size(); ++i) {
    const CalibratedCamera& camera = cameras[i];
    Lens lens = ToLens(camera, KalibrLenses());
    if (lens.name.starts_with("omni")) lens = ToOmni(lens);
    const size_t blank = lens.name.find(' ');
    const std::string projection = lens.name.substr(0, blank);
    const auto own =
        lens.coefficients.begin() + static_cast<std::ptrdiff_t>(kOwnParams.at(projection));
    std::vector<double> intrinsics(lens.coefficients.begin(), own),
        distortion(own, lens.coefficients.end());
    for (const double value : {lens.f_x, lens.f_y, lens.c_x, lens.c_y}) intrinsics.push_back(value);
    text += fmt::format("cam{}:\n", i);
    if (i > 0) {
      const RigidTransform T = camera.T_camera_rig * cameras[i - 1].T_camera_rig.Inverse();
      text += "  T_cn_cnm1:\n";
      for (const auto& row : Rows(T)) text += fmt::format("  - [{}]\n", RealList(row));
      text += "  - [0.0, 0.0, 0.0, 1.0]\n";
    }
    text += fmt::format(
        "  cam_overlaps: []\n  camera_model: {}\n  distortion_coeffs: [{}]\n"
        "  distortion_model: {}\n  intrinsics: [{}]\n  resolution: [{}, {}]\n  rostopic: {}\n",
        projection,
        RealList(distortion),
        lens.name.substr(blank + 1),
        RealList(intrinsics),
        camera.image_size[0],
        camera.image_size[1],
        YamlText(fmt::format("/{}/image_raw", camera.name)));
  }
  return text;
}

std::vector<CalibratedCamera> ReadKalibr(const CameraSource& source) {
  const YamlNode root = YamlNode::ReadFile(source.path);
  std::vector<CalibratedCamera> cameras;
  // Kalibr writes the keys by their letters: cam10 before cam2.
  auto entries = root.Entries();
  std::ranges::stable_sort(entries, {}, [](const auto& entry) { return NumberOf(entry.first); });
  for (const auto& [name, node] : entries) {
    const std::string projection = node.At("camera_model").AsString();
    const std::string distortion =
        node.Has("distortion_model") ? node.At("distortion_model").AsString() : "none";
    const auto own = kOwnParams.find(projection);
    if (own == kOwnParams.end()) {
      node.At("camera_model").Fail("expected pinhole, omni, eucm or ds");
    }
    const std::vector<double> intrinsics = node.At("intrinsics").AsNumbers(4 + own->second);
    Lens lens = LensOfNumbers(fmt::format("{} {}", projection, distortion),
                              {intrinsics.end() - 4, intrinsics.end()});
    lens.coefficients.assign(intrinsics.begin(), intrinsics.end() - 4);
    if (node.Has("distortion_coeffs")) {
      for (const double value : node.At("distortion_coeffs").AsNumbers(0)) {
        lens.coefficients.push_back(value);
      }
    }
    if (lens.name == "omni none" || lens.name == "omni radtan") {
      if (!(lens.coefficients[0] > -1)) node.At("intrinsics").Fail("expected xi above -1");
      lens = FromOmni(lens);
    }
    CalibratedCamera camera =
        FromLens(lens,
                 ReadImageSize(node.At("resolution")),
                 KalibrLenses(),
                 fmt::format("{}:{}: {}", source.path.string(), node.Line(), name));
    camera.name = name;
    if (!cameras.empty()) {
      camera.T_camera_rig = ReadTransform(node.At("T_cn_cnm1")) * cameras.back().T_camera_rig;
    }
    cameras.push_back(camera);
  }
  if (cameras.empty()) root.Fail("holds no cameras");
  return cameras;
}

}  // namespace

CameraFormat KalibrFormat() {
  return {.name = "kalibr",
          .file = "camchain.yaml",
          .most_cameras = kAnyNumber,
          .holds_extrinsics = true,
          .write = WriteKalibr,
          .read = ReadKalibr};
}

}  // namespace plenocal
