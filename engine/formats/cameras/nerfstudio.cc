// SPDX-License-Identifier: Apache-2.0
//
// transforms.json of nerfstudio, which tools for gaussian splatting read as well: one camera, and
// the poses of its images. transform_matrix maps the camera's frame (x right, y up, z backwards) to
// the world's, here the target's.
#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <string_view>

#include "calib/base/quoted_text.h"
#include "calib/io/yaml.h"
#include "engine/formats/camera_format.h"
#include "engine/formats/exact_numbers.h"
#include "engine/formats/lens_form.h"
#include "engine/formats/pose_matrices.h"

namespace plenocal {
namespace {

const LensTable& NerfstudioLenses() {
  static const LensTable kTable{
      .tool = "nerfstudio",
      .forms = {{"pinhole", "PINHOLE", ""},
                {"pinhole-radial3", "OPENCV", "A_0 A_1 A_2 0 0 0"},
                {"pinhole-radtan4", "OPENCV", "k_1 k_2 0 0 p_1 p_2"},
                {"pinhole-radtan", "OPENCV", "k_1 k_2 k_3 0 p_1 p_2"},
                {"kannala-brandt4", "OPENCV_FISHEYE", "k_1 k_2 k_3 k_4"}},
      .first_pixel = 0.5,
      .keys = {"fl_x", "fl_y", "cx", "cy"},
      .coefficient_keys = {{"OPENCV", "k1 k2 k3 k4 p1 p2"}, {"OPENCV_FISHEYE", "k1 k2 k3 k4"}},
      .may_lack_coefficients = true};
  return kTable;
}

std::string Intrinsics(const CalibratedCamera& camera) {
  const Lens lens = ToLens(camera, NerfstudioLenses());
  std::string text = fmt::format("  \"camera_model\": \"{}\",\n  \"w\": {},\n  \"h\": {},\n",
                                 lens.name,
                                 camera.image_size[0],
                                 camera.image_size[1]);
  for (const auto& [key, value] : lens.Entries(NerfstudioLenses())) {
    text += fmt::format("  \"{}\": {},\n", key, RealText(value));
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

std::string WriteViews(const CalibrationRecord& calibration, size_t index) {
  const CalibratedCamera& camera = calibration.cameras[index];
  std::string frames;
  for (const ViewImage& image : ViewImages(calibration, {index})) {
    const RigidTransform pose = image.T_camera_target.Inverse();
    Eigen::Matrix4d matrix = Eigen::Matrix4d::Identity();
    matrix.topLeftCorner<3, 3>() = pose.R * Eigen::Vector3d(1, -1, -1).asDiagonal();
    matrix.topRightCorner<3, 1>() = pose.t;
    frames += fmt::format("{}\n    {{\"file_path\": {}, \"transform_matrix\": {}}}",
                          frames.empty() ? "" : ",",
                          YamlQuoted("images/" + image.file),
                          MatrixText(matrix));
  }
  return fmt::format("{{\n{}  \"frames\": [{}\n  ]\n}}\n", Intrinsics(camera), frames);
}

/// instant-ngp's scripts write "w": 1920.0.
int Pixels(const YamlNode& node) {
  const double value = node.AsNumber();
  constexpr double kMost = 1e6;  // no image has more columns
  if (!(value >= 1 && value <= kMost && value == std::round(value))) {
    node.Fail("expected a number of pixels");
  }
  return static_cast<int>(value);
}

std::vector<CalibratedCamera> ReadNerfstudio(const CameraSource& source) {
  const YamlNode root = YamlNode::ReadFile(source.path);
  std::string name = root.Has("camera_model") ? root.At("camera_model").AsString() : "OPENCV";
  if (root.Has("is_fisheye") && root.At("is_fisheye").AsBool()) name = "OPENCV_FISHEYE";
  // nerfstudio takes all of these for OPENCV, with the coefficients that the file has.
  static constexpr std::array<std::string_view, 4> kPerspective{
      "PINHOLE", "SIMPLE_PINHOLE", "SIMPLE_RADIAL", "RADIAL"};
  if (std::ranges::find(kPerspective, name) != kPerspective.end()) name = "OPENCV";
  Lens lens = ReadLensEntries(root, name, NerfstudioLenses());
  const bool is_plain = std::ranges::all_of(lens.coefficients, [](double c) { return c == 0; });
  if (name == "OPENCV" && is_plain) lens = {"PINHOLE", lens.f_x, lens.f_y, lens.c_x, lens.c_y, {}};
  const ImageSize size{Pixels(root.At("w")), Pixels(root.At("h"))};
  CalibratedCamera camera = FromLens(lens, size, NerfstudioLenses(), source.path.string());
  camera.name = "camera";
  return {camera};
}

}  // namespace

CameraFormat NerfstudioFormat() {
  return {.name = "nerfstudio",
          .file = "transforms.json",
          .most_cameras = kAnyNumber,
          .write = WriteNerfstudio,
          .read = ReadNerfstudio,
          .has_file_per_camera = true,
          .write_views = WriteViews};
}

}  // namespace plenocal
