// SPDX-License-Identifier: Apache-2.0
//
// camchain of Kalibr. T_cn_cnm1 maps camera n-1 to camera n. Double sphere: xi alpha fu fv pu pv.
#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <iterator>

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
  static const LensTable kTable{"kalibr",
                                {{"pinhole", "pinhole none", ""},
                                 {"pinhole-radial3", "pinhole radtan", "A_0 A_1 0 0"},
                                 {"pinhole-radtan4", "pinhole radtan", "k_1 k_2 p_1 p_2"},
                                 {"pinhole-radtan", "pinhole radtan", "k_1 k_2 p_1 p_2"},
                                 {"kannala-brandt4", "pinhole equidistant", "k_1 k_2 k_3 k_4"},
                                 {"fov", "pinhole fov", "omega"},
                                 {"eucm", "eucm none", "alpha beta"},
                                 {"double-sphere", "ds none", "xi alpha"},
                                 {"ucm", "omni none", "alpha"},
                                 {"ucm+radtan", "omni radtan", "alpha k_1 k_2 p_1 p_2"}}};
  return kTable;
}

/// Kalibr's omni is the unified model by other parameters (models/ucm.h). Its lens coordinates, on
/// which distortion acts, are ours times 1 - alpha: the lens with coordinates divided by `scale`,
/// and `first` as its first coefficient.
Lens ScaledPlane(const Lens& lens, double scale, double first) {
  Lens scaled = lens;
  scaled.f_x *= scale;
  scaled.f_y *= scale;
  scaled.coefficients[0] = first;
  const std::array<double, 4> powers{2, 4, 1, 1};  // of k_1 k_2 p_1 p_2
  for (size_t i = 1; i < scaled.coefficients.size(); ++i) {
    scaled.coefficients[i] *= std::pow(scale, powers.at(i - 1));
  }
  return scaled;
}

Lens ToOmni(const Lens& ucm) {
  const double alpha = ucm.coefficients[0];
  return ScaledPlane(ucm, 1 / (1 - alpha), alpha / (1 - alpha));
}

Lens FromOmni(const Lens& omni, const YamlNode& node) {
  if (omni.coefficients.empty()) node.At("intrinsics").Fail("expected xi fu fv pu pv");
  if (omni.coefficients.size() > 5) {
    node.At("distortion_coeffs").Fail("expected k1 k2 p1 p2 of omni");
  }
  const double xi = omni.coefficients[0];
  if (!(xi > -1)) node.At("intrinsics").Fail("expected xi above -1");
  Lens lens = ScaledPlane(omni, 1 / (1 + xi), xi / (1 + xi));
  const bool is_plain = std::all_of(lens.coefficients.begin() + 1,
                                    lens.coefficients.end(),
                                    [](double value) { return value == 0; });
  lens.name = is_plain ? "omni none" : "omni radtan";
  return lens;
}

std::string WriteKalibr(const std::vector<CalibratedCamera>& cameras) {
  std::string text;
  for (size_t i = 0; i < cameras.size(); ++i) {
    const CalibratedCamera& camera = cameras[i];
    Lens lens = ToLens(camera, KalibrLenses());
    if (lens.name.starts_with("omni")) lens = ToOmni(lens);
    const size_t blank = lens.name.find(' ');
    const std::string projection = lens.name.substr(0, blank);
    // A projection's own parameters come before the focal lengths, distortion apart.
    const auto own =
        lens.coefficients.begin() +
        (projection == "pinhole" ? 0 : (projection == "omni" ? 1 : std::ssize(lens.coefficients)));
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
  for (const auto& [name, node] : root.Entries()) {
    const std::string projection = node.At("camera_model").AsString();
    const std::string distortion =
        node.Has("distortion_model") ? node.At("distortion_model").AsString() : "none";
    const std::vector<double> intrinsics = node.At("intrinsics").AsNumbers(0);
    if (intrinsics.size() < 4) node.At("intrinsics").Fail("expected at least four numbers");
    Lens lens = LensOfNumbers(fmt::format("{} {}", projection, distortion),
                              {intrinsics.end() - 4, intrinsics.end()});
    lens.coefficients.assign(intrinsics.begin(), intrinsics.end() - 4);
    if (node.Has("distortion_coeffs")) {
      for (const double value : node.At("distortion_coeffs").AsNumbers(0)) {
        lens.coefficients.push_back(value);
      }
    }
    if (projection == "omni") lens = FromOmni(lens, node);
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
