// SPDX-License-Identifier: Apache-2.0
//
// transforms.json of nerfstudio, which tools for gaussian splatting read as well: one camera, and
// the poses of its images. transform_matrix maps the camera's frame (x right, y up, z backwards) to
// the world's, here the target's.
#include <fmt/format.h>

#include <array>

#include "calib/base/quoted_text.h"
#include "calib/io/yaml.h"
#include "engine/formats/camera_format.h"
#include "engine/formats/exact_numbers.h"
#include "engine/formats/lens_form.h"

namespace plenocal {
namespace {

constexpr double kHalfPixelThere = 0.5;  // (0, 0) is the corner of the top-left pixel there

std::span<const LensForm> NerfstudioLenses() {
  static const std::vector<LensForm> kForms{
      {"pinhole", "PINHOLE", {}},
      {"pinhole-radial3", "OPENCV", {"A_0", "A_1", "A_2", "0", "0", "0"}},
      {"pinhole-radtan4", "OPENCV", {"k_1", "k_2", "0", "0", "p_1", "p_2"}},
      {"pinhole-radtan", "OPENCV", {"k_1", "k_2", "k_3", "0", "p_1", "p_2"}},
      {"kannala-brandt4", "OPENCV_FISHEYE", {"k_1", "k_2", "k_3", "k_4"}}};
  return kForms;
}

constexpr std::array kCoefficientNames{"k1", "k2", "k3", "k4", "p1", "p2"};

size_t CoefficientCount(const std::string& lens) {
  return lens == "OPENCV" ? 6 : lens == "OPENCV_FISHEYE" ? 4 : 0;
}

std::string Intrinsics(const CalibratedCamera& camera) {
  const Lens lens = ToLens(camera, NerfstudioLenses(), "nerfstudio");
  std::string text = fmt::format(
      "  \"camera_model\": \"{}\",\n  \"w\": {},\n  \"h\": {},\n  \"fl_x\": {},\n  \"fl_y\": {},\n"
      "  \"cx\": {},\n  \"cy\": {},\n",
      lens.name,
      camera.image_size[0],
      camera.image_size[1],
      RealText(lens.f_x),
      RealText(lens.f_y),
      RealText(lens.c_x + kHalfPixelThere),
      RealText(lens.c_y + kHalfPixelThere));
  for (size_t i = 0; i < lens.coefficients.size(); ++i) {
    text += fmt::format("  \"{}\": {},\n", kCoefficientNames[i], RealText(lens.coefficients[i]));
  }
  return text;
}

std::string MatrixText(const Eigen::Matrix4d& matrix) {
  std::string text;
  for (Eigen::Index r = 0; r < 4; ++r) {
    const Eigen::RowVector4d row = matrix.row(r);
    text += fmt::format("{}[{}]", r == 0 ? "" : ", ", RealList(std::span(row.data(), 4)));
  }
  return fmt::format("[{}]", text);
}

std::string WriteNerfstudio(const std::vector<CalibratedCamera>& cameras) {
  return fmt::format("{{\n{}  \"frames\": []\n}}\n", Intrinsics(cameras[0]));
}

std::vector<std::string> WriteEachNerfstudio(const std::vector<CalibratedCamera>& cameras) {
  std::vector<std::string> files;
  for (const CalibratedCamera& camera : cameras) files.push_back(WriteNerfstudio({camera}));
  return files;
}

std::string WriteViews(const CalibrationRecord& calibration, size_t index) {
  const CalibratedCamera& camera = calibration.cameras[index];
  const bool rig = calibration.cameras.size() > 1;
  std::string frames;
  for (size_t f = 0; f < calibration.frames.size(); ++f) {
    const int frame = static_cast<int>(f);
    if (rig && !camera.view_poses.contains(frame)) continue;
    const RigidTransform pose = calibration.CameraFromTarget(index, frame).Inverse();
    Eigen::Matrix4d matrix = Eigen::Matrix4d::Identity();
    matrix.topLeftCorner<3, 3>() = pose.R * Eigen::Vector3d(1, -1, -1).asDiagonal();
    matrix.topRightCorner<3, 1>() = pose.t;
    frames += fmt::format("{}\n    {{\"file_path\": {}, \"transform_matrix\": {}}}",
                          frames.empty() ? "" : ",",
                          YamlQuoted(fmt::format("images/{}{}.png",
                                                 rig ? camera.name + "/" : std::string(),
                                                 calibration.frames[f].name)),
                          MatrixText(matrix));
  }
  return fmt::format("{{\n{}  \"frames\": [{}\n  ]\n}}\n", Intrinsics(camera), frames);
}

std::vector<CalibratedCamera> ReadNerfstudio(const CameraSource& source) {
  const YamlNode root = YamlNode::ReadFile(source.path);
  const auto corner = [&](const char* key) {
    const double value = root.At(key).AsNumber();
    return Inverted(value, value - kHalfPixelThere, [](double x) { return x + kHalfPixelThere; });
  };
  Lens lens{root.At("camera_model").AsString(),
            root.At("fl_x").AsNumber(),
            root.At("fl_y").AsNumber(),
            corner("cx"),
            corner("cy"),
            {}};
  for (size_t i = 0; i < CoefficientCount(lens.name); ++i) {
    const char* const key = kCoefficientNames[i];
    lens.coefficients.push_back(root.Has(key) ? root.At(key).AsNumber() : 0);
  }
  const ImageSize size{root.At("w").AsInteger(), root.At("h").AsInteger()};
  CalibratedCamera camera = FromLens(lens, size, NerfstudioLenses(), source.path.string());
  camera.name = "camera";
  return {camera};
}

}  // namespace

CameraFormat NerfstudioFormat() {
  return {.name = "nerfstudio",
          .file = "transforms.json",
          .most_cameras = kAnyNumber,
          .holds_extrinsics = false,
          .write = WriteNerfstudio,
          .read = ReadNerfstudio,
          .write_files = WriteEachNerfstudio,
          .write_views = WriteViews};
}

}  // namespace plenocal
