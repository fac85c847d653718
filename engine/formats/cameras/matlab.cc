// SPDX-License-Identifier: Apache-2.0
//
// JSON for MATLAB's jsondecode: the arguments of cameraIntrinsics, of a pair those of
// stereoParameters. PoseCamera2 maps camera 1 to camera 2.
#include <fmt/format.h>

#include <array>

#include "calib/files/calibration_file.h"
#include "calib/files/checks/transform_keys.h"
#include "calib/io/yaml.h"
#include "engine/formats/camera_format.h"
#include "engine/formats/exact_numbers.h"
#include "engine/formats/matlab_intrinsics.h"
#include "engine/formats/pose_matrices.h"

namespace plenocal {
namespace {

/// The object's entries, each line after `indent`.
std::string MatlabObject(const CalibratedCamera& camera, const std::string& indent) {
  const MatlabIntrinsics m = ToMatlab(camera);
  const auto entry = [&](const char* key, std::span<const double> values) {
    return fmt::format("{}  \"{}\": [{}],\n", indent, key, RealList(values));
  };
  return "{\n" + entry("FocalLength", m.focal_length) + entry("PrincipalPoint", m.principal_point) +
         fmt::format(
             "{}  \"ImageSize\": [{}, {}],\n", indent, camera.image_size[1], camera.image_size[0]) +
         entry("RadialDistortion", m.radial_distortion) +
         entry("TangentialDistortion", m.tangential_distortion) + indent + "  \"Skew\": 0\n" +
         indent + "}";
}

std::string WriteMatlab(const std::vector<CalibratedCamera>& cameras) {
  if (cameras.size() == 1) return MatlabObject(cameras[0], "") + "\n";
  const RigidTransform T = SecondFromFirst(cameras);
  std::string rows;
  for (const auto& row : Rows(T)) rows += fmt::format("[{}], ", RealList(row));
  return fmt::format(
      "{{\n  \"Camera1\": {},\n  \"Camera2\": {},\n  \"PoseCamera2\": [{}[0.0, 0.0, 0.0, 1.0]]\n"
      "}}\n",
      MatlabObject(cameras[0], "  "),
      MatlabObject(cameras[1], "  "),
      rows);
}

CalibratedCamera ReadMatlabObject(const YamlNode& node, const std::string& where) {
  const auto pair = [&](const char* key) {
    const std::vector<double> values = node.At(key).AsNumbers(2);
    return std::array{values[0], values[1]};
  };
  MatlabIntrinsics m{pair("FocalLength"),
                     pair("PrincipalPoint"),
                     pair("ImageSize"),
                     node.At("RadialDistortion").AsNumbers(0),
                     pair("TangentialDistortion")};
  if (m.radial_distortion.size() < 2 || m.radial_distortion.size() > 3) {
    node.At("RadialDistortion").Fail("expected two or three numbers");
  }
  if (node.Has("Skew") && node.At("Skew").AsNumber() != 0) {
    node.At("Skew").Fail("a skewed camera matrix is not read");
  }
  ReadImageSize(node.At("ImageSize"));  // whole positive numbers
  return FromMatlab(m, where);
}

std::vector<CalibratedCamera> ReadMatlab(const CameraSource& source) {
  const YamlNode root = YamlNode::ReadFile(source.path);
  const std::string where = source.path.string();
  if (!root.Has("Camera1")) return {ReadMatlabObject(root, where)};
  std::vector<CalibratedCamera> cameras{ReadMatlabObject(root.At("Camera1"), where),
                                        ReadMatlabObject(root.At("Camera2"), where)};
  cameras[0].name = "camera1";
  cameras[1].name = "camera2";
  cameras[1].T_camera_rig = ReadTransform(root.At("PoseCamera2"));
  return cameras;
}

}  // namespace

CameraFormat MatlabFormat() {
  return {.name = "matlab",
          .file = "camera.json",
          .most_cameras = 2,
          .holds_extrinsics = true,
          .write = WriteMatlab,
          .read = ReadMatlab};
}

}  // namespace plenocal
