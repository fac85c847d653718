// SPDX-License-Identifier: Apache-2.0
//
// plenocal export and import: other tools' files and their traps. Of a file that holds relative
// numbers (DSO) several parameters give the same last digit, so parameters are compared within
// that, and files with themselves.
#include <fmt/format.h>

#include <array>
#include <cstdlib>
#include <cstring>
#include <fstream>
#include <nlohmann/json.hpp>
#include <opencv2/calib3d.hpp>
#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>
#include <random>

#include "calib/base/names.h"
#include "engine/formats/camera_format.h"
#include "engine/formats/import_format.h"
#include "models/registry.h"
#include "tests/apps/workspace.h"
#include "tests/optional_data.h"

namespace plenocal::testing {
namespace TEST_FILE {

using ::testing::AllOf;
using ::testing::HasSubstr;

constexpr const char* kStereo = R"(plenocal: 1
cameras:
  left:
    model: pinhole-radial3
    image_size: [640, 480]
    parameters: {f_x: 500, f_y: 501.123456789012, c_x: 320.1, c_y: 240.7, A_0: -0.2, A_1: 0.051, A_2: 0.0123}
    T_camera_rig: [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]
  right:
    model: pinhole-radial3
    image_size: [640, 480]
    parameters: {f_x: 510.7, f_y: 511.3, c_x: 318.3, c_y: 244.9, A_0: -0.21, A_1: 0.06, A_2: 0}
    T_camera_rig: [[0.8, 0, -0.6, -0.1], [0, 1, 0, 0.02], [0.6, 0, 0.8, 0.03], [0, 0, 0, 1]]
)";

constexpr const char* kPlenoptic = R"(plenocal: 1
cameras:
  plenoptic:
    model: focused-plenoptic
    image_size: [2048, 2040]
    pixel_size: 5.5e-06
    parameters: {f_L: 0.0161, b_L0: 0.0149, B: 0.00052, c_x: 1022.3, c_y: 1019.9, A_0: -420.7, A_1: 3.1e6, B_0: 0.061, B_1: -0.042}
    T_camera_rig: [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]
)";

// A format of ordinary cameras, and whether it holds A_2.
struct OrdinaryFormat {
  std::string name;
  bool holds_A_2 = true;
};

class Exchange : public Workspace {
 protected:
  Exchange() { Write("calibration.yaml", kStereo); }

  std::string Export(const std::string& format,
                     const std::string& camera = "",
                     const std::string& calibration = "calibration.yaml") const {
    std::vector<std::string> arguments{
        "export", calibration, "--format", format, "-o", "file." + format};
    if (!camera.empty()) arguments.insert(arguments.end(), {"--camera", camera});
    const Outcome outcome = Run(arguments);
    EXPECT_EQ(outcome.status, kDone) << outcome.err;
    return outcome.status == kDone ? Read("file." + format) : "";
  }

  void ExpectRefused(int status,
                     const std::vector<std::string>& arguments,
                     const std::vector<std::string>& parts) const {
    const Outcome outcome = Run(arguments);
    EXPECT_EQ(outcome.status, status) << outcome.err;
    EXPECT_EQ(Lines(outcome.err).size(), 1U) << outcome.err;
    for (const std::string& part : parts) EXPECT_THAT(outcome.err, HasSubstr(part));
  }

  /// The registered formats that hold one of the cameras of `kStereo`; A_2 of `right` is zero.
  [[nodiscard]] std::vector<OrdinaryFormat> OrdinaryFormats() const {
    std::vector<OrdinaryFormat> formats;
    for (const CameraFormat& format : CameraFormats()) {
      const std::string name(format.name);
      const auto holds = [&](const char* camera) {
        return Run({"export",
                    "calibration.yaml",
                    "--format",
                    name,
                    "--camera",
                    camera,
                    "-o",
                    "tried"})
                   .status == kDone;
      };
      const bool holds_A_2 = holds("left");
      if (holds_A_2 || holds("right")) formats.push_back({name, holds_A_2});
    }
    constexpr size_t kAllButLifcal = 11;
    EXPECT_GE(formats.size(), kAllButLifcal);
    return formats;
  }

  YAML::Node Import(const std::string& format, const std::string& file) const {
    const Outcome outcome = Run({"import", file, "--format", format, "-o", "back"});
    EXPECT_EQ(outcome.status, kDone) << outcome.err;
    return outcome.status == kDone ? YAML::Load(Read("back/calibration.yaml")) : YAML::Node();
  }
};

void ExpectSameParameters(const YAML::Node& a, const YAML::Node& b) {
  EXPECT_EQ(a["model"].as<std::string>(), b["model"].as<std::string>());
  EXPECT_EQ(a["image_size"].as<std::vector<int>>(), b["image_size"].as<std::vector<int>>());
  for (const auto& entry : a["parameters"]) {
    const auto name = entry.first.as<std::string>();
    EXPECT_DOUBLE_EQ(entry.second.as<double>(), b["parameters"][name].as<double>()) << name;
  }
}

TEST_F(Exchange, OneCameraComesBackToTheLastDigit) {
  const YAML::Node calibration = YAML::Load(kStereo);
  for (const auto& [format, holds_A_2] : OrdinaryFormats()) {
    SCOPED_TRACE(format);
    const char* const camera = holds_A_2 ? "left" : "right";  // whose A_2 is zero
    Export(format, camera);
    const YAML::Node back = Import(format, "file." + format);
    ASSERT_EQ(back["cameras"].size(), 1U);
    ExpectSameParameters(calibration["cameras"][camera], back["cameras"].begin()->second);
  }
}

TEST_F(Exchange, AFileComesBackAsItWas) {
  for (const auto& [format, holds_A_2] : OrdinaryFormats()) {
    SCOPED_TRACE(format);
    if (format == "cahvor") continue;  // has all in the frame of the rig; foreign_cameras_test.cc
    const std::string file = "file." + format;
    const std::string text = Export(format, "right");
    Import(format, file);
    const std::string again = Export(format, "", "back/calibration.yaml");
    const auto numbers = [](const std::string& all) {
      std::string kept;
      for (const std::string& line : Lines(all)) {
        const bool varies = line.find("rostopic") != std::string::npos ||
                            line.find("extrinsics") != std::string::npos ||
                            line.find("transform") != std::string::npos ||
                            line.find("\"px\"") != std::string::npos;
        if (!varies) kept += line + "\n";
      }
      return kept;
    };
    EXPECT_EQ(numbers(text), numbers(again));
  }
}

TEST_F(Exchange, ThePoseBetweenTwoCamerasComesBack) {
  Write("calibration.yaml", Replaced(kStereo, "A_2: 0.0123", "A_2: 0"));
  const Eigen::Matrix4d T = Matrix(YAML::Load(kStereo)["cameras"]["right"]["T_camera_rig"]);
  for (const char* format :
       {"opencv", "orbslam2", "orbslam3", "kalibr", "basalt", "matlab", "mat"}) {
    SCOPED_TRACE(format);
    Export(format);
    const YAML::Node back = Import(format, std::string("file.") + format);
    ASSERT_EQ(back["cameras"].size(), 2U);
    EXPECT_LT((Matrix((++back["cameras"].begin())->second["T_camera_rig"]) - T).norm(), 1e-14);
  }
  for (const char* format : {"mrcal", "ros"}) {  // one file a camera
    SCOPED_TRACE(format);
    ASSERT_EQ(Run({"export", "calibration.yaml", "--format", format, "-o", "pair.yaml"}).status,
              kDone);
    const Outcome outcome =
        Run({"import", "pair_left.yaml", "pair_right.yaml", "--format", format, "-o", "back"});
    ASSERT_EQ(outcome.status, kDone) << outcome.err;
    const YAML::Node back = YAML::Load(Read("back/calibration.yaml"));
    ASSERT_EQ(back["cameras"].size(), 2U);
    EXPECT_LT((Matrix((++back["cameras"].begin())->second["T_camera_rig"]) - T).norm(), 1e-14);
  }
}

TEST_F(Exchange, MatricesOfRosAreThoseOfACameraWithoutSkew) {
  const YAML::Node camera = YAML::Load(kStereo)["cameras"]["right"];
  const auto param = [&](const char* name) { return camera["parameters"][name].as<double>(); };
  const double f_x = param("f_x"), f_y = param("f_y"), c_x = param("c_x"), c_y = param("c_y");
  const YAML::Node file = YAML::Load(Export("ros", "right"));
  const auto data = [&](const char* key) { return file[key]["data"].as<std::vector<double>>(); };
  EXPECT_EQ(data("camera_matrix"), (std::vector<double>{f_x, 0, c_x, 0, f_y, c_y, 0, 0, 1}));
  EXPECT_EQ(data("rectification_matrix"), (std::vector<double>{1, 0, 0, 0, 1, 0, 0, 0, 1}));
  EXPECT_EQ(data("projection_matrix"),
            (std::vector<double>{f_x, 0, c_x, 0, 0, f_y, c_y, 0, 0, 0, 1, 0}));
  for (const auto& [key, rows, columns] : {std::tuple("camera_matrix", 3, 3),
                                           {"rectification_matrix", 3, 3},
                                           {"projection_matrix", 3, 4}}) {
    EXPECT_EQ(file[key]["rows"].as<int>(), rows);
    EXPECT_EQ(file[key]["cols"].as<int>(), columns);
  }
}

TEST_F(Exchange, RectifiedPairsOfRosAndOrbSlam2AreThoseOfOpenCv) {
  ASSERT_EQ(Run({"export", "calibration.yaml", "--format", "ros", "-o", "ros.yaml"}).status, kDone);
  Export("orbslam2");
  cv::FileStorage orbslam(Path("file.orbslam2").string(), cv::FileStorage::READ);
  const Eigen::Matrix4d T = Matrix(YAML::Load(kStereo)["cameras"]["right"]["T_camera_rig"]);
  const std::vector<cv::Point3d> points{{0.1, -0.2, 2}, {-0.3, 0.1, 1.5}, {0.2, 0.3, 3}};
  for (const bool from_ros : {true, false}) {
    std::array<std::vector<cv::Point2d>, 2> rectified;
    double bf = 0;
    for (size_t c = 0; c < 2; ++c) {
      cv::Mat K, D, R, P;
      if (from_ros) {
        const YAML::Node file = YAML::Load(Read(c == 0 ? "ros_left.yaml" : "ros_right.yaml"));
        const auto matrix = [&](const char* key, int rows) {
          return cv::Mat(file[key]["data"].as<std::vector<double>>(), true).reshape(1, rows);
        };
        K = matrix("camera_matrix", 3);
        D = matrix("distortion_coefficients", 1);
        R = matrix("rectification_matrix", 3);
        P = matrix("projection_matrix", 3);
      } else {
        const std::string side = c == 0 ? "LEFT." : "RIGHT.";
        orbslam[side + "K"] >> K;
        orbslam[side + "D"] >> D;
        orbslam[side + "R"] >> R;
        orbslam[side + "P"] >> P;
        EXPECT_EQ(static_cast<double>(orbslam["Camera.fx"]), P.at<double>(0, 0));
        if (c == 1) {
          EXPECT_NEAR(static_cast<double>(orbslam["Camera.bf"]), -P.at<double>(0, 3), 1e-12);
        }
      }
      bf = -P.at<double>(0, 3);
      std::vector<cv::Point3d> seen = points;
      for (cv::Point3d& p : seen) {
        if (c == 0) continue;
        const Eigen::Vector3d moved =
            T.topLeftCorner<3, 3>() * Eigen::Vector3d(p.x, p.y, p.z) + T.topRightCorner<3, 1>();
        p = {moved.x(), moved.y(), moved.z()};
      }
      std::vector<cv::Point2d> pixels;
      cv::projectPoints(seen, cv::Vec3d(), cv::Vec3d(), K, D, pixels);
      cv::undistortPoints(pixels,
                          rectified[c],
                          K,
                          D,
                          R,
                          P.colRange(0, 3),
                          cv::TermCriteria(cv::TermCriteria::COUNT, 300, 0));
    }
    EXPECT_GT(bf, 0);
    for (size_t i = 0; i < points.size(); ++i) {
      EXPECT_NEAR(rectified[0][i].y, rectified[1][i].y, 1e-6);
      EXPECT_GT(rectified[0][i].x, rectified[1][i].x);
    }
  }
}

TEST_F(Exchange, DsoGetsTheVignetteAsAnImage) {
  cv::Mat attenuation(480, 640, CV_32F, cv::Scalar(0.8));
  attenuation.at<float>(10, 20) = 0.4F;
  ASSERT_TRUE(cv::imwrite(Path("v.tiff").string(), attenuation));
  Write("calibration.yaml", Replaced(kStereo, "A_2: 0}\n", "A_2: 0}\n    vignetting: v.tiff\n"));
  ASSERT_EQ(Run({"export",
                 "calibration.yaml",
                 "--format",
                 "dso",
                 "--camera",
                 "right",
                 "-o",
                 "dso/camera.txt"})
                .status,
            kDone);
  EXPECT_EQ(Results("dso"), (std::vector<std::string>{"camera.txt", "vignette.png"}));
  const cv::Mat vignette = cv::imread(Path("dso/vignette.png").string(), cv::IMREAD_UNCHANGED);
  ASSERT_EQ(vignette.type(), CV_16U);
  EXPECT_EQ(vignette.at<ushort>(0, 0), 65535);
  EXPECT_NEAR(vignette.at<ushort>(10, 20), 65535 / 2.0, 1);
}

TEST_F(Exchange, MatFilesHaveTheBytesOfLevel5) {
  ASSERT_EQ(Run({"export",
                 "calibration.yaml",
                 "--format",
                 "matlab",
                 "--camera",
                 "left",
                 "-o",
                 "camera.mat"})
                .status,
            kDone);
  const std::string bytes = Read("camera.mat");
  EXPECT_THAT(bytes, ::testing::StartsWith("MATLAB 5.0 MAT-file"));
  EXPECT_EQ(bytes.substr(124, 4), std::string("\x00\x01IM", 4));
  // miMATRIX of flags (16), dimensions (16), name (8 + 16) and two doubles (8 + 16).
  const std::string first = std::string("\x0e\0\0\0\x50\0\0\0", 8) +
                            std::string("\6\0\0\0\x08\0\0\0\6\0\0\0\0\0\0\0", 16) +
                            std::string("\5\0\0\0\x08\0\0\0\1\0\0\0\2\0\0\0", 16) +
                            std::string("\1\0\0\0\x0b\0\0\0FocalLength\0\0\0\0\0", 24) +
                            std::string("\x09\0\0\0\x10\0\0\0", 8);
  EXPECT_EQ(bytes.substr(128, first.size()), first);
  double f_x = 0;
  std::memcpy(&f_x, bytes.data() + 128 + first.size(), sizeof f_x);
  EXPECT_EQ(f_x, 500);
  const YAML::Node back = Import("matlab", "camera.mat");
  ExpectSameParameters(YAML::Load(kStereo)["cameras"]["left"], back["cameras"].begin()->second);
  // As save writes small and whole numbers: data in the tag, bytes in place of doubles.
  std::string small = bytes.substr(0, 128);
  const auto add = [&](const std::string& name, const std::string& numbers) {
    std::string body = std::string("\6\0\0\0\x08\0\0\0\6\0\0\0\0\0\0\0", 16) +
                       std::string("\5\0\0\0\x08\0\0\0\1\0\0\0\2\0\0\0", 16);
    body += std::string("\1\0\0\0", 4) + static_cast<char>(name.size()) + std::string(3, '\0') +
            name + std::string((8 - name.size() % 8) % 8, '\0');
    body += std::string("\2\0", 2) + static_cast<char>(numbers.size()) + '\0' + numbers +
            std::string(4 - numbers.size(), '\0');
    small +=
        std::string("\x0e\0\0\0", 4) + static_cast<char>(body.size()) + std::string(3, '\0') + body;
  };
  add("FocalLength", "\x64\x65");
  add("PrincipalPoint", "\x29\x1f");
  add("ImageSize", "\x3c\x50");
  add("RadialDistortion", std::string("\0\0", 2));
  add("TangentialDistortion", std::string("\0\0", 2));
  Write("small.mat", small);
  const YAML::Node camera = Import("matlab", "small.mat")["cameras"].begin()->second;
  EXPECT_EQ(camera["parameters"]["f_y"].as<double>(), 101);
  EXPECT_EQ(camera["parameters"]["c_x"].as<double>(), 40);
  EXPECT_EQ(camera["image_size"].as<std::vector<int>>(), (std::vector{80, 60}));
  for (size_t length = 0; length < bytes.size(); length += 37) {
    Write("cut.mat", bytes.substr(0, length));
    ExpectRefused(
        kWrongInput, {"import", "cut.mat", "--format", "matlab", "-o", "out"}, {"cut.mat"});
  }
  Write("packed.mat", bytes.substr(0, 128) + std::string("\x0f\0\0\0\x08\0\0\0abcdefgh", 16));
  ExpectRefused(kWrongInput, {"import", "packed.mat", "--format", "matlab", "-o", "out"}, {"-v6"});
}

TEST_F(Exchange, ARefusedExportNamesTheNearestModel) {
  // Of `left`, whose A_2 Kalibr has no place for.
  const Outcome refused = Run(
      {"export", "calibration.yaml", "--format", "kalibr", "--camera", "left", "-o", "refused"});
  EXPECT_EQ(refused.status, kJobFailed);
  EXPECT_THAT(refused.err, HasSubstr("no place for A_2 of model pinhole-radial3"));
  const std::string to = "--to ";
  const size_t at = refused.err.find(to);
  ASSERT_NE(at, std::string::npos) << refused.err;
  const std::string named = refused.err.substr(
      at + to.size(), refused.err.find_first_of(" \n", at + to.size()) - at - to.size());
  EXPECT_THAT(refused.err, HasSubstr("px RMS"));
  ASSERT_EQ(Run({"convert", "calibration.yaml", "--camera", "left", "--to", named, "-o", "nearest"})
                .status,
            kDone);
  Export("kalibr", "", "nearest/calibration.yaml");
}

TEST_F(Exchange, OmniOfKalibrIsTheUnifiedModel) {
  const std::string omni =
      "cam0:\n  camera_model: omni\n  intrinsics: [1.5, 800.0, 810.0, 320.0, 240.0]\n"
      "  distortion_model: radtan\n  distortion_coeffs: [0, 0, 0, 0]\n  resolution: [640, 480]\n";
  Write("omni.yaml", omni);
  const YAML::Node camera = Import("kalibr", "omni.yaml")["cameras"]["cam0"];
  EXPECT_EQ(camera["model"].as<std::string>(), "ucm");
  EXPECT_NEAR(camera["parameters"]["alpha"].as<double>(), 0.6, 1e-15);
  EXPECT_NEAR(camera["parameters"]["f_x"].as<double>(), 320, 1e-12);
  const YAML::Node again = YAML::Load(Export("kalibr", "", "back/calibration.yaml"))["cam0"];
  EXPECT_EQ(again["camera_model"].as<std::string>(), "omni");
  EXPECT_NEAR(again["intrinsics"][0].as<double>(), 1.5, 1e-14);
  EXPECT_NEAR(again["intrinsics"][2].as<double>(), 810, 1e-11);
  // Its distortion acts on another plane than ours (bench/equivalence compares with OpenCV).
  Write("omni.yaml", Replaced(omni, "[0, 0, 0, 0]", "[-0.1, 0.02, 0.001, -0.002]"));
  const YAML::Node bent = Import("kalibr", "omni.yaml")["cameras"]["cam0"];
  EXPECT_EQ(bent["model"].as<std::string>(), "ucm+radtan");
  EXPECT_NEAR(bent["parameters"]["k_1"].as<double>(), -0.1 * 0.4 * 0.4, 1e-15);
  const YAML::Node whole = YAML::Load(Export("kalibr", "", "back/calibration.yaml"))["cam0"];
  EXPECT_EQ(whole["distortion_model"].as<std::string>(), "radtan");
  EXPECT_NEAR(whole["distortion_coeffs"][1].as<double>(), 0.02, 1e-15);
  EXPECT_NEAR(whole["distortion_coeffs"][3].as<double>(), -0.002, 1e-15);
  Write("splined.cameramodel",
        "{ 'lensmodel': 'LENSMODEL_SPLINED_STEREOGRAPHIC_order=4_Nx=30_Ny=20_fov_x_deg=170',\n"
        "'intrinsics': [1, 1, 1, 1, 2], 'extrinsics': [0,0,0,0,0,0], 'imagersize': [640, 480] }\n");
  ExpectRefused(kWrongInput,
                {"import", "splined.cameramodel", "--format", "mrcal", "-o", "out"},
                {"splined.cameramodel:1:", "the order is 2 or 3"});
}

TEST_F(Exchange, RealFilesAreRead) {
  const auto read = [&](const std::string& file, std::vector<std::string> options) {
    std::vector<std::string> arguments{
        "import", OptionalData("frames/" + file).string(), "-o", "real", "--format"};
    arguments.insert(arguments.end(), options.begin(), options.end());
    const Outcome outcome = Run(arguments);
    EXPECT_EQ(outcome.status, kDone) << outcome.err;
    return YAML::Load(Read("real/calibration.yaml"))["cameras"].begin()->second;
  };
  YAML::Node camera = read("stereo_chess_opencv/left_intrinsics.yml", {"opencv"});
  EXPECT_EQ(camera["model"].as<std::string>(), "pinhole-radtan");
  EXPECT_NEAR(camera["parameters"]["k_1"].as<double>(), -0.26637260909660682, 1e-16);
  const std::filesystem::path others = OptionalData("frames/stereo_fisheye_ros");
  if (!std::filesystem::exists(others)) GTEST_SKIP() << Absent(others);
  camera = read("stereo_fisheye_ros/cam_stereo.yml", {"opencv", "--fisheye", "--size", "800x503"});
  EXPECT_EQ(camera["model"].as<std::string>(), "kannala-brandt4");
  camera = read("stereo_fisheye_ros/left.yaml", {"ros"});
  EXPECT_EQ(camera["model"].as<std::string>(), "pinhole-radtan4");
  camera = read("corners_mrcal_figueroa/opencv8-0.cameramodel", {"mrcal"});
  EXPECT_EQ(camera["model"].as<std::string>(), "pinhole-radtan8");
  EXPECT_NEAR(camera["parameters"]["k_1"].as<double>(), 0.4791613797, 1e-12);
  camera = read("tags3d_tagslam/test_01/cameras.yaml", {"kalibr"});
  EXPECT_EQ(camera["model"].as<std::string>(), "kannala-brandt4");
}

TEST_F(Exchange, ThePoseOfOpenCvsStereoProgramIsFoundBesideTheIntrinsics) {
  const std::string whole = Export("opencv");
  const size_t pose = whole.find("R: ");
  std::filesystem::create_directories(Path("two"));
  Write("two/intrinsics.yml", whole.substr(0, pose));
  ExpectRefused(kWrongInput,
                {"import", "two/intrinsics.yml", "--format", "opencv", "-o", "out"},
                {"extrinsics.yml"});
  Write("two/extrinsics.yml", "%YAML:1.0\n---\n" + whole.substr(pose));
  const YAML::Node back = Import("opencv", "two/intrinsics.yml");
  EXPECT_EQ(back["cameras"]["camera2"]["T_camera_rig"][0][3].as<double>(), -0.1);
}

TEST_F(Exchange, EachFormatHasItsOwnDirectionOfThePose) {
  Write("calibration.yaml", Replaced(kStereo, "A_2: 0.0123", "A_2: 0"));
  const Eigen::Matrix4d T_right_left =
      Matrix(YAML::Load(kStereo)["cameras"]["right"]["T_camera_rig"]);
  const Eigen::Matrix4d T_left_right = T_right_left.inverse();

  const YAML::Node kalibr = YAML::Load(Export("kalibr"));  // camera n-1 to camera n
  EXPECT_LT((Matrix(kalibr["cam1"]["T_cn_cnm1"]) - T_right_left).norm(), 1e-14);
  EXPECT_FALSE(kalibr["cam0"]["T_cn_cnm1"]);

  const auto basalt = nlohmann::json::parse(Export("basalt"))["value0"];  // camera to IMU
  EXPECT_NEAR(basalt["T_imu_cam"][1]["px"].get<double>(), T_left_right(0, 3), 1e-14);
  const Eigen::Quaterniond q(basalt["T_imu_cam"][1]["qw"].get<double>(),
                             basalt["T_imu_cam"][1]["qx"].get<double>(),
                             basalt["T_imu_cam"][1]["qy"].get<double>(),
                             basalt["T_imu_cam"][1]["qz"].get<double>());
  EXPECT_LT((q.matrix() - T_left_right.topLeftCorner<3, 3>()).norm(), 1e-14);

  Export("opencv");  // camera 1 to camera 2
  cv::FileStorage opencv(Path("file.opencv").string(), cv::FileStorage::READ);
  cv::Mat R, t;
  opencv["R"] >> R;
  opencv["T"] >> t;
  EXPECT_EQ(R.at<double>(0, 2), T_right_left(0, 2));
  EXPECT_EQ(t.at<double>(0), T_right_left(0, 3));

  Export("orbslam3");  // camera 2 to camera 1, 32-bit floats
  cv::FileStorage orbslam(Path("file.orbslam3").string(), cv::FileStorage::READ);
  cv::Mat T;
  orbslam["Stereo.T_c1_c2"] >> T;
  ASSERT_EQ(T.type(), CV_32F);
  EXPECT_NEAR(T.at<float>(0, 3), T_left_right(0, 3), 1e-7);
  EXPECT_NEAR(T.at<float>(0, 2), T_left_right(0, 2), 1e-7);
}

TEST_F(Exchange, PixelZeroLiesAtTheCornerInColmapAndDsoAndOneAtTheCentreInMatlab) {
  EXPECT_THAT(Export("colmap", "left"),
              HasSubstr("1 FULL_OPENCV 640 480 500.0 501.123456789012 320.6 241.2 -0.2 0.051 "
                        "0.0 0.0 0.0123 0.0 0.0 0.0\n"));
  const std::vector<std::string> dso = Lines(Export("dso", "right"));
  EXPECT_THAT(dso[0],
              HasSubstr(fmt::format("RadTan {} {} {} {} -0.21 0.06 0.0 0.0",
                                    510.7 / 640,
                                    511.3 / 480,
                                    (318.3 + 0.5) / 640,
                                    (244.9 + 0.5) / 480)));
  EXPECT_EQ(dso[1], "640 480");
  const auto matlab = nlohmann::json::parse(Export("matlab", "left"));
  EXPECT_EQ(matlab["PrincipalPoint"][0], 321.1);
  EXPECT_EQ(matlab["ImageSize"][0], 480);  // rows first
  EXPECT_EQ(matlab["RadialDistortion"][2], 0.0123);
}

TEST_F(Exchange, OrbSlam3GetsRealsAsRealsAndIntegersAsIntegers) {
  Export("orbslam3", "left");
  cv::FileStorage file(Path("file.orbslam3").string(), cv::FileStorage::READ);
  // It stops where a number has the other kind.
  for (const char* key : {"Camera1.fx", "Camera1.fy", "Camera1.cx", "Camera1.k1", "Camera1.p1"}) {
    EXPECT_TRUE(file[key].isReal()) << key;
  }
  for (const char* key : {"Camera.width", "Camera.height", "Camera.fps", "Camera.RGB"}) {
    EXPECT_TRUE(file[key].isInt()) << key;
  }
}

TEST_F(Exchange, OpenCvReadsAndProjectsTheSame) {
  Export("opencv", "left");
  cv::FileStorage file(Path("file.opencv").string(), cv::FileStorage::READ);
  cv::Mat K, D;
  file["camera_matrix"] >> K;
  file["distortion_coefficients"] >> D;
  EXPECT_EQ(static_cast<int>(file["image_width"]), 640);
  const CameraModel* model = FindModel(CameraModels(), "pinhole-radial3");
  const double params[] = {500, 501.123456789012, 320.1, 240.7, -0.2, 0.051, 0.0123};
  std::mt19937 random(1);
  std::uniform_real_distribution<double> lateral(-0.5, 0.5), depth(0.5, 5);
  std::vector<cv::Point3d> points;
  for (int i = 0; i < 1000; ++i) {
    const double z = depth(random);
    points.emplace_back(z * lateral(random), z * lateral(random), z);
  }
  std::vector<cv::Point2d> pixels;
  cv::projectPoints(points, cv::Vec3d(), cv::Vec3d(), K, D, pixels);
  for (size_t i = 0; i < points.size(); ++i) {
    double u[2];
    ASSERT_TRUE(
        model->Project(params, nullptr, nullptr, {points[i].x, points[i].y, points[i].z}, u));
    EXPECT_NEAR(u[0], pixels[i].x, 1e-6);
    EXPECT_NEAR(u[1], pixels[i].y, 1e-6);
  }
}

class SplinedExchange : public Exchange {
 protected:
  SplinedExchange() { WriteExample("splined"); }

  // MODEL.yaml: a camera with the model's example parameters.
  void WriteExample(const std::string& name) const {
    const CameraModel& model = *FindModel(CameraModels(), name);
    std::string params;
    for (size_t k = 0; k < model.params.size(); ++k) {
      params += fmt::format("{}{}: {}", k == 0 ? "" : ", ", model.params[k].name, model.example[k]);
    }
    Write(
        name + ".yaml",
        fmt::format("plenocal: 1\ncameras:\n  cam:\n    model: {}\n    image_size: [640, "
                    "480]\n    parameters: {{{}}}\n    T_camera_rig: [[1, 0, 0, 0], [0, 1, 0, 0], "
                    "[0, 0, 1, 0], [0, 0, 0, 1]]\n",
                    name,
                    params));
  }
};

TEST_F(SplinedExchange, MrcalsFileHoldsAllOfIt) {
  Export("mrcal", "cam", "splined.yaml");
  const YAML::Node camera = Import("mrcal", "file.mrcal")["cameras"].begin()->second;
  EXPECT_EQ(camera["model"].as<std::string>(), "splined");
  const CameraModel& splined = *FindModel(CameraModels(), "splined");
  for (size_t k = 0; k < splined.params.size(); ++k) {
    EXPECT_EQ(camera["parameters"][std::string(splined.params[k].name)].as<double>(),
              splined.example[k])
        << splined.params[k].name;
  }
  Write("half.yaml", Replaced(Read("splined.yaml"), "fov: 160", "fov: 160.5"));
  ExpectRefused(kJobFailed,
                {"export", "half.yaml", "--format", "mrcal", "-o", "half.cameramodel"},
                {"whole degrees", "fov: 161"});
  Write("odd.cameramodel", Replaced(Read("file.mrcal"), "_deg=160", "_deg=16x"));
  ExpectRefused(kWrongInput,
                {"import", "odd.cameramodel", "--format", "mrcal", "-o", "out"},
                {"odd.cameramodel:2:", "the order is 2 or 3"});
  Write("odd.cameramodel", Replaced(Read("file.mrcal"), "_Nx=11", "_Nx=100"));
  ExpectRefused(kWrongInput,
                {"import", "odd.cameramodel", "--format", "mrcal", "-o", "out"},
                {"odd.cameramodel:2:", "splined-100x9", "4 to 60 columns"});
}

TEST_F(SplinedExchange, MrcalProjectsTheSame) {
  if (std::system("/usr/bin/python3 -c 'import mrcal' 2>/dev/null") != 0) {
    GTEST_SKIP() << "no python3-mrcal";
  }
  for (const std::string name : {"splined", "splined-30x20", "splined2-20x14", "spherical"}) {
    SCOPED_TRACE(name);
    WriteExample(name);
    Export("mrcal", "cam", name + ".yaml");
    // To 85 degrees off the axis, so that the last cells and what lies beyond take part.
    Write("project.py", R"(
import mrcal, numpy as np
t, a = np.meshgrid(np.linspace(0, 1.48, 40), np.linspace(0, 6.2, 25))
p = np.stack((np.sin(t) * np.cos(a), np.sin(t) * np.sin(a), np.cos(t)), -1).reshape(-1, 3)
q = mrcal.project(p, *mrcal.cameramodel('file.mrcal').intrinsics())
print('X,Y,Z,x,y')
for row in np.hstack((p, q)): print(','.join(f'{value:.17g}' for value in row))
)");
    const std::string command =
        "cd " + Path("").string() + " && /usr/bin/python3 project.py > projected.csv";
    ASSERT_EQ(std::system(command.c_str()), 0);
    const Table projected(Read("projected.csv"));
    const std::vector<double> X = projected.Numbers("X"), Y = projected.Numbers("Y"),
                              Z = projected.Numbers("Z"), x = projected.Numbers("x"),
                              y = projected.Numbers("y");
    ASSERT_EQ(x.size(), 1000U);
    int imaged = 0;
    for (size_t i = 0; i < x.size(); ++i) {
      double u[2];
      const CameraModel& model = *FindModel(CameraModels(), name);
      if (!model.Project(model.example.data(), nullptr, nullptr, {X[i], Y[i], Z[i]}, u)) continue;
      ++imaged;
      EXPECT_NEAR(u[0], x[i], 1e-9);
      EXPECT_NEAR(u[1], y[i], 1e-9);
    }
    EXPECT_GT(imaged, 900);
  }
}

TEST_F(Exchange, MrcalReadsAndProjectsTheSame) {
  if (std::system("/usr/bin/python3 -c 'import mrcal' 2>/dev/null") != 0) {
    GTEST_SKIP() << "no python3-mrcal";
  }
  Export("mrcal", "right");
  Write("project.py", R"(
import mrcal, numpy as np
m = mrcal.cameramodel('file.mrcal')
assert tuple(m.imagersize()) == (640, 480)
p = np.array([[0.001 * i - 0.3, 0.2 - 0.0005 * i, 1 + 0.002 * i] for i in range(1000)])
q = mrcal.project(mrcal.transform_point_Rt(m.extrinsics_Rt_fromref(), p), *m.intrinsics())
for x, y in q: print(f'{x:.12f},{y:.12f}')
)");
  const std::string command =
      "cd " + Path("").string() + " && /usr/bin/python3 project.py > projected.csv";
  ASSERT_EQ(std::system(command.c_str()), 0);
  const Table projected("x,y\n" + Read("projected.csv"));
  const std::vector<double> x = projected.Numbers("x"), y = projected.Numbers("y");
  ASSERT_EQ(x.size(), 1000U);
  const CameraModel* model = FindModel(CameraModels(), "pinhole-radial3");
  const double params[] = {510.7, 511.3, 318.3, 244.9, -0.21, 0.06, 0};
  const Eigen::Matrix4d T = Matrix(YAML::Load(kStereo)["cameras"]["right"]["T_camera_rig"]);
  for (int i = 0; i < 1000; ++i) {
    const Eigen::Vector3d p(0.001 * i - 0.3, 0.2 - 0.0005 * i, 1 + 0.002 * i);
    double u[2];
    ASSERT_TRUE(model->Project(
        params, nullptr, nullptr, T.topLeftCorner<3, 3>() * p + T.topRightCorner<3, 1>(), u));
    EXPECT_NEAR(u[0], x[static_cast<size_t>(i)], 1e-6);
    EXPECT_NEAR(u[1], y[static_cast<size_t>(i)], 1e-6);
  }
}

// COLMAP has no command that projects; the cost with which its bundle adjustment starts on points
// and our projections of them is what it sees differently.
TEST_F(Exchange, ColmapReadsAndProjectsTheSame) {
  if (std::system("colmap help >/dev/null 2>&1") != 0) GTEST_SKIP() << "no colmap";
  Export("colmap", "left");
  std::filesystem::create_directories(Path("model"));
  std::filesystem::create_directories(Path("out"));
  std::filesystem::rename(Path("file.colmap"), Path("model/cameras.txt"));
  const CameraModel* model = FindModel(CameraModels(), "pinhole-radial3");
  const double params[] = {500, 501.123456789012, 320.1, 240.7, -0.2, 0.051, 0.0123};
  std::array<std::string, 2> observations;
  std::string points;
  for (int i = 0; i < 1000; ++i) {
    const Eigen::Vector3d p(
        0.5 * std::sin(i), 0.4 * std::cos(3.1 * i), 1.5 + std::sin(0.7 * i) / 2);
    for (size_t c = 0; c < 2; ++c) {
      double u[2];
      const Eigen::Vector3d seen = p + Eigen::Vector3d(c == 0 ? 0 : 0.1, 0, 0);
      ASSERT_TRUE(model->Project(params, nullptr, nullptr, seen, u));
      observations[c] += fmt::format("{} {} {} ", u[0] + 0.5, u[1] + 0.5, i + 1);
    }
    points += fmt::format("{0} {1} {2} {3} 0 0 0 0 1 {4} 2 {4}\n", i + 1, p.x(), p.y(), p.z(), i);
  }
  Write("model/images.txt",
        "1 1 0 0 0 0 0 0 1 a.png\n" + observations[0] + "\n2 1 0 0 0 0.1 0 0 1 b.png\n" +
            observations[1] + "\n");
  Write("model/points3D.txt", points);
  const std::string command = "cd " + Path("").string() +
                              " && QT_QPA_PLATFORM=offscreen colmap bundle_adjuster --input_path "
                              "model --output_path out --BundleAdjustment.max_num_iterations 1 > "
                              "log.txt 2>&1";
  ASSERT_EQ(std::system(command.c_str()), 0) << Read("log.txt");
  const std::string log = Read("log.txt");
  const std::string label = "Initial cost : ";
  const size_t at = log.find(label);
  ASSERT_NE(at, std::string::npos) << log;
  EXPECT_LT(std::stod(log.substr(at + label.size())), 1e-6);  // px
}

TEST_F(Exchange, BothKeyStylesOfOpenCvAreRead) {
  const std::string head = "%YAML:1.0\n---\nimage_width: 640\nimage_height: 480\n";
  const auto matrix = [](const std::string& key, int n, const std::string& data) {
    return fmt::format(
        "{}: !!opencv-matrix\n   rows: {}\n   cols: 1\n   dt: d\n   data: [ {} ]\n", key, n, data);
  };
  const std::string K = "500., 0., 320., 0., 501., 240., 0., 0., 1.";
  Write("a.yml",
        head + matrix("camera_matrix", 9, K) +
            matrix("distortion_coefficients", 5, "-0.1, 0.02, 0., 0., 3.e-03"));
  Write(
      "b.yml",
      head + matrix("cameraMatrix", 9, K) + matrix("distCoeffs", 5, "-0.1, 0.02, 0., 0., 3.e-03"));
  Write("c.yml",
        head + matrix("M1", 9, K) + matrix("D1", 5, "-0.1, 0.02, 0., 0., 3.e-03") +
            matrix("M2", 9, K) + matrix("D2", 5, "-0.1, 0.02, 0., 0., 3.e-03") +
            matrix("R", 9, "1., 0., 0., 0., 1., 0., 0., 0., 1.") + matrix("T", 3, "-0.1, 0., 0."));
  for (const char* file : {"a.yml", "b.yml", "c.yml"}) {
    SCOPED_TRACE(file);
    const YAML::Node camera = Import("opencv", file)["cameras"].begin()->second;
    EXPECT_EQ(camera["parameters"]["A_2"].as<double>(), 0.003);
    EXPECT_EQ(camera["parameters"]["f_y"].as<double>(), 501);
  }
  Write("d.yml", "%YAML:1.0\n---\n" + matrix("camera_matrix", 9, K));
  ExpectRefused(
      kWrongInput, {"import", "d.yml", "--format", "opencv", "-o", "out"}, {"d.yml", "--size"});
  EXPECT_EQ(Run({"import", "d.yml", "--format", "opencv", "--size", "640x480", "-o", "out"}).status,
            kDone);
}

TEST_F(Exchange, LifcalIsInMillimetres) {
  Write("plenoptic.yaml", kPlenoptic);
  const std::string text = Export("lifcal", "", "plenoptic.yaml");
  EXPECT_THAT(text,
              AllOf(HasSubstr("<FocalLength units=\"mm\">16.1</FocalLength>"),
                    HasSubstr("<PixelSize units=\"mm\">0.0055</PixelSize>"),
                    HasSubstr("<B0>6.1e-05</B0>"),
                    HasSubstr("<Width>2048</Width>")));
  const YAML::Node back = Import("lifcal", "file.lifcal")["cameras"].begin()->second;
  ExpectSameParameters(YAML::Load(kPlenoptic)["cameras"]["plenoptic"], back);
  EXPECT_EQ(back["pixel_size"].as<double>(), 5.5e-6);
}

TEST_F(Exchange, WhatAFormatCannotHoldIsRefusedWithTheWayOut) {
  const auto refused = [&](const std::string& calibration,
                           const std::string& format,
                           const std::vector<std::string>& parts) {
    ExpectRefused(kJobFailed,
                  {"export",
                   calibration,
                   "--format",
                   format,
                   "--camera",
                   calibration == "plenoptic.yaml" ? "plenoptic" : "left",
                   "-o",
                   "out." + format},
                  parts);
    EXPECT_FALSE(std::filesystem::exists(Path("out." + format)));
  };
  Write("plenoptic.yaml", kPlenoptic);
  for (const auto& [format, holds_A_2] : OrdinaryFormats()) {
    refused("plenoptic.yaml", format, {"plenoptic", format, "plenocal undistort"});
  }
  refused("calibration.yaml", "kalibr", {"left", "A_2", "plenocal convert"});
  refused("calibration.yaml", "dso", {"left", "A_2", "plenocal convert"});
  refused("calibration.yaml", "lifcal", {"left", "focused-plenoptic"});
  ExpectRefused(kWrongInput,
                {"export", "calibration.yaml", "--format", "dso", "-o", "out.yaml"},
                {"1 camera", "left, right", "--camera"});
  ExpectRefused(kWrongInput,
                {"export", "calibration.yaml", "--format", "kalib", "-o", "out.yaml"},
                {"'kalib'", "'kalibr'"});
  ExpectRefused(
      kWrongInput,
      {"export", "calibration.yaml", "--format", "ros", "--camera", "lef", "-o", "o.yaml"},
      {"'lef'", "'left'"});
}

TEST_F(Exchange, NamesOfFilesAreThoseOfCamerasWhereTheyMayBe) {
  const std::string model = Export("mrcal", "right");
  for (const auto& [file, camera] :
       {std::pair("right.v2.cameramodel", "right.v2"), {"right 2.cameramodel", "right_2"}}) {
    Write(file, model);
    const Outcome outcome = Run({"import", file, "--format", "mrcal", "-o", "named"});
    ASSERT_EQ(outcome.status, kDone) << outcome.err;
    EXPECT_TRUE(YAML::Load(Read("named/calibration.yaml"))["cameras"][camera]) << camera;
  }
}

TEST_F(Exchange, FilesThatAreWrongAreNamed) {
  const auto refused = [&](const std::string& format,
                           const std::string& text,
                           const std::vector<std::string>& parts) {
    Write("bad.file", text);
    ExpectRefused(kWrongInput, {"import", "bad.file", "--format", format, "-o", "out"}, parts);
    EXPECT_TRUE(Files("out").empty());
  };
  const std::string kalibr = Export("kalibr", "right");
  refused("kalibr", Replaced(kalibr, "intrinsics: [5", "intrinsics: [x"), {"bad.file:", "'x"});
  refused("kalibr", Replaced(kalibr, "radtan", "radtam"), {"bad.file:", "radtam"});
  refused("kalibr",
          Replaced(kalibr, "0.0, 0.0]", "0.0, 0.0, 0.5]"),
          {"bad.file:", "4 coefficients, not 5"});
  refused("colmap", "1 FULL_OPENCV 640 480 500", {"bad.file:1:", "PARAMS"});
  refused("colmap", "1 PINHOLE 640 480 500 500 nan 240 0.1", {"bad.file:1:", "nan"});
  refused("dso", "RadTan 1 1 0.5 0.5 0 0 0 0\n", {"bad.file:1:", "second line"});
  refused("lifcal", "<Root><ImageSize>", {"bad.file", "XML"});
  refused("lifcal", "<Root></Root>", {"bad.file", "Width"});
  for (const char* width : {"0", "1000000", "-3", "nan"}) {
    refused("lifcal",
            fmt::format("<Root><ImageSize><Width>{}</Width><Height>9</Height></ImageSize></Root>",
                        width),
            {"bad.file", "<ImageSize><Width>: expected a number", width});
  }
  refused("mrcal", "{ 'lensmodel': 'LENSMODEL_CAHVOR' }", {"bad.file", "intrinsics"});
  std::vector<std::string_view> all = NamesOf(CameraFormats());
  all.push_back("mrcal-corners");
  for (const std::string_view name : all) {
    const std::string format(name);
    refused(format, "", {"bad.file"});
    refused(format, "hello: [world\n", {"bad.file"});
  }
}

TEST_F(Exchange, EachFormatIsInTheHelpAndInTheDocuments) {
  std::ifstream file(std::filesystem::path(PLENOCAL_DOCS) / "exchange.md");
  const std::string document{std::istreambuf_iterator<char>(file), {}};
  const std::string to_help = Run({"export", "--help"}).out;
  const std::string from_help = Run({"import", "--help"}).out;
  for (const CameraFormat& format : CameraFormats()) {
    if (!format.variant_of.empty()) continue;
    EXPECT_THAT(to_help, HasSubstr(std::string(format.name)));
    EXPECT_THAT(document, HasSubstr(fmt::format("`{}`", format.name)));
  }
  for (const ImportFormat& format : ImportFormats()) {
    EXPECT_THAT(from_help, HasSubstr(std::string(format.name)));
    EXPECT_THAT(document, HasSubstr(fmt::format("`{}`", format.name)));
  }
}

TEST_F(Exchange, KalibrTargetsCornersAndRaytrixGridsAreImported) {
  Write("aprilgrid.yaml",
        "target_type: 'aprilgrid'\ntagCols: 6\ntagRows: 5\ntagSize: 0.088\ntagSpacing: 0.3\n");
  ASSERT_EQ(Run({"import", "aprilgrid.yaml", "--format", "kalibr-target", "-o", "out"}).status,
            kDone);
  const YAML::Node target = YAML::Load(Read("out/target.yaml"));
  EXPECT_EQ(target["type"].as<std::string>(), "aprilgrid");
  EXPECT_EQ(target["columns"].as<int>(), 6);
  EXPECT_EQ(target["border_bits"].as<int>(), 2);
  Write("board.yaml",
        "target_type: checkerboard\ntargetCols: 6\ntargetRows: 7\nrowSpacingMeters: 0.06\n"
        "colSpacingMeters: 0.05\n");
  ExpectRefused(kWrongInput,
                {"import", "board.yaml", "--format", "kalibr-target", "-o", "out"},
                {"board.yaml", "unequal spacing"});

  Write("corners.vnl",
        "## mrgingham\n# filename x y level\na/f1.png 10.5 20.25 0\na/f1.png - - -\n"
        "a/f1.png 12.5 20.125 1\na/f2.png - - -\n");
  ASSERT_EQ(Run({"import", "corners.vnl", "--format", "mrcal-corners", "-o", "out"}).status, kDone);
  EXPECT_EQ(Read("out/detections_corners.csv"),
            "frame,marker,x,y,sigma\nf1,0,10.5,20.25,1\nf1,2,12.5,20.125,2\n");

  Write("grid.xml", "<RayCalibData></RayCalibData>");
  ExpectRefused(
      kWrongInput, {"import", "grid.xml", "--format", "raytrix", "-o", "out"}, {"--size"});
  for (const char* size :
       {"64x", "x64", "64", "0x64", "64x0", "64x-1", "64x64x", "99999999999x64"}) {
    ExpectRefused(kWrongInput,
                  {"import", "grid.xml", "--format", "raytrix", "--size", size, "-o", "out"},
                  {"WIDTHxHEIGHT", size});
  }
}

}  // namespace TEST_FILE
}  // namespace plenocal::testing
