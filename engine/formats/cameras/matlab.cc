// SPDX-License-Identifier: Apache-2.0
//
// JSON for MATLAB's jsondecode: the arguments of cameraIntrinsics or fisheyeIntrinsics, of a pair
// those of stereoParameters. PoseCamera2 maps camera 1 to camera 2.
#include <fmt/format.h>
#include <fmt/ranges.h>

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
  std::string entries;
  for (const MatlabArgument& argument : ToMatlab(camera)) {
    const std::vector<double>& v = argument.values;
    std::string value =
        v.size() == 1 ? fmt::format("{}", v[0]) : fmt::format("[{}]", fmt::join(v, ", "));
    if (argument.rows == 2) value = fmt::format("[[{}, {}], [{}, {}]]", v[0], v[2], v[1], v[3]);
    entries +=
        fmt::format("{}{}  \"{}\": {}", entries.empty() ? "" : ",\n", indent, argument.name, value);
  }
  return "{\n" + entries + "\n" + indent + "}";
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
  const auto read = [&](const std::string& name, size_t least, size_t most) {
    if (name == "Skew") return std::vector{node.Has(name) ? node.At(name).AsNumber() : 0};
    const YamlNode values = node.At(name);
    std::vector<double> numbers;
    if (name == "StretchMatrix") {
      const std::vector<YamlNode> rows = values.Elements();
      if (rows.size() != 2) values.Fail("expected [[c, d], [e, 1]]");
      const std::vector<double> first = rows[0].AsNumbers(2), second = rows[1].AsNumbers(2);
      numbers = {first[0], second[0], first[1], second[1]};
    } else {
      numbers = values.AsNumbers(0);
    }
    if (numbers.size() < least || numbers.size() > most) {
      values.Fail(least == most ? fmt::format("expected {} numbers", least)
                                : fmt::format("expected {} to {} numbers", least, most));
    }
    return numbers;
  };
  return FromMatlab(read, node.Has(kMatlabFisheye), where);
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
