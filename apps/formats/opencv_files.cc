// SPDX-License-Identifier: Apache-2.0
//
// YAML as OpenCV's FileStorage writes it: OpenCV's calibration programs, ORB-SLAM.
// - OpenCV: R, T map camera 1 to camera 2.
// - ORB-SLAM3: Stereo.T_c1_c2 maps camera 2 to camera 1 and must be of 32-bit floats; lengths in
//   pixels must be reals, sizes integers, or it stops.
#include <fmt/format.h>

#include <array>

#include "apps/formats/formats.h"
#include "apps/undistort/rectify.h"
#include "calib/error.h"
#include "calib/text_file.h"
#include "calib/yaml.h"

namespace plenocal {
namespace {

std::string CameraMatrix(const std::string& key, const Lens& lens) {
  return OpenCvMatrix(
      key, 3, 3, 'd', std::array{lens.f_x, 0.0, lens.c_x, 0.0, lens.f_y, lens.c_y, 0.0, 0.0, 1.0});
}

std::string Coefficients(const std::string& key, const Lens& lens) {
  return OpenCvMatrix(key, 1, static_cast<int>(lens.coefficients.size()), 'd', lens.coefficients);
}

RigidTransform FromRowMajor(const std::vector<double>& R, const std::vector<double>& t) {
  return {Eigen::Map<const Eigen::Matrix<double, 3, 3, Eigen::RowMajor>>(R.data()),
          Eigen::Map<const Eigen::Vector3d>(t.data())};
}

YamlNode ReadStorage(const std::filesystem::path& path) {
  std::string text = ReadTextFile(path);
  // OpenCV's first line is no YAML directive.
  if (text.starts_with("%YAML:1.0")) text.replace(0, 1, "#");
  return YamlNode::Parse(text, path.string());
}

/// The value of the first of `keys` that the file has.
std::optional<YamlNode> Find(const YamlNode& root, std::span<const std::string> keys) {
  for (const std::string& key : keys) {
    if (root.Has(key)) return root.At(key);
  }
  return std::nullopt;
}

std::vector<double> MatrixData(const YamlNode& node, size_t count) {
  // Plain lists, possibly of rows, are common too.
  if (node.IsMap()) return node.At("data").AsNumbers(count);
  std::vector<double> data;
  for (const YamlNode& element : node.Elements()) {
    if (element.IsScalar()) {
      data.push_back(element.AsNumber());
    } else {
      for (const double value : element.AsNumbers(0)) data.push_back(value);
    }
  }
  if (count > 0 && data.size() != count) node.Fail(fmt::format("expected {} numbers", count));
  return data;
}

Lens LensOf(const YamlNode& K, const std::optional<YamlNode>& D, bool fisheye) {
  const std::vector<double> k = MatrixData(K, 9);
  if (k[1] != 0) K.Fail("a skewed camera matrix is not read");
  return {fisheye ? "fisheye" : "radtan",
          k[0],
          k[4],
          k[2],
          k[5],
          D ? MatrixData(*D, 0) : std::vector<double>{}};
}

ImageSize SizeOf(const YamlNode& root, const std::string& suffix, const CameraSource& source) {
  if (const std::string key = "image_size" + suffix; root.Has(key)) {
    const std::vector<double> size = MatrixData(root.At(key), 2);
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
    const Lens lens = ToLens(camera, OpenCvLenses(), "opencv");
    const std::string number = fmt::format("{}", i + 1);
    if (i > 0 && fisheye != (lens.name == "fisheye")) {
      throw Error(ErrorKind::kJob,
                  "opencv: one camera is a fisheye, the other not; export each with --camera");
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
    const RigidTransform T_2_1 = cameras[1].T_camera_rig * cameras[0].T_camera_rig.Inverse();
    text += OpenCvMatrix("R", 3, 3, 'd', RowMajor(T_2_1.R));
    text += OpenCvMatrix("T", 3, 1, 'd', std::array{T_2_1.t.x(), T_2_1.t.y(), T_2_1.t.z()});
  }
  return text;
}

std::vector<CalibratedCamera> ReadOpenCv(const CameraSource& source) {
  const YamlNode root = ReadStorage(source.path);
  const bool fisheye =
      source.fisheye || (root.Has("fisheye_model") && root.At("fisheye_model").AsInteger() == 1);
  const auto read = [&](const YamlNode& K, const std::optional<YamlNode>& D, const std::string& n) {
    return FromLens(
        LensOf(K, D, fisheye), SizeOf(root, n, source), OpenCvLenses(), source.path.string());
  };
  // Programs of OpenCV and their descendants.
  static const std::array<std::string, 4> kMatrix{"camera_matrix", "cameraMatrix", "K", "M"};
  static const std::array<std::string, 6> kCoefficients{
      "distortion_coefficients", "distCoeffs", "dist_coeffs", "distCoeff", "dist_coeff", "D"};
  if (const auto K = Find(root, kMatrix)) return {read(*K, Find(root, kCoefficients), "")};

  std::vector<CalibratedCamera> cameras;
  for (const std::string number : {"1", "2"}) {
    const auto numbered = [&](auto names) {
      for (std::string& name : names) name += number;
      return names;
    };
    const auto K = Find(root, numbered(kMatrix));
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

std::span<const LensForm> OrbSlamLenses() {
  static const std::vector<LensForm> kForms{
      {"pinhole", "PinHole", {"0", "0", "0", "0", "0"}},
      {"pinhole-radial3", "PinHole", {"A_0", "A_1", "0", "0", "A_2"}},
      {"pinhole-radtan4", "PinHole", {"k_1", "k_2", "p_1", "p_2", "0"}},
      {"pinhole-radtan", "PinHole", {"k_1", "k_2", "p_1", "p_2", "k_3"}},
      {"kannala-brandt4", "KannalaBrandt8", {"k_1", "k_2", "k_3", "k_4"}}};
  return kForms;
}

std::span<const LensForm> OrbSlam2Lenses() { return OrbSlamLenses().first(4); }

std::vector<std::string_view> OrbSlamNames(const std::string& type) {
  if (type == "PinHole") return {"k1", "k2", "p1", "p2", "k3"};
  return {"k1", "k2", "k3", "k4"};
}

std::string OrbSlamCamera(const std::string& prefix, const Lens& lens) {
  std::string text;
  const auto add = [&](std::string_view name, double value) {
    text += fmt::format("{}.{}: {}\n", prefix, name, RealText(value));
  };
  add("fx", lens.f_x);
  add("fy", lens.f_y);
  add("cx", lens.c_x);
  add("cy", lens.c_y);
  const std::vector<std::string_view> names = OrbSlamNames(lens.name);
  for (size_t i = 0; i < names.size(); ++i) add(names[i], lens.coefficients[i]);
  return text + "\n";
}

std::string OrbSlamImages(const CalibratedCamera& camera) {
  return fmt::format(
             "Camera.width: {}\nCamera.height: {}\n", camera.image_size[0], camera.image_size[1]) +
         "# A calibration does not know these two.\nCamera.fps: 30\nCamera.RGB: 1\n";
}

Lens ReadOrbSlamCamera(const YamlNode& root, const std::string& prefix, const std::string& type) {
  const auto number = [&](std::string_view name) {
    return root.At(fmt::format("{}.{}", prefix, name)).AsNumber();
  };
  Lens lens{type, number("fx"), number("fy"), number("cx"), number("cy"), {}};
  for (const std::string_view name : OrbSlamNames(type)) {
    const bool has = root.Has(fmt::format("{}.{}", prefix, name));
    lens.coefficients.push_back(has ? number(name) : 0);
  }
  return lens;
}

ImageSize ReadOrbSlamSize(const YamlNode& root, const CameraSource& source) {
  if (root.Has("Camera.width") && root.Has("Camera.height")) {
    return {root.At("Camera.width").AsInteger(), root.At("Camera.height").AsInteger()};
  }
  if (source.image_size) return *source.image_size;
  root.Fail("holds no 'Camera.width' and 'Camera.height'; give --size WIDTHxHEIGHT");
}

/// One camera, or a pair with what rectifies it; Camera.* are then the rectified views' and b times
/// f is Camera.bf.
std::string WriteOrbSlam2(const std::vector<CalibratedCamera>& cameras) {
  const Lens first = ToLens(cameras[0], OrbSlam2Lenses(), "orbslam2");
  if (cameras.size() == 1) {
    return kOpenCvHead + OrbSlamCamera("Camera", first) + OrbSlamImages(cameras[0]);
  }
  const RectifiedPair pair = Rectify(cameras[0], cameras[1], {});
  const std::vector<double>& p = pair.views[0].params;
  std::string text =
      kOpenCvHead + OrbSlamCamera("Camera", {"PinHole", p[0], p[1], p[2], p[3], {0, 0, 0, 0, 0}}) +
      OrbSlamImages(pair.views[0]) +
      fmt::format("# baseline times fx\nCamera.bf: {}\n\n", RealText(pair.baseline * p[0]));
  for (size_t c = 0; c < 2; ++c) {
    const std::string side = c == 0 ? "LEFT" : "RIGHT";
    const Lens lens = ToLens(cameras[c], OrbSlam2Lenses(), "orbslam2");
    text += fmt::format("{0}.height: {1}\n{0}.width: {2}\n",
                        side,
                        cameras[c].image_size[1],
                        cameras[c].image_size[0]);
    text += Coefficients(side + ".D", lens) + CameraMatrix(side + ".K", lens) +
            OpenCvMatrix(side + ".R", 3, 3, 'd', RowMajor(pair.R_view_camera[c])) +
            OpenCvMatrix(side + ".P", 3, 4, 'd', pair.ProjectionMatrix(c));
  }
  return text;
}

std::vector<CalibratedCamera> ReadOrbSlam2(const CameraSource& source) {
  const YamlNode root = ReadStorage(source.path);
  if (!root.Has("LEFT.K")) {
    return {FromLens(ReadOrbSlamCamera(root, "Camera", "PinHole"),
                     ReadOrbSlamSize(root, source),
                     OrbSlam2Lenses(),
                     source.path.string())};
  }
  std::vector<CalibratedCamera> cameras;
  for (const std::string side : {"LEFT", "RIGHT"}) {
    Lens lens = LensOf(root.At(side + ".K"), root.At(side + ".D"), false);
    lens.name = "PinHole";
    cameras.push_back(
        FromLens(lens,
                 {root.At(side + ".width").AsInteger(), root.At(side + ".height").AsInteger()},
                 OrbSlam2Lenses(),
                 source.path.string()));
    const std::vector<double> P = MatrixData(root.At(side + ".P"), 12);
    const YamlNode R = root.At(side + ".R");
    cameras.back().T_camera_rig = FromRectified(MatrixData(R, 9), P[0] != 0 ? P[3] / P[0] : 0, R);
    cameras.back().name = side == "LEFT" ? "left" : "right";
  }
  return cameras;
}

std::string WriteOrbSlam3(const std::vector<CalibratedCamera>& cameras) {
  const Lens first = ToLens(cameras[0], OrbSlamLenses(), "orbslam3");
  std::string text =
      kOpenCvHead + fmt::format("File.version: \"1.0\"\nCamera.type: \"{}\"\n\n", first.name);
  for (size_t i = 0; i < cameras.size(); ++i) {
    const Lens lens = ToLens(cameras[i], OrbSlamLenses(), "orbslam3");
    if (lens.name != first.name || cameras[i].image_size != cameras[0].image_size) {
      throw Error(ErrorKind::kJob,
                  "orbslam3: both cameras must have one kind of lens and images of one size; "
                  "export one with --camera");
    }
    text += OrbSlamCamera(fmt::format("Camera{}", i + 1), lens);
  }
  text += OrbSlamImages(cameras[0]);
  if (cameras.size() < 2) return text;
  const RigidTransform T_1_2 = cameras[0].T_camera_rig * cameras[1].T_camera_rig.Inverse();
  std::array<double, 16> T{};
  T[15] = 1;
  for (size_t r = 0; r < 3; ++r) {
    const auto row = static_cast<Eigen::Index>(r);
    for (size_t c = 0; c < 3; ++c) T[4 * r + c] = T_1_2.R(row, static_cast<Eigen::Index>(c));
    T[4 * r + 3] = T_1_2.t[row];
  }
  return text + "\n# maps camera 2 to camera 1\n" + OpenCvMatrix("Stereo.T_c1_c2", 4, 4, 'f', T);
}

std::vector<CalibratedCamera> ReadOrbSlam3(const CameraSource& source) {
  const YamlNode root = ReadStorage(source.path);
  const std::string type = root.At("Camera.type").AsString();
  const ImageSize size = ReadOrbSlamSize(root, source);
  std::vector<CalibratedCamera> cameras;
  for (const std::string prefix : {"Camera1", "Camera2"}) {
    if (!cameras.empty() && !root.Has(prefix + ".fx")) break;
    cameras.push_back(FromLens(
        ReadOrbSlamCamera(root, prefix, type), size, OrbSlamLenses(), source.path.string()));
    cameras.back().name = prefix == "Camera1" ? "camera1" : "camera2";
  }
  if (cameras.size() == 2) {
    const std::vector<double> T = MatrixData(root.At("Stereo.T_c1_c2"), 16);
    cameras[1].T_camera_rig =
        FromRowMajor({T[0], T[1], T[2], T[4], T[5], T[6], T[8], T[9], T[10]}, {T[3], T[7], T[11]})
            .Inverse();
  }
  return cameras;
}

}  // namespace

std::string OpenCvMatrix(
    const std::string& key, int rows, int cols, char type, std::span<const double> data) {
  return fmt::format("{}: !!opencv-matrix\n   rows: {}\n   cols: {}\n   dt: {}\n   data: [ {} ]\n",
                     key,
                     rows,
                     cols,
                     type,
                     RealList(data));
}

CameraFormat OpenCvFormat() {
  return {"opencv", "calibration.yml", 2, true, WriteOpenCv, ReadOpenCv};
}
CameraFormat OrbSlam2Format() {
  return {"orbslam2", "settings.yaml", 2, true, WriteOrbSlam2, ReadOrbSlam2};
}
CameraFormat OrbSlam3Format() {
  return {"orbslam3", "settings.yaml", 2, true, WriteOrbSlam3, ReadOrbSlam3};
}

}  // namespace plenocal
