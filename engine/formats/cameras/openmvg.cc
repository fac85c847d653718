// SPDX-License-Identifier: Apache-2.0
//
// sfm_data.json of openMVG. Without frames it has one view a camera, `<camera>.png`, whose pose is
// that of the camera in the rig; a folder has the views of all frames in the target's frame. A pose
// has the rotation into the camera and the camera's centre.
//
// Source: openMVG, src/openMVG/cameras/Camera_*_io.hpp, sfm/sfm_data_io_cereal.cpp and
// geometry/pose3_io.hpp; (0, 0) is the centre of the first pixel in Camera_undistort_image.hpp with
// image/sample.hpp. JSON is that of cereal: an object names its type where the type is first met.
#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cstdint>
#include <limits>
#include <map>
#include <numbers>

#include "calib/base/quoted_text.h"
#include "calib/io/yaml.h"
#include "engine/formats/camera_format.h"
#include "engine/formats/exact_numbers.h"
#include "engine/formats/lens_form.h"
#include "engine/formats/pose_matrices.h"

namespace plenocal {
namespace {

constexpr std::uint32_t kFirst = 0x80000000;      // bit of an id that is met for the first time
constexpr std::uint32_t kExactType = 0x40000000;  // polymorphic_id of what is no derived type
constexpr std::string_view kSpherical = "spherical";

const LensTable& OpenMvgLenses() {
  static const LensTable kTable{"openmvg",
                                {{"pinhole", "pinhole", ""},
                                 {"pinhole-radial3", "pinhole_radial_k3", "A_0 A_1 A_2"},
                                 {"pinhole-radial3", "pinhole_radial_k1", "A_0"},
                                 {"pinhole-radtan4", "pinhole_brown_t2", "k_1 k_2 0 p_1 p_2"},
                                 {"pinhole-radtan", "pinhole_brown_t2", "k_1 k_2 k_3 p_1 p_2"},
                                 {"kannala-brandt4", "fisheye", "k_1 k_2 k_3 k_4"},
                                 {"equidistant", "fisheye", "0 0 0 0"}}};
  return kTable;
}

/// Key of the coefficients of a lens.
const char* DistortionKey(const std::string& lens) {
  static const std::map<std::string_view, const char*> kKeys{{"pinhole_radial_k3", "disto_k3"},
                                                             {"pinhole_radial_k1", "disto_k1"},
                                                             {"pinhole_brown_t2", "disto_t2"},
                                                             {"fisheye", "fisheye"}};
  const auto found = kKeys.find(lens);
  return found == kKeys.end() ? nullptr : found->second;
}

/// Camera_Spherical.hpp; of openMVG 2, where y points down in the image.
std::array<double, 4> PanoramaParams(ImageSize size) {
  const double f = std::max(size[0], size[1]) / (2 * std::numbers::pi);
  return {f, f, size[0] / 2.0, size[1] / 2.0};
}

/// Type and content of an intrinsic.
std::pair<std::string, std::string> Intrinsic(const CalibratedCamera& camera) {
  const std::string size =
      fmt::format(R"("width": {}, "height": {})", camera.image_size[0], camera.image_size[1]);
  if (camera.model->name == kSpherical) {
    CheckPanorama(camera, PanoramaParams(camera.image_size), "openmvg");
    return {std::string(kSpherical), fmt::format(R"("value0": {{{}}})", size)};
  }
  const Lens lens = ToLens(camera, OpenMvgLenses());
  RequireOneFocalLength(camera, lens, "openmvg");
  std::string content = fmt::format(R"({}, "focal_length": {}, "principal_point": [{}])",
                                    size,
                                    RealText(lens.f_x),
                                    RealList(std::array{lens.c_x, lens.c_y}));
  if (const char* const key = DistortionKey(lens.name)) {
    content += fmt::format(R"(, "{}": [{}])", key, RealList(lens.coefficients));
  }
  return {lens.name, content};
}

/// Adds an element to a list, each in a line of its own.
void AddElement(const std::string& element, std::string* list) {
  *list += fmt::format("{}\n    {}", list->empty() ? "" : ",", element);
}

std::string SfmData(const std::vector<CalibratedCamera>& cameras,
                    const std::vector<ViewImage>& images) {
  std::string views, intrinsics, poses;
  std::uint32_t objects = 0, types = 0;
  for (size_t i = 0; i < images.size(); ++i) {
    const auto& [camera, file, T] = images[i];
    AddElement(
        fmt::format(
            R"({{"key": {0}, "value": {{"polymorphic_id": {1}, "ptr_wrapper": {{"id": {2}, "data": )"
            R"({{"local_path": "", "filename": {3}, "width": {4}, "height": {5}, "id_view": {0}, )"
            R"("id_intrinsic": {6}, "id_pose": {0}}}}}}}}})",
            i,
            kExactType,
            kFirst | ++objects,
            YamlQuoted(file),
            cameras[camera].image_size[0],
            cameras[camera].image_size[1],
            camera),
        &views);
    std::string rotation;
    for (int r = 0; r < 3; ++r) {
      rotation += fmt::format(
          "{}[{}]", r == 0 ? "" : ", ", RealList(std::array{T.R(r, 0), T.R(r, 1), T.R(r, 2)}));
    }
    const Eigen::Vector3d centre = T.Inverse().t;
    AddElement(fmt::format(R"({{"key": {}, "value": {{"rotation": [{}], "center": [{}]}}}})",
                           i,
                           rotation,
                           RealList(std::span(centre.data(), 3))),
               &poses);
  }
  std::map<std::string, std::uint32_t> type_ids;
  for (size_t i = 0; i < cameras.size(); ++i) {
    const auto [type, content] = Intrinsic(cameras[i]);
    const auto [id, is_new] = type_ids.try_emplace(type, types + 1);
    if (is_new) ++types;
    AddElement(
        fmt::format(R"({{"key": {}, "value": {{"polymorphic_id": {}, {}"ptr_wrapper": {{"id": )"
                    R"({}, "data": {{{}}}}}}}}})",
                    i,
                    is_new ? kFirst | id->second : id->second,
                    is_new ? fmt::format(R"("polymorphic_name": "{}", )", type) : "",
                    kFirst | ++objects,
                    content),
        &intrinsics);
  }
  return fmt::format(
      "{{\n  \"sfm_data_version\": \"0.3\",\n  \"root_path\": \"\",\n  \"views\": [{}\n  ],\n"
      "  \"intrinsics\": [{}\n  ],\n  \"extrinsics\": [{}\n  ],\n  \"structure\": [],\n"
      "  \"control_points\": []\n}}\n",
      views,
      intrinsics,
      poses);
}

std::string WriteOpenMvg(const std::vector<CalibratedCamera>& cameras) {
  return SfmData(cameras, RigImages(cameras));
}

std::vector<std::pair<std::string, std::string>> WriteOpenMvgModel(
    const CalibrationRecord& calibration, const std::vector<size_t>& cameras) {
  std::vector<CalibratedCamera> chosen;
  for (const size_t camera : cameras) chosen.push_back(calibration.cameras[camera]);
  return {{"sfm_data.json", SfmData(chosen, ViewImages(calibration, cameras))}};
}

/// A number of 32 bits, of which the largest stands for none.
int Id(const YamlNode& node) {
  const double id = node.AsNumber();
  return id >= 0 && id <= std::numeric_limits<int>::max() ? static_cast<int>(id) : -1;
}

CalibratedCamera ReadIntrinsic(const YamlNode& data,
                               const std::string& type,
                               const std::string& file) {
  // The content of a base class is in an object of its own.
  const YamlNode base = data.Find("value0").value_or(data);
  const ImageSize size{base.At("width").AsInteger(), base.At("height").AsInteger()};
  if (type == kSpherical) return PanoramaCamera(size, PanoramaParams(size));
  const double f = data.At("focal_length").AsNumber();
  const std::vector<double> c = data.At("principal_point").AsNumbers(2);
  Lens lens{type, f, f, c[0], c[1], {}};
  if (const char* const key = DistortionKey(type)) lens.coefficients = data.At(key).AsNumbers(0);
  return FromLens(lens, size, OpenMvgLenses(), fmt::format("{}:{}", file, data.Line()));
}

/// Gives the cameras, of these keys, names and extrinsics by their images.
void ReadViews(const YamlNode& root,
               const std::map<int, size_t>& cameras_by_key,
               std::vector<CalibratedCamera>* cameras) {
  std::map<int, RigidTransform> poses;
  for (const YamlNode& node : root.At("extrinsics").Elements()) {
    const YamlNode rotation = node.At("value").At("rotation");
    const std::vector<YamlNode> rows = rotation.Elements();
    if (rows.size() != 3) rotation.Fail("expected three rows");
    Eigen::Matrix3d R;
    for (int r = 0; r < 3; ++r) {
      const std::vector<double> row = rows[static_cast<size_t>(r)].AsNumbers(3);
      R.row(r) = Eigen::Map<const Eigen::RowVector3d>(row.data());
    }
    poses[node.At("key").AsInteger()] = CameraAt(R, node.At("value").At("center").AsNumbers(3));
  }
  std::vector<ViewImage> images;
  bool posed = true;
  for (const YamlNode& view : root.At("views").Elements()) {
    const YamlNode data = view.At("value").At("ptr_wrapper").At("data");
    const auto camera = cameras_by_key.find(Id(data.At("id_intrinsic")));
    if (camera == cameras_by_key.end()) continue;
    const auto pose = poses.find(Id(data.At("id_pose")));
    posed = posed && pose != poses.end();
    images.push_back({camera->second,
                      data.At("filename").AsString(),
                      pose == poses.end() ? RigidTransform() : pose->second});
  }
  TakeRigImages(images, posed, cameras);
}

std::vector<CalibratedCamera> ReadOpenMvg(const CameraSource& source) {
  const YamlNode root = YamlNode::ReadFile(source.path);
  std::map<std::uint32_t, std::string> types;
  std::map<int, size_t> by_key;
  std::vector<CalibratedCamera> cameras;
  for (const YamlNode& intrinsic : root.At("intrinsics").Elements()) {
    const YamlNode value = intrinsic.At("value");
    const double number = value.At("polymorphic_id").AsNumber();
    if (!(number >= 0 && number < 0x1p32)) value.At("polymorphic_id").Fail("expected 32 bits");
    const std::uint32_t id = static_cast<std::uint32_t>(number) & ~kFirst;
    if (value.Has("polymorphic_name")) types[id] = value.At("polymorphic_name").AsString();
    if (!types.contains(id))
      value.At("polymorphic_id").Fail("expected 'polymorphic_name' beside it");
    const int key = intrinsic.At("key").AsInteger();
    cameras.push_back(
        ReadIntrinsic(value.At("ptr_wrapper").At("data"), types[id], source.path.string()));
    cameras.back().name = fmt::format("camera{}", key);
    by_key[key] = cameras.size() - 1;
  }
  if (cameras.empty()) root.At("intrinsics").Fail("holds no cameras");
  ReadViews(root, by_key, &cameras);
  return cameras;
}

}  // namespace

CameraFormat OpenmvgFormat() {
  return {.name = "openmvg",
          .file = "sfm_data.json",
          .most_cameras = kAnyNumber,
          .holds_extrinsics = true,
          .write = WriteOpenMvg,
          .read = ReadOpenMvg,
          .write_model = WriteOpenMvgModel};
}

}  // namespace plenocal
