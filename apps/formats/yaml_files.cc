// SPDX-License-Identifier: Apache-2.0
//
// Plain YAML, and JSON and mrcal's Python dictionaries, which YAML's flow style includes.
// - Kalibr: T_cn_cnm1 maps camera n-1 to camera n. Double sphere: xi alpha fu fv pu pv.
// - mrcal: extrinsics map the reference to the camera, Rodrigues vector first.
// - basalt: T_imu_cam maps camera to IMU; here the IMU stands for the rig. Parameters by name.
// - MATLAB: the centre of the top-left pixel is (1, 1), sizes are rows, columns.
#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "apps/formats/formats.h"
#include "apps/undistort/rectify.h"
#include "calib/camera_yaml.h"
#include "calib/error.h"
#include "calib/text_file.h"
#include "calib/yaml.h"
#include "models/registry.h"
#include "models/splined.h"

namespace plenocal {
namespace {

constexpr size_t kAnyNumber = std::numeric_limits<size_t>::max();

// ROS camera_info

std::span<const LensForm> RosLenses() {
  static const std::vector<LensForm> kForms{
      {"pinhole", "plumb_bob", {"0", "0", "0", "0", "0"}},
      {"pinhole-radial3", "plumb_bob", {"A_0", "A_1", "0", "0", "A_2"}},
      {"pinhole-radtan4", "plumb_bob", {"k_1", "k_2", "p_1", "p_2", "0"}},
      {"pinhole-radtan", "plumb_bob", {"k_1", "k_2", "p_1", "p_2", "k_3"}},
      {"pinhole-radtan8",
       "rational_polynomial",
       {"k_1", "k_2", "p_1", "p_2", "k_3", "k_4", "k_5", "k_6"}},
      {"kannala-brandt4", "equidistant", {"k_1", "k_2", "k_3", "k_4"}}};
  return kForms;
}

/// `R` and `P` are those of a rectified pair, or nothing and the camera's own.
std::string RosFile(const CalibratedCamera& camera,
                    const Eigen::Matrix3d& R,
                    const std::array<double, 12>& P) {
  const Lens lens = ToLens(camera, RosLenses(), "ros");
  const auto matrix = [](const char* key, int rows, int cols, std::span<const double> data) {
    return fmt::format(
        "{}:\n  rows: {}\n  cols: {}\n  data: [{}]\n", key, rows, cols, RealList(data));
  };
  std::string text = fmt::format("image_width: {}\nimage_height: {}\ncamera_name: {}\n",
                                 camera.image_size[0],
                                 camera.image_size[1],
                                 camera.name);
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
  const Lens lens = ToLens(cameras[0], RosLenses(), "ros");
  return RosFile(cameras[0],
                 Eigen::Matrix3d::Identity(),
                 {lens.f_x, 0, lens.c_x, 0, 0, lens.f_y, lens.c_y, 0, 0, 0, 1, 0});
}

/// The baseline has its only place in the second P: f times the second camera's shift.
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
               RosLenses(),
               source.path.string());
  if (root.Has("camera_name")) camera.name = root.At("camera_name").AsString();
  if (root.Has("rectification_matrix") && root.Has("projection_matrix")) {
    // The rig is the rectified frame of the pair's first camera.
    const YamlNode rectification = root.At("rectification_matrix").At("data");
    const std::vector<double> P = root.At("projection_matrix").At("data").AsNumbers(12);
    camera.T_camera_rig =
        FromRectified(rectification.AsNumbers(9), P[0] != 0 ? P[3] / P[0] : 0, rectification);
  }
  return {camera};
}

// Kalibr camchain

std::span<const LensForm> KalibrLenses() {
  static const std::vector<LensForm> kForms{
      {"pinhole", "pinhole none", {}},
      {"pinhole-radial3", "pinhole radtan", {"A_0", "A_1", "0", "0"}},
      {"pinhole-radtan4", "pinhole radtan", {"k_1", "k_2", "p_1", "p_2"}},
      {"pinhole-radtan", "pinhole radtan", {"k_1", "k_2", "p_1", "p_2"}},
      {"kannala-brandt4", "pinhole equidistant", {"k_1", "k_2", "k_3", "k_4"}},
      {"fov", "pinhole fov", {"omega"}},
      {"eucm", "eucm none", {"alpha", "beta"}},
      {"double-sphere", "ds none", {"xi", "alpha"}},
      {"ucm", "omni none", {"alpha"}}};
  return kForms;
}

/// Kalibr's omni without distortion is the unified model by other parameters (models/ucm.h).
Lens ToOmni(const Lens& ucm) {
  const double scale = 1 / (1 - ucm.coefficients[0]);
  return {
      ucm.name, scale * ucm.f_x, scale * ucm.f_y, ucm.c_x, ucm.c_y, {scale * ucm.coefficients[0]}};
}

Lens FromOmni(const Lens& omni, const YamlNode& node) {
  if (omni.coefficients.empty()) node.At("intrinsics").Fail("expected xi fu fv pu pv");
  for (size_t i = 1; i < omni.coefficients.size(); ++i) {
    if (omni.coefficients[i] == 0) continue;
    node.At("camera_model")
        .Fail(
            "omni with distortion is no camera model of this plenocal; calibrate again with "
            "Kalibr's ds-none or eucm-none, or give its images or detections to 'plenocal "
            "calibrate'");
  }
  const double xi = omni.coefficients[0];
  if (!(xi > -1)) node.At("intrinsics").Fail("expected xi above -1");
  return {
      "omni none", omni.f_x / (1 + xi), omni.f_y / (1 + xi), omni.c_x, omni.c_y, {xi / (1 + xi)}};
}

std::string WriteKalibr(const std::vector<CalibratedCamera>& cameras) {
  std::string text;
  for (size_t i = 0; i < cameras.size(); ++i) {
    const CalibratedCamera& camera = cameras[i];
    Lens lens = ToLens(camera, KalibrLenses(), "kalibr");
    if (lens.name == "omni none") lens = ToOmni(lens);
    const size_t blank = lens.name.find(' ');
    const std::string projection = lens.name.substr(0, blank);
    // A projection's own parameters come before the focal lengths, distortion apart.
    std::vector<double> intrinsics, distortion;
    (projection == "pinhole" ? distortion : intrinsics) = lens.coefficients;
    for (const double value : {lens.f_x, lens.f_y, lens.c_x, lens.c_y}) intrinsics.push_back(value);
    text += fmt::format("cam{}:\n", i);
    if (i > 0) {
      const RigidTransform T = camera.T_camera_rig * cameras[i - 1].T_camera_rig.Inverse();
      text += "  T_cn_cnm1:\n";
      for (int r = 0; r < 3; ++r) {
        text += fmt::format("  - [{}]\n",
                            RealList(std::array{T.R(r, 0), T.R(r, 1), T.R(r, 2), T.t[r]}));
      }
      text += "  - [0.0, 0.0, 0.0, 1.0]\n";
    }
    text += fmt::format(
        "  cam_overlaps: []\n  camera_model: {}\n  distortion_coeffs: [{}]\n"
        "  distortion_model: {}\n  intrinsics: [{}]\n  resolution: [{}, {}]\n  rostopic: "
        "/{}/image_raw\n",
        projection,
        RealList(distortion),
        lens.name.substr(blank + 1),
        RealList(intrinsics),
        camera.image_size[0],
        camera.image_size[1],
        camera.name);
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
    const double* last = &intrinsics[intrinsics.size() - 4];
    Lens lens{fmt::format("{} {}", projection, distortion), last[0], last[1], last[2], last[3], {}};
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
      const YamlNode matrix = node.At("T_cn_cnm1");
      const auto rows = matrix.Elements();
      if (rows.size() != 4) matrix.Fail("expected the four rows of a 4 x 4 matrix");
      RigidTransform T;
      for (int r = 0; r < 3; ++r) {
        const std::vector<double> row = rows[static_cast<size_t>(r)].AsNumbers(4);
        T.R.row(r) << row[0], row[1], row[2];
        T.t[r] = row[3];
      }
      camera.T_camera_rig = T * cameras.back().T_camera_rig;
    }
    cameras.push_back(camera);
  }
  if (cameras.empty()) root.Fail("holds no cameras");
  return cameras;
}

// mrcal cameramodel

std::span<const LensForm> MrcalLenses() {
  static const std::vector<LensForm> kForms{
      {"pinhole", "LENSMODEL_PINHOLE", {}},
      {"pinhole-radial3", "LENSMODEL_OPENCV5", {"A_0", "A_1", "0", "0", "A_2"}},
      {"pinhole-radtan4", "LENSMODEL_OPENCV4", {"k_1", "k_2", "p_1", "p_2"}},
      {"pinhole-radtan", "LENSMODEL_OPENCV5", {"k_1", "k_2", "p_1", "p_2", "k_3"}},
      {"pinhole-radtan8",
       "LENSMODEL_OPENCV8",
       {"k_1", "k_2", "p_1", "p_2", "k_3", "k_4", "k_5", "k_6"}},
      {"pinhole-radtan12",
       "LENSMODEL_OPENCV12",
       {"k_1", "k_2", "p_1", "p_2", "k_3", "k_4", "k_5", "k_6", "s_1", "s_2", "s_3", "s_4"}}};
  return kForms;
}

// A spline's name holds its knots and its field of view.
std::string MrcalSpline(std::string_view fov_deg) {
  return fmt::format("LENSMODEL_SPLINED_STEREOGRAPHIC_order=3_Nx={}_Ny={}_fov_x_deg={}",
                     Splined::kColumns,
                     Splined::kRows,
                     fov_deg);
}

Lens ToMrcalSpline(const CalibratedCamera& camera) {
  const double fov = camera.params[Splined::kFov];
  if (fov != std::round(fov)) {
    throw Error(
        ErrorKind::kJob,
        fmt::format("camera '{}': mrcal's splines have a fov of whole degrees, this one has "
                    "{}; calibrate with 'initial: {{fov: {:.0f}}}'",
                    camera.name,
                    fov,
                    std::ceil(fov)));
  }
  return {MrcalSpline(fmt::format("{:.0f}", fov)),
          camera.params[0],
          camera.params[1],
          camera.params[2],
          camera.params[3],
          {camera.params.begin() + Splined::kFirstKnot, camera.params.end()}};
}

// `name` is that of a spline, `intrinsics` all that the file holds.
CalibratedCamera FromMrcalSpline(const YamlNode& name, const YamlNode& intrinsics) {
  const std::string prefix = MrcalSpline(""), text = name.AsString();
  const std::string fov_deg = text.starts_with(prefix) ? text.substr(prefix.size()) : "";
  const auto is_digit = [](char c) { return c >= '0' && c <= '9'; };
  if (fov_deg.empty() || fov_deg.size() > 3 || !std::ranges::all_of(fov_deg, is_digit)) {
    name.Fail(
        fmt::format("only splines of order 3 with {} x {} knots are read; make it one with "
                    "'mrcal-convert-lensmodel {} FILE'",
                    Splined::kColumns,
                    Splined::kRows,
                    MrcalSpline("...")));
  }
  CalibratedCamera camera;
  camera.model = FindModel(CameraModels(), Splined::kName);
  camera.params = intrinsics.AsNumbers(Splined::kParams.size() - 1);
  camera.params.insert(camera.params.begin() + Splined::kFov, std::stod(fov_deg));
  if (!WithinBounds(*camera.model, camera.params.data())) {
    intrinsics.Fail("f_x and f_y must be positive, fov_x_deg between 0 and 360");
  }
  return camera;
}

std::string WriteMrcal(const std::vector<CalibratedCamera>& cameras) {
  const CalibratedCamera& camera = cameras[0];
  const Lens lens = camera.model->name == Splined::kName ? ToMrcalSpline(camera)
                                                         : ToLens(camera, MrcalLenses(), "mrcal");
  std::vector<double> intrinsics{lens.f_x, lens.f_y, lens.c_x, lens.c_y};
  intrinsics.insert(intrinsics.end(), lens.coefficients.begin(), lens.coefficients.end());
  const Eigen::Vector3d w = LogRotation(camera.T_camera_rig.R), t = camera.T_camera_rig.t;
  return fmt::format(
      "{{\n    'lensmodel': '{}',\n    'intrinsics': [ {} ],\n    # rt_fromref\n"
      "    'extrinsics': [ {} ],\n    'imagersize': [ {}, {} ],\n}}\n",
      lens.name,
      RealList(intrinsics),
      RealList(std::array{w.x(), w.y(), w.z(), t.x(), t.y(), t.z()}),
      camera.image_size[0],
      camera.image_size[1]);
}

std::vector<std::string> WriteMrcalRig(const std::vector<CalibratedCamera>& cameras) {
  std::vector<std::string> files;
  files.reserve(cameras.size());
  for (const CalibratedCamera& camera : cameras) files.push_back(WriteMrcal({camera}));
  return files;
}

std::vector<CalibratedCamera> ReadMrcal(const CameraSource& source) {
  std::string text = ReadTextFile(source.path);
  // A packed blob that only mrcal reads.
  if (const size_t blob = text.find("'optimization_inputs'"); blob != std::string::npos) {
    const size_t end = text.find('\n', blob);
    text.erase(blob, end == std::string::npos ? end : end - blob);
  }
  const YamlNode root = YamlNode::Parse(text, source.path.string());
  const YamlNode lens = root.At(root.Has("lensmodel") ? "lensmodel" : "lens_model");
  CalibratedCamera camera;
  if (lens.AsString().starts_with("LENSMODEL_SPLINED")) {
    camera = FromMrcalSpline(lens, root.At("intrinsics"));
    camera.image_size = ReadImageSize(root.At("imagersize"));
  } else {
    const std::vector<double> intrinsics = root.At("intrinsics").AsNumbers(0);
    if (intrinsics.size() < 4) root.At("intrinsics").Fail("expected at least four numbers");
    camera = FromLens({lens.AsString(),
                       intrinsics[0],
                       intrinsics[1],
                       intrinsics[2],
                       intrinsics[3],
                       {intrinsics.begin() + 4, intrinsics.end()}},
                      ReadImageSize(root.At("imagersize")),
                      MrcalLenses(),
                      source.path.string());
  }
  const std::vector<double> rt = root.At("extrinsics").AsNumbers(6);
  camera.T_camera_rig = {ExpRotation({rt[0], rt[1], rt[2]}), {rt[3], rt[4], rt[5]}};
  return {camera};
}

// basalt calibration.json

std::span<const LensForm> BasaltLenses() {
  static const std::vector<LensForm> kForms{
      {"pinhole", "pinhole", {}},
      {"ucm", "ucm", {"alpha"}},
      {"eucm", "eucm", {"alpha", "beta"}},
      {"double-sphere", "ds", {"xi", "alpha"}},
      {"kannala-brandt4", "kb4", {"k_1", "k_2", "k_3", "k_4"}},
      {"pinhole-radial3", "pinhole-radtan8", {"A_0", "A_1", "0", "0", "A_2", "0", "0", "0"}},
      {"pinhole-radtan4", "pinhole-radtan8", {"k_1", "k_2", "p_1", "p_2", "0", "0", "0", "0"}},
      {"pinhole-radtan", "pinhole-radtan8", {"k_1", "k_2", "p_1", "p_2", "k_3", "0", "0", "0"}},
      {"pinhole-radtan8",
       "pinhole-radtan8",
       {"k_1", "k_2", "p_1", "p_2", "k_3", "k_4", "k_5", "k_6"}}};
  return kForms;
}

/// Names of a lens' own parameters in basalt's files.
std::vector<std::string> BasaltNames(const std::string& type) {
  if (type == "ucm") return {"alpha"};
  if (type == "eucm") return {"alpha", "beta"};
  if (type == "ds") return {"xi", "alpha"};
  if (type == "kb4") return {"k1", "k2", "k3", "k4"};
  if (type == "pinhole-radtan8") return {"k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6"};
  return {};
}

std::string WriteBasalt(const std::vector<CalibratedCamera>& cameras) {
  std::string poses, lenses, sizes;
  for (const CalibratedCamera& camera : cameras) {
    const Lens lens = ToLens(camera, BasaltLenses(), "basalt");
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
    std::string values = fmt::format(R"("fx": {}, "fy": {}, "cx": {}, "cy": {})",
                                     RealText(lens.f_x),
                                     RealText(lens.f_y),
                                     RealText(lens.c_x),
                                     RealText(lens.c_y));
    const std::vector<std::string> names = BasaltNames(lens.name);
    for (size_t i = 0; i < names.size(); ++i) {
      values += fmt::format(R"(, "{}": {})", names[i], RealText(lens.coefficients[i]));
    }
    if (lens.name == "pinhole-radtan8") values += R"(, "rpmax": 0.0)";
    lenses += fmt::format(R"({}
      {{"camera_type": "{}", "intrinsics": {{{}}}}})",
                          comma,
                          lens.name,
                          values);
    sizes += fmt::format("{}[{}, {}]", comma, camera.image_size[0], camera.image_size[1]);
  }
  // What a camera calibration does not know has the values that basalt itself starts with.
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
    const YamlNode values = lenses[i].At("intrinsics");
    const std::string type = lenses[i].At("camera_type").AsString();
    Lens lens{type,
              values.At("fx").AsNumber(),
              values.At("fy").AsNumber(),
              values.At("cx").AsNumber(),
              values.At("cy").AsNumber(),
              {}};
    for (const std::string& name : BasaltNames(type)) {
      lens.coefficients.push_back(values.At(name).AsNumber());
    }
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

// MATLAB: JSON for jsondecode, then cameraIntrinsics; of a pair stereoParameters

std::span<const LensForm> MatlabLenses() { return OpenCvLenses().first(4); }

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
  const RigidTransform T = cameras[1].T_camera_rig * cameras[0].T_camera_rig.Inverse();
  std::string rows;
  for (int r = 0; r < 3; ++r) {
    rows += fmt::format("[{}], ", RealList(std::array{T.R(r, 0), T.R(r, 1), T.R(r, 2), T.t[r]}));
  }
  return fmt::format(
      "{{\n  \"Camera1\": {},\n  \"Camera2\": {},\n  \"PoseCamera2\": [{}[0.0, 0.0, 0.0, "
      "1.0]]\n}}\n",
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
  const YamlNode matrix = root.At("PoseCamera2");
  const auto rows = matrix.Elements();
  if (rows.size() != 4) matrix.Fail("expected the four rows of a 4 x 4 matrix");
  for (int r = 0; r < 3; ++r) {
    const std::vector<double> row = rows[static_cast<size_t>(r)].AsNumbers(4);
    cameras[1].T_camera_rig.R.row(r) << row[0], row[1], row[2];
    cameras[1].T_camera_rig.t[r] = row[3];
  }
  return cameras;
}

}  // namespace

CameraFormat RosFormat() {
  return {"ros", "camera_info.yaml", 2, true, WriteRos, ReadRos, WriteRosPair};
}
CameraFormat KalibrFormat() {
  return {"kalibr", "camchain.yaml", kAnyNumber, true, WriteKalibr, ReadKalibr};
}
CameraFormat MrcalFormat() {
  return {"mrcal", "camera.cameramodel", kAnyNumber, true, WriteMrcal, ReadMrcal, WriteMrcalRig};
}
CameraFormat BasaltFormat() {
  return {"basalt", "calibration.json", kAnyNumber, true, WriteBasalt, ReadBasalt};
}
CameraFormat MatlabFormat() { return {"matlab", "camera.json", 2, true, WriteMatlab, ReadMatlab}; }

MatlabIntrinsics ToMatlab(const CalibratedCamera& camera) {
  Lens lens = ToLens(camera, MatlabLenses(), "matlab");
  lens.coefficients.resize(5);
  const std::vector<double>& k = lens.coefficients;
  return {{lens.f_x, lens.f_y},
          {lens.c_x + 1, lens.c_y + 1},
          {static_cast<double>(camera.image_size[1]), static_cast<double>(camera.image_size[0])},
          {k[0], k[1], k[4]},
          {k[2], k[3]}};
}

CalibratedCamera FromMatlab(const MatlabIntrinsics& m, const std::string& where) {
  std::vector<double> radial = m.radial_distortion;
  radial.resize(3);
  const auto centre = [](double value) {
    return Inverted(value, value - 1, [](double x) { return x + 1; });
  };
  return FromLens(
      {"radtan",
       m.focal_length[0],
       m.focal_length[1],
       centre(m.principal_point[0]),
       centre(m.principal_point[1]),
       {radial[0], radial[1], m.tangential_distortion[0], m.tangential_distortion[1], radial[2]}},
      {static_cast<int>(m.image_size[1]), static_cast<int>(m.image_size[0])},
      MatlabLenses(),
      where);
}

}  // namespace plenocal
