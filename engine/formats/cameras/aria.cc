// SPDX-License-Identifier: Apache-2.0
//
// Factory calibration of Project Aria's glasses: "CameraCalibrations" of calibration.json, whose
// other sensors are left out. T_Device_Camera maps the camera to the device, here the rig.
//
// Source: facebookresearch/projectaria_tools, core/calibration/loader/SensorCalibrationJson.cpp
// (labels, sizes) and camera_projections/{FisheyeRadTanThinPrism,KannalaBrandtK3}.h: parameters
// f_u [f_v] c_u c_v k p s, where p_0 is OpenCV's p_2; by scaleParams (0, 0) is the centre of the
// first pixel.
#include <fmt/format.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <array>

#include "calib/base/quoted_text.h"
#include "calib/io/yaml.h"
#include "engine/formats/camera_format.h"
#include "engine/formats/exact_numbers.h"
#include "engine/formats/lens_form.h"

namespace plenocal {
namespace {

const LensTable& AriaLenses() {
  static const LensTable kTable{
      "aria",
      {{"equidistant+radial6+prism",
        "FisheyeRadTanThinPrism",
        "k_1 k_2 k_3 k_4 k_5 k_6 p_2 p_1 s_1 s_2 s_3 s_4"},
       {"equidistant+radial6+decentring", "Fisheye62", "k_1 k_2 k_3 k_4 k_5 k_6 p_2 p_1"},
       {"kannala-brandt4", "KannalaBrandtK3", "k_1 k_2 k_3 k_4"},
       {"equidistant", "KannalaBrandtK3", "0 0 0 0"}}};
  return kTable;
}

/// The size of the calibrated images by the camera's label; files of recordings do not hold it.
std::optional<ImageSize> SizeOfLabel(std::string_view label) {
  if (label == "camera-rgb") return ImageSize{2880, 2880};
  for (const char* other :
       {"camera-slam-left", "camera-slam-right", "camera-et-left", "camera-et-right"}) {
    if (label == other) return ImageSize{640, 480};
  }
  return std::nullopt;
}

std::string WriteAria(const std::vector<CalibratedCamera>& cameras) {
  std::string text;
  for (const CalibratedCamera& camera : cameras) {
    const Lens lens = ToLens(camera, AriaLenses());
    std::vector<double> params = lens.Numbers();
    if (lens.name != "KannalaBrandtK3") {
      // projectaria-tools 2.3.0 takes a second focal length for the centre.
      RequireOneFocalLength(camera, lens, "aria");
      params.erase(params.begin());
    }
    const RigidTransform T_rig_camera = camera.T_camera_rig.Inverse();
    const Eigen::Quaterniond q(T_rig_camera.R);
    text += fmt::format(
        R"({}
    {{"Calibrated": true, "Label": {}, "SerialNumber": "",
     "ConfigData": {{"ImageHeight": {}, "ImageWidth": {}, "MaxSolidAngle": 1.5707963267948966}},
     "Projection": {{"Name": "{}", "Params": [{}]}},
     "T_Device_Camera": {{"Translation": [{}], "UnitQuaternion": [{}, [{}]]}}}})",
        text.empty() ? "" : ",",
        YamlQuoted(camera.name),
        camera.image_size[1],
        camera.image_size[0],
        lens.name,
        RealList(params),
        RealList(std::span(T_rig_camera.t.data(), 3)),
        RealText(q.w()),
        RealList(std::array{q.x(), q.y(), q.z()}));
  }
  return fmt::format(
      "{{\n  \"DeviceClassInfo\": {{\"BuildVersion\": \"DVT-S\", \"DeviceClass\": \"Aria\"}},\n"
      "  \"OriginSpecification\": {{\"Type\": \"Custom\", \"ChildLabel\": {}}},\n"
      "  \"CameraCalibrations\": [{}\n  ]\n}}\n",
      YamlQuoted(cameras[0].name),
      text);
}

CalibratedCamera ReadAriaCamera(const YamlNode& node, const CameraSource& source) {
  const std::string label = node.At("Label").AsString();
  std::optional<ImageSize> size = SizeOfLabel(label);
  if (!size) size = source.image_size;
  if (const auto config = node.Find("ConfigData")) {
    size = {config->At("ImageWidth").AsInteger(), config->At("ImageHeight").AsInteger()};
  }
  if (!size) node.At("Label").Fail("no size is known for this label; give --size WIDTHxHEIGHT");
  const YamlNode projection = node.At("Projection");
  const std::string name = projection.At("Name").AsString();
  std::vector<double> params = projection.At("Params").AsNumbers(0);
  const auto form = std::ranges::find(AriaLenses().forms, name, &LensForm::name);
  if (form != AriaLenses().forms.end()) {
    const size_t most = form->coefficients.size() + 4;
    if (params.size() + 1 == most) params.insert(params.begin(), params.empty() ? 0 : params[0]);
    if (params.size() != most) {
      projection.At("Params").Fail(fmt::format("expected {} or {} numbers", most - 1, most));
    }
  }
  if (params.size() < 4) projection.At("Params").Fail("expected at least four numbers");
  CalibratedCamera camera = FromLens(LensOfNumbers(name, params),
                                     *size,
                                     AriaLenses(),
                                     fmt::format("{}:{}", source.path.string(), projection.Line()));
  camera.name = label;
  const YamlNode pose = node.At("T_Device_Camera");
  const std::vector<YamlNode> parts = pose.At("UnitQuaternion").Elements();
  if (parts.size() != 2) pose.At("UnitQuaternion").Fail("expected [w, [x, y, z]]");
  const std::vector<double> imaginary = parts[1].AsNumbers(3);
  const Eigen::Quaterniond q(parts[0].AsNumber(), imaginary[0], imaginary[1], imaginary[2]);
  if (!(q.norm() > 0.5)) pose.At("UnitQuaternion").Fail("expected a quaternion of length 1");
  const std::vector<double> t = pose.At("Translation").AsNumbers(3);
  camera.T_camera_rig = RigidTransform{q.normalized().matrix(), {t[0], t[1], t[2]}}.Inverse();
  return camera;
}

std::vector<CalibratedCamera> ReadAria(const CameraSource& source) {
  const YamlNode root = YamlNode::ReadFile(source.path);
  std::vector<CalibratedCamera> cameras;
  for (const YamlNode& node : root.At("CameraCalibrations").Elements()) {
    cameras.push_back(ReadAriaCamera(node, source));
  }
  if (cameras.empty()) root.At("CameraCalibrations").Fail("holds no cameras");
  return cameras;
}

}  // namespace

CameraFormat AriaFormat() {
  return {.name = "aria",
          .file = "calibration.json",
          .most_cameras = kAnyNumber,
          .holds_extrinsics = true,
          .write = WriteAria,
          .read = ReadAria};
}

}  // namespace plenocal
