// SPDX-License-Identifier: Apache-2.0
//
// YAML of OpenCV's calibration programs. R, T map camera 1 to camera 2.
#include <fmt/format.h>

#include <array>
#include <filesystem>

#include "calib/base/format_error.h"
#include "engine/formats/camera_format.h"
#include "engine/formats/lens_form.h"
#include "engine/formats/opencv_storage.h"
#include "engine/formats/pose_matrices.h"

namespace plenocal {
namespace {

/// The value of the first of `keys` that the file has.
std::optional<YamlNode> Find(const YamlNode& root, std::span<const std::string> keys) {
  for (const std::string& key : keys) {
    if (root.Has(key)) return root.At(key);
  }
  return std::nullopt;
}

ImageSize SizeOf(const YamlNode& root, const std::string& suffix, const CameraSource& source) {
  if (const std::string key = "image_size" + suffix; root.Has(key)) {
    const YamlNode node = root.At(key);
    const std::vector<double> size = MatrixData(node, 2);
    constexpr double kMost = 1e6;  // no image has more columns
    for (const double length : size) {
      if (!(length >= 1 && length < kMost)) node.Fail("expected a width and a height in pixels");
    }
    return {static_cast<int>(size[0]), static_cast<int>(size[1])};
  }
  for (const auto& [width, height] : {std::pair("image_width", "image_height"),
                                      std::pair("imageWidth", "imageHeight"),
                                      std::pair("width", "height")}) {
    if (root.Has(width) && root.Has(height)) {
      return {root.At(width).AsInteger(), root.At(height).AsInteger()};
    }
  }
  if (source.image_size) return *source.image_size;
  root.Fail("holds no image size; give --size WIDTHxHEIGHT");
}

std::string WriteOpenCv(const std::vector<CalibratedCamera>& cameras) {
  std::string text = kOpenCvHead;
  const bool stereo = cameras.size() == 2;
  bool fisheye = false;
  for (size_t i = 0; i < cameras.size(); ++i) {
    const CalibratedCamera& camera = cameras[i];
    const Lens lens = ToLens(camera, OpenCvLenses());
    const std::string number = fmt::format("{}", i + 1);
    if (i > 0 && fisheye != (lens.name == "fisheye")) {
      throw JobError("opencv: one camera is a fisheye, the other not; export each with --camera");
    }
    fisheye = lens.name == "fisheye";
    if (stereo) {
      text += fmt::format(
          "image_size{}: [ {}, {} ]\n", number, camera.image_size[0], camera.image_size[1]);
    } else {
      text += fmt::format(
          "image_width: {}\nimage_height: {}\n", camera.image_size[0], camera.image_size[1]);
    }
    text += CameraMatrix(stereo ? "M" + number : "camera_matrix", lens);
    text += Coefficients(stereo ? "D" + number : "distortion_coefficients", lens);
  }
  if (fisheye) text += "fisheye_model: 1\n";
  if (stereo) {
    const RigidTransform T_2_1 = SecondFromFirst(cameras);
    text += OpenCvMatrix("R", 3, 3, 'd', RowMajor(T_2_1.R));
    text += OpenCvMatrix("T", 3, 1, 'd', std::array{T_2_1.t.x(), T_2_1.t.y(), T_2_1.t.z()});
  }
  return text;
}

/// Of cv::omnidir, whose programs write K, k1 k2 p1 p2 and xi.
const LensTable& OmnidirLenses() {
  static const LensTable kTable{.tool = "opencv",
                                .forms = {OmniForms().begin(), OmniForms().end()}};
  return kTable;
}

Lens OmnidirLens(Lens lens, const YamlNode& node) {
  const double xi = node.IsScalar() ? node.AsNumber() : MatrixData(node, 1)[0];
  if (!(xi > -1)) node.Fail("expected xi above -1");
  lens.coefficients.insert(lens.coefficients.begin(), xi);
  return FromOmni(lens);
}

std::vector<CalibratedCamera> ReadOpenCv(const CameraSource& source) {
  const YamlNode root = ReadStorage(source.path);
  const bool is_fisheye =
      source.fisheye || (root.Has("fisheye_model") && root.At("fisheye_model").AsInteger() == 1);
  const OpenCvDistortion distortion =
      is_fisheye ? OpenCvDistortion::kFisheye : OpenCvDistortion::kRadtan;
  const auto read = [&](const YamlNode& K, const std::optional<YamlNode>& D, const std::string& n) {
    const Lens lens = LensOf(K, D, distortion);
    const ImageSize size = SizeOf(root, n, source);
    const std::string where = source.path.string();
    if (!root.Has("xi" + n)) return FromLens(lens, size, OpenCvLenses(), where);
    return FromLens(OmnidirLens(lens, root.At("xi" + n)), size, OmnidirLenses(), where);
  };
  // Programs of OpenCV and their descendants.
  static const std::array<std::string, 4> kMatrixKeys{"camera_matrix", "cameraMatrix", "K", "M"};
  static const std::array<std::string, 6> kCoefficients{
      "distortion_coefficients", "distCoeffs", "dist_coeffs", "distCoeff", "dist_coeff", "D"};
  if (const auto K = Find(root, kMatrixKeys)) return {read(*K, Find(root, kCoefficients), "")};

  std::vector<CalibratedCamera> cameras;
  for (const std::string number : {"1", "2"}) {
    const auto numbered = [&](auto names) {
      for (std::string& name : names) name += number;
      return names;
    };
    const auto K = Find(root, numbered(kMatrixKeys));
    if (!K) root.Fail("expected 'camera_matrix', or 'M1', 'D1', 'M2', 'D2' of a stereo pair");
    cameras.push_back(read(*K, Find(root, numbered(kCoefficients)), number));
    cameras.back().name = "camera" + number;
  }
  // OpenCV's program for stereo pairs writes the pose into a file of its own.
  const std::filesystem::path beside = source.path.parent_path() / "extrinsics.yml";
  const bool here = root.Has("R") && root.Has("T");
  if (!here && !std::filesystem::exists(beside)) {
    root.Fail(
        "two cameras without 'R' and 'T': OpenCV's programs write them to extrinsics.yml; put it "
        "beside this file");
  }
  const YamlNode pose = here ? root : ReadStorage(beside);
  cameras[1].T_camera_rig = FromRowMajor(MatrixData(pose.At("R"), 9), MatrixData(pose.At("T"), 3));
  return cameras;
}

}  // namespace

CameraFormat OpencvFormat() {
  return {.name = "opencv",
          .file = "calibration.yml",
          .most_cameras = 2,
          .holds_extrinsics = true,
          .write = WriteOpenCv,
          .read = ReadOpenCv};
}

}  // namespace plenocal
