// SPDX-License-Identifier: Apache-2.0
//
// camera_info of ROS. The extrinsics of a pair are in what rectifies it.
#include <fmt/format.h>

#include <array>

#include "calib/base/quoted_text.h"
#include "calib/io/yaml.h"
#include "engine/formats/camera_format.h"
#include "engine/formats/exact_numbers.h"
#include "engine/formats/lens_form.h"
#include "engine/formats/pose_matrices.h"
#include "engine/resample/rectify.h"

namespace plenocal {
namespace {

const LensTable& RosLenses() {
  static const LensTable kTable{
      "ros",
      {{"pinhole", "plumb_bob", "0 0 0 0 0"},
       {"pinhole-radial3", "plumb_bob", "A_0 A_1 0 0 A_2"},
       {"pinhole-radtan4", "plumb_bob", "k_1 k_2 p_1 p_2 0"},
       {"pinhole-radtan", "plumb_bob", "k_1 k_2 p_1 p_2 k_3"},
       {"pinhole-radtan8", "rational_polynomial", "k_1 k_2 p_1 p_2 k_3 k_4 k_5 k_6"},
       {"kannala-brandt4", "equidistant", "k_1 k_2 k_3 k_4"}}};
  return kTable;
}

/// With OpenCV's 12 and 14 coefficients too, which image_geometry takes and no message defines.
const LensTable& RosLensesOfFiles() {
  static const LensTable kTable = [] {
    LensTable table = RosLenses();
    for (const LensForm& form : OpenCvLenses().forms) {
      if (form.coefficients.size() < 12) continue;
      table.forms.push_back(form);
      table.forms.back().name = "rational_polynomial";
    }
    return table;
  }();
  return kTable;
}

/// `R` and `P` are those of a rectified pair, or nothing and the camera's own.
std::string RosFile(const CalibratedCamera& camera,
                    const Eigen::Matrix3d& R,
                    const std::array<double, 12>& P) {
  const Lens lens = ToLens(camera, RosLenses());
  const auto matrix = [](const char* key, int rows, int cols, std::span<const double> data) {
    return fmt::format(
        "{}:\n  rows: {}\n  cols: {}\n  data: [{}]\n", key, rows, cols, RealList(data));
  };
  std::string text = fmt::format("image_width: {}\nimage_height: {}\ncamera_name: {}\n",
                                 camera.image_size[0],
                                 camera.image_size[1],
                                 YamlText(camera.name));
  text += matrix("camera_matrix",
                 3,
                 3,
                 std::array{lens.f_x, 0.0, lens.c_x, 0.0, lens.f_y, lens.c_y, 0.0, 0.0, 1.0});
  text += fmt::format("distortion_model: {}\n", lens.name);
  text += matrix(
      "distortion_coefficients", 1, static_cast<int>(lens.coefficients.size()), lens.coefficients);
  text += matrix("rectification_matrix", 3, 3, RowMajor(R));
  return text + matrix("projection_matrix", 3, 4, P);
}

std::string WriteRos(const std::vector<CalibratedCamera>& cameras) {
  const Lens lens = ToLens(cameras[0], RosLenses());
  return RosFile(cameras[0],
                 Eigen::Matrix3d::Identity(),
                 {lens.f_x, 0, lens.c_x, 0, 0, lens.f_y, lens.c_y, 0, 0, 0, 1, 0});
}

/// The baseline is only in the second P: f times the translation of the second camera.
std::vector<std::string> WriteRosPair(const std::vector<CalibratedCamera>& cameras) {
  const RectifiedPair pair = Rectify(cameras[0], cameras[1], {});
  return {RosFile(cameras[0], pair.R_view_camera[0], pair.ProjectionMatrix(0)),
          RosFile(cameras[1], pair.R_view_camera[1], pair.ProjectionMatrix(1))};
}

std::vector<CalibratedCamera> ReadRos(const CameraSource& source) {
  const YamlNode root = YamlNode::ReadFile(source.path);
  const std::vector<double> K = root.At("camera_matrix").At("data").AsNumbers(9);
  CalibratedCamera camera =
      FromLens({root.At("distortion_model").AsString(),
                K[0],
                K[4],
                K[2],
                K[5],
                root.At("distortion_coefficients").At("data").AsNumbers(0)},
               {root.At("image_width").AsInteger(), root.At("image_height").AsInteger()},
               RosLensesOfFiles(),
               source.path.string());
  if (root.Has("camera_name")) camera.name = root.At("camera_name").AsString();
  if (root.Has("rectification_matrix") && root.Has("projection_matrix")) {
    // The rig is the rectified frame of the pair's first camera.
    const YamlNode rectification = root.At("rectification_matrix").At("data");
    camera.T_camera_rig = FromRectified(rectification.AsNumbers(9),
                                        root.At("projection_matrix").At("data").AsNumbers(12),
                                        rectification);
  }
  return {camera};
}

}  // namespace

CameraFormat RosFormat() {
  return {.name = "ros",
          .file = "camera_info.yaml",
          .most_cameras = 2,
          .holds_extrinsics = true,
          .write = WriteRos,
          .read = ReadRos,
          .write_files = WriteRosPair};
}

}  // namespace plenocal
