// SPDX-License-Identifier: Apache-2.0
//
// calibration.json of basalt. T_imu_cam maps camera to IMU; here the IMU is the rig. Lens
// parameters have names.
#include <fmt/format.h>

#include <array>

#include "calib/files/calibration_file.h"
#include "calib/io/yaml.h"
#include "engine/formats/camera_format.h"
#include "engine/formats/exact_numbers.h"
#include "engine/formats/lens_form.h"

namespace plenocal {
namespace {

const LensTable& BasaltLenses() {
  static const LensTable kTable{
      .tool = "basalt",
      .forms = {{"pinhole", "pinhole", ""},
                {"ucm", "ucm", "alpha"},
                {"eucm", "eucm", "alpha beta"},
                {"double-sphere", "ds", "xi alpha"},
                {"fov", "fov", "omega"},
                {"kannala-brandt4", "kb4", "k_1 k_2 k_3 k_4"},
                {"pinhole-radial3", "pinhole-radtan8", "A_0 A_1 0 0 A_2 0 0 0"},
                {"pinhole-radtan4", "pinhole-radtan8", "k_1 k_2 p_1 p_2 0 0 0 0"},
                {"pinhole-radtan", "pinhole-radtan8", "k_1 k_2 p_1 p_2 k_3 0 0 0"},
                {"pinhole-radtan8", "pinhole-radtan8", "k_1 k_2 p_1 p_2 k_3 k_4 k_5 k_6"}},
      .coefficient_keys = {{"ucm", "alpha"},
                           {"eucm", "alpha beta"},
                           {"ds", "xi alpha"},
                           {"fov", "w"},
                           {"kb4", "k1 k2 k3 k4"},
                           {"pinhole-radtan8", "k1 k2 p1 p2 k3 k4 k5 k6"}}};
  return kTable;
}

std::string WriteBasalt(const std::vector<CalibratedCamera>& cameras) {
  std::string poses, lenses, sizes;
  for (const CalibratedCamera& camera : cameras) {
    const Lens lens = ToLens(camera, BasaltLenses());
    const RigidTransform T_rig_camera = camera.T_camera_rig.Inverse();
    const Eigen::Quaterniond q(T_rig_camera.R);
    const char* const comma = poses.empty() ? "" : ",";
    poses += fmt::format(
        R"({}
      {{"px": {}, "py": {}, "pz": {}, "qx": {}, "qy": {}, "qz": {}, "qw": {}}})",
        comma,
        RealText(T_rig_camera.t.x()),
        RealText(T_rig_camera.t.y()),
        RealText(T_rig_camera.t.z()),
        RealText(q.x()),
        RealText(q.y()),
        RealText(q.z()),
        RealText(q.w()));
    std::string values;
    for (const auto& [key, value] : lens.Entries(BasaltLenses())) {
      values += fmt::format(R"({}"{}": {})", values.empty() ? "" : ", ", key, RealText(value));
    }
    if (lens.name == "pinhole-radtan8") values += R"(, "rpmax": 0.0)";
    lenses += fmt::format(R"({}
      {{"camera_type": "{}", "intrinsics": {{{}}}}})",
                          comma,
                          lens.name,
                          values);
    sizes += fmt::format("{}[{}, {}]", comma, camera.image_size[0], camera.image_size[1]);
  }
  // Values that are not in a camera calibration are basalt's own defaults.
  return fmt::format(R"({{
  "value0": {{
    "T_imu_cam": [{}
    ],
    "intrinsics": [{}
    ],
    "resolution": [{}],
    "calib_accel_bias": [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0],
    "calib_gyro_bias": [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0],
    "imu_update_rate": 200.0,
    "accel_noise_std": [0.016, 0.016, 0.016],
    "gyro_noise_std": [0.000282, 0.000282, 0.000282],
    "accel_bias_std": [0.001, 0.001, 0.001],
    "gyro_bias_std": [0.0001, 0.0001, 0.0001],
    "cam_time_offset_ns": 0,
    "vignette": []
  }}
}}
)",
                     poses,
                     lenses,
                     sizes);
}

std::vector<CalibratedCamera> ReadBasalt(const CameraSource& source) {
  const YamlNode root = YamlNode::ReadFile(source.path).At("value0");
  const auto lenses = root.At("intrinsics").Elements();
  const auto poses = root.At("T_imu_cam").Elements();
  const auto sizes = root.At("resolution").Elements();
  if (poses.size() != lenses.size() || sizes.size() != lenses.size() || lenses.empty()) {
    root.Fail("expected as many 'T_imu_cam' and 'resolution' as 'intrinsics'");
  }
  std::vector<CalibratedCamera> cameras;
  for (size_t i = 0; i < lenses.size(); ++i) {
    const Lens lens = ReadLensEntries(
        lenses[i].At("intrinsics"), lenses[i].At("camera_type").AsString(), BasaltLenses());
    CalibratedCamera camera =
        FromLens(lens, ReadImageSize(sizes[i]), BasaltLenses(), source.path.string());
    camera.name = fmt::format("cam{}", i);
    const auto number = [&](const char* key) { return poses[i].At(key).AsNumber(); };
    const Eigen::Quaterniond q(number("qw"), number("qx"), number("qy"), number("qz"));
    if (!(q.norm() > 0.5)) poses[i].Fail("expected a quaternion of length 1");
    camera.T_camera_rig =
        RigidTransform{q.normalized().matrix(), {number("px"), number("py"), number("pz")}}
            .Inverse();
    cameras.push_back(camera);
  }
  return cameras;
}

}  // namespace

CameraFormat BasaltFormat() {
  return {.name = "basalt",
          .file = "calibration.json",
          .most_cameras = kAnyNumber,
          .holds_extrinsics = true,
          .write = WriteBasalt,
          .read = ReadBasalt};
}

}  // namespace plenocal
