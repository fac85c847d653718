// SPDX-License-Identifier: Apache-2.0
//
// .sfm of AliceVision (Meshroom): JSON whose numbers are texts. The views are those of openmvg.cc.
//
// Source: AliceVision, src/aliceVision/sfmDataIO/jsonIO.{hpp,cpp} (version 1.2.6),
// camera/{DistortionRadial,DistortionBrown,DistortionFisheye,DistortionFisheye1,Equidistant}.cpp.
// With focalLength F and sensorWidth S, mm, and the offset o of the principal point:
//
//   f_x = F / S width,  f_y = f_x pixelRatio,  c = size / 2 + o,
//   equidistant: f = 2 R F / S' width / max(width, height), R = fisheyeCircleRadius, and S' the
//   shorter side of the sensor
//
// (0, 0) is the centre of the first pixel where images are resampled
// (camera/cameraUndistortImage.hpp with image/Sampler.hpp).
#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <map>

#include "calib/base/quoted_text.h"
#include "calib/io/yaml.h"
#include "engine/formats/camera_format.h"
#include "engine/formats/exact_numbers.h"
#include "engine/formats/lens_form.h"
#include "engine/formats/pose_matrices.h"

namespace plenocal {
namespace {

constexpr double kSensorWidth = 36;  // mm, as AliceVision takes for an unknown sensor

/// By the types of version 1.2.6.
const LensTable& AliceVisionLenses() {
  static const LensTable kTable{"alicevision",
                                {{"pinhole", "pinhole", ""},
                                 {"pinhole-radial3", "radial3", "A_0 A_1 A_2"},
                                 {"pinhole-radial3", "radial1", "A_0"},
                                 {"pinhole-radtan4", "brown", "k_1 k_2 0 p_1 p_2"},
                                 {"pinhole-radtan", "brown", "k_1 k_2 k_3 p_1 p_2"},
                                 {"kannala-brandt4", "fisheye4", "k_1 k_2 k_3 k_4"},
                                 {"fov", "fisheye1", "omega"},
                                 {"equidistant", "equidistant", ""}}};
  return kTable;
}

/// The type of version 1.2.6 for a later one's type and distortion.
std::string TypeOf(const std::string& type, const std::string& distortion) {
  if (distortion.empty() || distortion == "none" || type != "pinhole") {
    return distortion.empty() || distortion == "none" ? type : type + " " + distortion;
  }
  static const std::map<std::string_view, const char*> kTypes{{"radialk1", "radial1"},
                                                              {"radialk3", "radial3"},
                                                              {"brown", "brown"},
                                                              {"fisheye", "fisheye4"},
                                                              {"fisheye1", "fisheye1"}};
  const auto found = kTypes.find(distortion);
  return found == kTypes.end() ? distortion : found->second;
}

std::string TextList(std::span<const double> values) {
  std::string text;
  for (const double value : values) {
    text += fmt::format(R"({}"{}")", text.empty() ? "" : ", ", RealText(value));
  }
  return text;
}

std::string AliceIntrinsic(const CalibratedCamera& camera, size_t id) {
  const Lens lens = ToLens(camera, AliceVisionLenses());
  const auto [width, height] = camera.image_size;
  const int w = width, h = height;
  const double focal = Inverted(
      lens.f_x, lens.f_x * kSensorWidth / w, [&](double x) { return x / kSensorWidth * w; });
  const double ratio =
      Inverted(lens.f_y, lens.f_y / lens.f_x, [&](double x) { return lens.f_x / (1 / x); });
  std::string circle;
  if (lens.name == "equidistant") {
    RequireOneFocalLength(camera, lens, "alicevision's equidistant camera");
    circle = fmt::format(
        R"(, "fisheyeCircleCenterX": "{}", "fisheyeCircleCenterY": "{}", "fisheyeCircleRadius": "{}")",
        RealText(lens.c_x),
        RealText(lens.c_y),
        RealText(std::min(w, h) / 2.0));
  }
  return fmt::format(
      R"({{"intrinsicId": "{}", "width": "{}", "height": "{}", "sensorWidth": "{}", )"
      R"("sensorHeight": "{}", "serialNumber": "", "type": "{}", )"
      R"("initializationMode": "calibrated", "initialFocalLength": "{}", "focalLength": "{}", )"
      R"("pixelRatio": "{}", "pixelRatioLocked": "true", "principalPoint": [{}], )"
      R"("distortionInitializationMode": "calibrated", "distortionParams": [{}], )"
      R"("undistortionOffset": ["0", "0"], "undistortionParams": ""{}, "locked": "true"}})",
      id,
      w,
      h,
      RealText(kSensorWidth),
      RealText(kSensorWidth * h / w),
      lens.name,
      RealText(focal),
      RealText(focal),
      RealText(ratio),
      TextList(std::array{lens.c_x - w / 2.0, lens.c_y - h / 2.0}),
      TextList(lens.coefficients),
      circle);
}

std::string AliceSfm(const std::vector<CalibratedCamera>& cameras,
                     const std::vector<ViewImage>& images) {
  std::string views, intrinsics, poses;
  for (size_t i = 0; i < images.size(); ++i) {
    const auto& [camera, file, T] = images[i];
    const char* const comma = i == 0 ? "" : ",";
    views += fmt::format(
        R"({}
    {{"viewId": "{}", "poseId": "{}", "intrinsicId": "{}", "path": {}, "width": "{}", "height": "{}"}})",
        comma,
        i,
        i,
        camera,
        YamlQuoted(file),
        cameras[camera].image_size[0],
        cameras[camera].image_size[1]);
    const Eigen::Vector3d centre = T.Inverse().t;
    poses += fmt::format(
        R"({}
    {{"poseId": "{}", "pose": {{"transform": {{"rotation": [{}], "center": [{}]}}, "locked": "1"}}}})",
        comma,
        i,
        TextList(std::span(T.R.data(), 9)),  // column by column
        TextList(std::span(centre.data(), 3)));
  }
  for (size_t i = 0; i < cameras.size(); ++i) {
    intrinsics += fmt::format("{}\n    {}", i == 0 ? "" : ",", AliceIntrinsic(cameras[i], i));
  }
  return fmt::format(
      "{{\n  \"version\": [\"1\", \"2\", \"6\"],\n  \"views\": [{}\n  ],\n"
      "  \"intrinsics\": [{}\n  ],\n  \"poses\": [{}\n  ]\n}}\n",
      views,
      intrinsics,
      poses);
}

std::string WriteAliceVision(const std::vector<CalibratedCamera>& cameras) {
  return AliceSfm(cameras, RigImages(cameras));
}

std::vector<std::pair<std::string, std::string>> WriteAliceVisionModel(
    const CalibrationRecord& calibration, const std::vector<size_t>& cameras) {
  std::vector<CalibratedCamera> chosen;
  for (const size_t camera : cameras) chosen.push_back(calibration.cameras[camera]);
  return {{"cameras.sfm", AliceSfm(chosen, ViewImages(calibration, cameras))}};
}

CalibratedCamera ReadAliceIntrinsic(const YamlNode& node,
                                    bool ratio_is_inverse,
                                    const std::string& where) {
  const auto number = [&](const char* key, double otherwise) {
    return node.Has(key) ? node.At(key).AsNumber() : otherwise;
  };
  const auto text = [&](const char* key) {
    return node.Has(key) ? node.At(key).AsString() : std::string();
  };
  if (const std::string type = text("undistortionType"); !type.empty() && type != "none") {
    node.At("undistortionType").Fail("a distortion of 3DEqualizer is not read");
  }
  const ImageSize size{node.At("width").AsInteger(), node.At("height").AsInteger()};
  const double sensor = number("sensorWidth", kSensorWidth);
  const double ratio = number("pixelRatio", 1);
  const std::vector<double> offset = node.At("principalPoint").AsNumbers(2);
  const double f_x = node.At("focalLength").AsNumber() / sensor * size[0];
  Lens lens{TypeOf(node.At("type").AsString(), text("distortionType")),
            f_x,
            ratio_is_inverse ? f_x / ratio : f_x / (1 / ratio),
            size[0] / 2.0 + offset[0],
            size[1] / 2.0 + offset[1],
            {}};
  if (node.Has("distortionParams") && node.At("distortionParams").IsSequence()) {
    lens.coefficients = node.At("distortionParams").AsNumbers(0);
  }
  if (lens.name == "radialk3pt") {  // divided by 1 + k1 + k2 + k3
    double sum = 1;
    for (const double k : lens.coefficients) sum += k;
    lens.name = "radial3";
    lens.f_x /= sum;
    lens.f_y /= sum;
  } else if (lens.name == "equidistant") {
    const double shorter = std::min(sensor, number("sensorHeight", 24));
    const double millimetres = f_x * sensor / std::max(size[0], size[1]);
    lens.f_x = lens.f_y = 2 * node.At("fisheyeCircleRadius").AsNumber() * millimetres / shorter;
  }
  return FromLens(lens, size, AliceVisionLenses(), where);
}

/// Gives the cameras, of these ids, names and extrinsics by their images.
void ReadAliceViews(const YamlNode& root,
                    const std::map<std::string, size_t>& cameras_by_id,
                    std::vector<CalibratedCamera>* cameras) {
  std::map<std::string, RigidTransform> poses;
  if (root.Has("poses")) {
    for (const YamlNode& node : root.At("poses").Elements()) {
      const YamlNode transform = node.At("pose").At("transform");
      const std::vector<double> R = transform.At("rotation").AsNumbers(9);
      poses[node.At("poseId").AsString()] = CameraAt(Eigen::Map<const Eigen::Matrix3d>(R.data()),
                                                     transform.At("center").AsNumbers(3));
    }
  }
  std::vector<ViewImage> images;
  bool posed = true;
  for (const YamlNode& view : root.At("views").Elements()) {
    const auto camera = cameras_by_id.find(view.At("intrinsicId").AsString());
    if (camera == cameras_by_id.end()) continue;
    const auto pose = poses.find(view.At("poseId").AsString());
    posed = posed && pose != poses.end() && !view.Has("rigId");
    images.push_back({camera->second,
                      view.At("path").AsString(),
                      pose == poses.end() ? RigidTransform() : pose->second});
  }
  TakeRigImages(images, posed, cameras);
}

std::vector<CalibratedCamera> ReadAliceVision(const CameraSource& source) {
  const YamlNode root = YamlNode::ReadFile(source.path);
  const std::vector<double> parts = root.At("version").AsNumbers(3);
  const double version = 1e6 * parts[0] + 1e3 * parts[1] + parts[2];
  if (version < 1'002'002) {
    root.At("version").Fail("files before 1.2.2 are not read; save it with Meshroom 2023 or later");
  }
  const bool ratio_is_inverse = version < 1'002'005;
  std::map<std::string, size_t> by_id;
  std::vector<CalibratedCamera> cameras;
  for (const YamlNode& node : root.At("intrinsics").Elements()) {
    const std::string id = node.At("intrinsicId").AsString();
    by_id[id] = cameras.size();
    cameras.push_back(ReadAliceIntrinsic(
        node, ratio_is_inverse, fmt::format("{}:{}", source.path.string(), node.Line())));
    cameras.back().name = "camera" + id;
  }
  if (cameras.empty()) root.At("intrinsics").Fail("holds no cameras");
  if (root.Has("views")) ReadAliceViews(root, by_id, &cameras);
  return cameras;
}

}  // namespace

CameraFormat AlicevisionFormat() {
  return {.name = "alicevision",
          .file = "cameras.sfm",
          .most_cameras = kAnyNumber,
          .holds_extrinsics = true,
          .write = WriteAliceVision,
          .read = ReadAliceVision,
          .write_model = WriteAliceVisionModel};
}

}  // namespace plenocal
