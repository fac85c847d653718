// SPDX-License-Identifier: Apache-2.0
//
// plenocal map, undistort and rectify, against OpenCV's own functions.
#include <fmt/format.h>

#include <cmath>
#include <numbers>
#include <opencv2/calib3d.hpp>
#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>

#include "tests/apps/workspace.h"
#include "tests/optional_data.h"

namespace plenocal::testing {
namespace TEST_FILE {

namespace fs = std::filesystem;
using ::testing::AllOf;
using ::testing::HasSubstr;
using ::testing::Not;

constexpr const char* kCameras = R"(plenocal: 1
cameras:
  barrel:
    model: pinhole-radial3
    image_size: [160, 120]
    parameters: {f_x: 100, f_y: 104, c_x: 78.1, c_y: 61.7, A_0: -0.2, A_1: 0.03, A_2: 0.001}
    T_camera_rig: [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]
  fisheye:
    model: kannala-brandt4
    image_size: [160, 120]
    parameters: {f_x: 50, f_y: 50, c_x: 79.5, c_y: 59.5, k_1: -0.01, k_2: 0.003, k_3: 0, k_4: 0}
    T_camera_rig: [[0, 1, 0, 0.1], [-1, 0, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]
  plenoptic:
    model: focused-plenoptic
    image_size: [160, 120]
    pixel_size: 5.5e-06
    parameters: {f_L: 0.016, b_L0: 0.015, B: 0.0005, c_x: 80, c_y: 60, A_0: 0, A_1: 0, B_0: 0, B_1: 0}
    T_camera_rig: [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]
)";
const cv::Matx33d kBarrelK(100, 0, 78.1, 0, 104, 61.7, 0, 0, 1);
const std::vector<double> kBarrelD{-0.2, 0.03, 0, 0, 0.001};

class Undistort : public Workspace {
 protected:
  Undistort() { Write("calibration.yaml", kCameras); }

  // Colours of 16 bits, different everywhere.
  cv::Mat SaveColours(const std::string& name) const {
    cv::Mat image(120, 160, CV_16UC3);
    for (int y = 0; y < image.rows; ++y) {
      for (int x = 0; x < image.cols; ++x) {
        image.at<cv::Vec3w>(y, x) = cv::Vec3w(static_cast<ushort>(100 * x + 1000),
                                              static_cast<ushort>(200 * y + 1000),
                                              static_cast<ushort>(30000 + 50 * x - 70 * y));
      }
    }
    Save(name, image);
    return image;
  }
  void Save(const std::string& name, const cv::Mat& image) const {
    fs::create_directories(Path(name).parent_path());
    ASSERT_TRUE(cv::imwrite(Path(name).string(), image));
  }
  [[nodiscard]] cv::Mat Load(const std::string& name) const {
    return cv::imread(Path(name).string(), cv::IMREAD_UNCHANGED);
  }
  std::string Done(const std::vector<std::string>& arguments) const {
    const Outcome outcome = Run(arguments);
    EXPECT_EQ(outcome.status, kDone) << outcome.err;
    return outcome.out + outcome.err;
  }
  void ExpectRefused(int status,
                     const std::vector<std::string>& arguments,
                     const std::vector<std::string>& parts) const {
    const Outcome outcome = Run(arguments);
    EXPECT_EQ(outcome.status, status) << outcome.err;
    EXPECT_EQ(Lines(outcome.err).size(), 1U) << outcome.err;
    for (const std::string& part : parts) EXPECT_THAT(outcome.err, HasSubstr(part));
    EXPECT_TRUE(Files("out").empty());
  }
  // f_x, f_y, c_x, c_y of the one camera in a folder.
  [[nodiscard]] std::vector<double> Pinhole(const std::string& folder) const {
    const YAML::Node camera =
        YAML::Load(Read(folder + "/calibration.yaml"))["cameras"].begin()->second;
    EXPECT_EQ(camera["model"].as<std::string>(), "pinhole");
    std::vector<double> values;
    for (const char* name : {"f_x", "f_y", "c_x", "c_y"}) {
      values.push_back(camera["parameters"][name].as<double>());
    }
    return values;
  }
};

TEST_F(Undistort, MapsAreThoseOfOpenCv) {
  Done({"map", "calibration.yaml", "--camera", "barrel", "-o", "barrel"});
  cv::Mat x, y;
  cv::initUndistortRectifyMap(
      kBarrelK, kBarrelD, cv::noArray(), kBarrelK, {160, 120}, CV_32F, x, y);
  ASSERT_EQ(Load("barrel/map_x.tiff").type(), CV_32F);
  EXPECT_LT(cv::norm(Load("barrel/map_x.tiff"), x, cv::NORM_INF), 1e-4);
  EXPECT_LT(cv::norm(Load("barrel/map_y.tiff"), y, cv::NORM_INF), 1e-4);
  EXPECT_EQ(Pinhole("barrel"), (std::vector{100.0, 104.0, 78.1, 61.7}));

  Done({"map", "calibration.yaml", "--camera", "fisheye", "--size", "200x100", "-o", "f.yaml"});
  cv::FileStorage storage(Path("f.yaml").string(), cv::FileStorage::READ);
  cv::Mat K, stored_x, stored_y;
  storage["camera_matrix"] >> K;
  storage["map_x"] >> stored_x;
  storage["map_y"] >> stored_y;
  const double scale = 100.0 / 120;
  EXPECT_NEAR(K.at<double>(0, 0), 50 * scale, 1e-12);
  EXPECT_NEAR(K.at<double>(0, 2), 99.5, 1e-12);  // the principal point lies in the middle
  const cv::Matx33d fisheye_K(50, 0, 79.5, 0, 50, 59.5, 0, 0, 1);
  cv::fisheye::initUndistortRectifyMap(
      fisheye_K, cv::Vec4d(-0.01, 0.003, 0, 0), cv::noArray(), K, {200, 100}, CV_32F, x, y);
  EXPECT_LT(cv::norm(stored_x, x, cv::NORM_INF), 1e-4);
  EXPECT_LT(cv::norm(stored_y, y, cv::NORM_INF), 1e-4);
}

TEST_F(Undistort, ImagesAreThoseOfOpenCvInDepthAndColour) {
  const cv::Mat image = SaveColours("in/a.tiff");
  Done({"undistort", "calibration.yaml", "--camera", "barrel", "in", "-o", "out", "--mask"});
  EXPECT_EQ(Results("out"), (std::vector<std::string>{"a.png", "calibration.yaml", "mask.png"}));
  const cv::Mat ours = Load("out/a.png");
  ASSERT_EQ(ours.type(), CV_16UC3);
  cv::Mat theirs;
  cv::undistort(image, theirs, kBarrelK, kBarrelD);
  // Barrel distortion: all pixels have a source; the outermost half pixel is ours to fill.
  EXPECT_EQ(cv::countNonZero(Load("out/mask.png")), 160 * 120);
  // OpenCV's places have 5 bits of fraction, so a place beside a step may fall on its other side.
  const cv::Rect inner(2, 2, 156, 116);
  EXPECT_LE(cv::norm(ours(inner), theirs(inner), cv::NORM_INF), 200.0 / 32 + 1);
}

TEST_F(Undistort, TheFieldOfViewIsChosen) {
  SaveColours("a.png");
  const auto undistort = [&](const std::vector<std::string>& options, const std::string& camera) {
    std::vector<std::string> arguments{
        "undistort", "calibration.yaml", "--camera", camera, "a.png", "-o", "out", "--mask"};
    arguments.insert(arguments.end(), options.begin(), options.end());
    return Done(arguments);
  };
  undistort({"--fov", "80", "--size", "300x100"}, "barrel");
  const double f = 150 / std::tan(40 * std::numbers::pi / 180);
  EXPECT_NEAR(Pinhole("out")[0], f, 1e-9);
  EXPECT_NEAR(Pinhole("out")[1], f, 1e-9);
  EXPECT_EQ(Pinhole("out")[2], 149.5);
  EXPECT_EQ(Load("out/a.png").size(), cv::Size(300, 100));

  // All pixels have a source, and a little less of f would lose some.
  undistort({"--balance", "0"}, "barrel");
  EXPECT_EQ(cv::countNonZero(Load("out/mask.png")), 160 * 120);
  const std::vector<double> inner = Pinhole("out");
  // All of the image is seen, black around it.
  undistort({"--balance", "1"}, "barrel");
  const std::vector<double> outer = Pinhole("out");
  const cv::Mat mask = Load("out/mask.png");
  EXPECT_LT(cv::countNonZero(mask), 160 * 120);
  EXPECT_EQ(cv::countNonZero(Load("out/a.png")
                                 .reshape(1)
                                 .setTo(0,
                                        [&] {
                                          cv::Mat three;
                                          cv::merge(std::vector<cv::Mat>(3, mask), three);
                                          return three.reshape(1);
                                        }())),
            0);
  std::vector<cv::Point2d> corners;
  cv::undistortPoints(
      std::vector<cv::Point2d>{{-0.5, -0.5}, {159.5, -0.5}, {159.5, 119.5}, {-0.5, 119.5}},
      corners,
      kBarrelK,
      kBarrelD,
      cv::noArray(),
      cv::noArray(),
      cv::TermCriteria(cv::TermCriteria::COUNT, 200, 0));
  double touching = 1e9;
  for (const cv::Point2d& corner : corners) {
    const double x = outer[0] * corner.x + outer[2], y = outer[1] * corner.y + outer[3];
    for (const double inside : {x + 0.5, 159.5 - x, y + 0.5, 119.5 - y}) {
      EXPECT_GT(inside, -0.01);
      touching = std::min(touching, inside);
    }
  }
  EXPECT_LT(touching, 0.01);
  undistort({"--balance", "0.5"}, "barrel");
  EXPECT_NEAR(1 / Pinhole("out")[0], (1 / inner[0] + 1 / outer[0]) / 2, 1e-12);
  // Edges of the whole image, by OpenCV: its inner rectangle need not be centred, so it is larger.
  const cv::Mat inner_K =
      cv::getOptimalNewCameraMatrix(kBarrelK, kBarrelD, {160, 120}, 0, {160, 120});
  EXPECT_GT(inner[0], 0.98 * std::min(inner_K.at<double>(0, 0), inner_K.at<double>(1, 1)));
  EXPECT_LT(inner[0], 1.05 * std::max(inner_K.at<double>(0, 0), inner_K.at<double>(1, 1)));

  undistort({"--balance", "0"}, "fisheye");
  EXPECT_EQ(cv::countNonZero(Load("out/mask.png")), 160 * 120);
  // The pose of the camera stays, and the original's distortion is gone.
  const YAML::Node node = YAML::Load(Read("out/calibration.yaml"))["cameras"]["fisheye"];
  EXPECT_EQ(node["T_camera_rig"][0][3].as<double>(), 0.1);
}

TEST_F(Undistort, VignettingIsRemoved) {
  cv::Mat attenuation(120, 160, CV_32F), image(120, 160, CV_8U);
  for (int y = 0; y < 120; ++y) {
    for (int x = 0; x < 160; ++x) {
      const float a = 1 - 0.4F * static_cast<float>(std::hypot(x - 80, y - 60)) / 100;
      attenuation.at<float>(y, x) = a;
      image.at<uchar>(y, x) = static_cast<uchar>(std::lround(200 * a));
    }
  }
  Save("v.tiff", attenuation);
  Save("a.png", image);
  Write("calibration.yaml",
        Replaced(kCameras, "A_2: 0.001}\n", "A_2: 0.001}\n    vignetting: v.tiff\n"));
  Done({"undistort", "calibration.yaml", "--camera", "barrel", "a.png", "-o", "out"});
  double low = 0, high = 0;
  cv::minMaxLoc(Load("out/a.png"), &low, &high);
  EXPECT_GE(low, 199);
  EXPECT_LE(high, 201);
  Done({"undistort",
        "calibration.yaml",
        "--camera",
        "barrel",
        "a.png",
        "-o",
        "out",
        "--keep-vignetting"});
  cv::minMaxLoc(Load("out/a.png"), &low, &high);
  EXPECT_LT(low, 140);
  fs::remove_all(Path("out"));
  fs::remove(Path("v.tiff"));
  ExpectRefused(kWrongInput,
                {"undistort", "calibration.yaml", "--camera", "barrel", "a.png", "-o", "out"},
                {"v.tiff"});
}

TEST_F(Undistort, MosaicsBecomeColours) {
  // Red at places with even x and y only.
  cv::Mat mosaic(120, 160, CV_8U, cv::Scalar(0));
  for (int y = 0; y < 120; y += 2) {
    for (int x = 0; x < 160; x += 2) mosaic.at<uchar>(y, x) = 180;
  }
  Save("a.png", mosaic);
  Done({"undistort",
        "calibration.yaml",
        "--camera",
        "barrel",
        "a.png",
        "-o",
        "out",
        "--bayer",
        "RGGB"});
  const cv::Vec3b middle = Load("out/a.png").at<cv::Vec3b>(60, 80);
  EXPECT_EQ(middle[2], 180);
  EXPECT_EQ(middle[0], 0);
}

TEST_F(Undistort, TheMapsCameraIsPrinted) {
  EXPECT_EQ(Lines(Done({"map", "calibration.yaml", "--camera", "barrel", "-o", "map"}))[0],
            "barrel: 160 x 120 px, f 100.00 104.00 px, c 78.10 61.70 px, 77.3 x 59.9 degrees");
}

TEST_F(Undistort, CamerasWithoutASingleCentreAreExactAtADistance) {
  const std::string camera =
      "{model: equidistant+pupil, image_size: [160, 120], parameters: {f_x: 60, f_y: 60, c_x: 80, "
      "c_y: 60, e_0: 0.02, e_1: 0, e_2: 0}";
  Write("board.yaml", "plenocal: 1\ntype: chessboard\ncolumns: 8\nrows: 5\nsquare: 0.03\n");
  Write("spec.yaml",
        fmt::format("plenocal: 1\ntarget: board.yaml\ncameras:\n  left: {0}}}\n  right: {0}, "
                    "xi_camera_rig: [-0.1, 0, 0, 0, 0, 0]}}\n"
                    "poses: {{frames: 3, distance: [0.4, 0.4]}}\n",
                    camera));
  Done({"simulate", "spec.yaml", "--points", "-o", "set"});
  const std::string calibration = "set/truth/calibration.yaml";
  ExpectRefused(kJobFailed,
                {"rectify", calibration, "-o", "out"},
                {"camera 'left'", "by more than 1 px", "--distance"});
  ExpectRefused(kWrongInput,
                {"rectify", calibration, "-o", "out", "--distance", "-1"},
                {"distance: expected a number from 0.001"});
  Done({"rectify", calibration, "-o", "out", "--distance", "0.5"});
  EXPECT_THAT(Read("out/calibration.yaml"), HasSubstr("exact_at: \"left 0.5 m, right 0.5 m\""));
  SaveColours("a.png");
  for (const std::vector<std::string>& command :
       {std::vector<std::string>{"map", calibration, "--camera", "right", "-o", "map"},
        {"undistort", calibration, "--camera", "right", "a.png", "-o", "undistorted"}}) {
    EXPECT_THAT(
        Done(command),
        HasSubstr("camera 'right': equidistant+pupil has no single centre; the map is exact"));
  }
}

TEST_F(Undistort, WhatCannotBeIsRefused) {
  SaveColours("a.png");
  SaveColours("b/a.png");
  Save("small.png", cv::Mat(100, 160, CV_8U, cv::Scalar(7)));
  const auto refused = [&](int status,
                           const std::vector<std::string>& rest,
                           const std::vector<std::string>& parts) {
    std::vector<std::string> arguments{"undistort", "calibration.yaml", "-o", "out", "--camera"};
    arguments.insert(arguments.end(), rest.begin(), rest.end());
    ExpectRefused(status, arguments, parts);
  };
  refused(kWrongInput, {"fisheye", "a.png", "--balance", "1"}, {"90 degrees", "--fov"});
  refused(kWrongInput, {"plenoptic", "a.png"}, {"micro_lenses"});
  refused(kWrongInput, {"barrle", "a.png"}, {"'barrel'"});
  refused(kWrongInput, {"barrel", "small.png"}, {"small.png", "160 x 100", "160 x 120"});
  refused(kWrongInput, {"barrel", "a.png", "b/a.png"}, {"a.png", "-o"});
  fs::copy_file(Path("a.png"), Path("mask.png"));
  refused(kWrongInput, {"barrel", "mask.png", "--mask"}, {"mask.png", "leave out --mask"});
  refused(kWrongInput, {"barrel", "a.png", "--size", "12by9"}, {"WIDTHxHEIGHT"});
  refused(kWrongInput, {"barrel", "a.png", "--balance", "2"}, {"--balance"});
  refused(kWrongInput, {"barrel", "a.png", "--bayer", "RGGB"}, {"a.png", "--bayer"});
  refused(kWrongInput, {"barrel", "none.png"}, {"none.png"});
  const Outcome replaced =
      Run({"undistort", "calibration.yaml", "--camera", "barrel", "b", "-o", "b"});
  EXPECT_EQ(replaced.status, kWrongInput);
  EXPECT_THAT(replaced.err, HasSubstr("replace"));
  // One bad image costs itself.
  EXPECT_THAT(Done({"undistort",
                    "calibration.yaml",
                    "--camera",
                    "barrel",
                    "a.png",
                    "small.png",
                    "-o",
                    "out"}),
              AllOf(HasSubstr("left out small.png"), HasSubstr("1 image;")));
}

// Two cameras, the second in T_second_first, and what both see of a cloud of points.
struct Pair {
  Eigen::Matrix3d R;
  Eigen::Vector3d t;
};

class RectifyPair : public Undistort {
 protected:
  void WritePair(const Pair& pair) const {
    std::string text = "plenocal: 1\ncameras:\n";
    for (int c = 0; c < 2; ++c) {
      text += fmt::format(
          "  {}:\n    model: pinhole-radial3\n    image_size: [160, 120]\n"
          "    parameters: {{f_x: {}, f_y: {}, c_x: 78.1, c_y: 61.7, A_0: -0.2, A_1: 0.03, A_2: "
          "0.001}}\n    T_camera_rig: [",
          c == 0 ? "one" : "two",
          100 + 7 * c,
          104 + 3 * c);
      for (int r = 0; r < 3; ++r) {
        const Eigen::RowVector3d row =
            c == 0 ? Eigen::RowVector3d(Eigen::RowVector3d::Unit(r)) : pair.R.row(r);
        text +=
            fmt::format("[{}, {}, {}, {}], ", row.x(), row.y(), row.z(), c == 0 ? 0 : pair.t[r]);
      }
      text += "[0, 0, 0, 1]]\n";
    }
    Write("pair.yaml", text);
    const auto K = [](int c) {
      return cv::Matx33d(100 + 7 * c, 0, 78.1, 0, 104 + 3 * c, 61.7, 0, 0, 1);
    };
    for (int c = 0; c < 2; ++c) {
      std::string csv = "frame,marker,x,y\n";
      for (int i = 0; i < 60; ++i) {
        Eigen::Vector3d p(0.3 * std::sin(i), 0.2 * std::cos(2.3 * i), 1 + 0.4 * std::sin(0.7 * i));
        if (c == 1) p = pair.R * p + pair.t;
        std::vector<cv::Point2d> u;
        cv::projectPoints(std::vector{cv::Point3d(p.x(), p.y(), p.z())},
                          cv::Vec3d(),
                          cv::Vec3d(),
                          K(c),
                          kBarrelD,
                          u);
        csv += fmt::format("f,{},{:.15g},{:.15g}\n", i, u[0].x, u[0].y);
      }
      Write(c == 0 ? "detections_one.csv" : "detections_two.csv", csv);
    }
  }

  // Rectifies and checks what holds of every pair; returns T_camera_rig of the second.
  Eigen::Matrix4d ExpectRectified(const Pair& pair,
                                  const std::vector<std::string>& options = {}) const {
    WritePair(pair);
    std::vector<std::string> arguments{"rectify", "pair.yaml", "-o", "out"};
    arguments.insert(arguments.end(), options.begin(), options.end());
    output_ = Done(arguments);
    EXPECT_THAT(output_, HasSubstr("over 60 points in 1 pair: RMS 0.0000 px, mean |dy| 0.0000 px"));
    const YAML::Node cameras = YAML::Load(Read("out/calibration.yaml"))["cameras"];
    for (const char* name : {"f_x", "f_y", "c_x", "c_y"}) {
      EXPECT_EQ(cameras["one"]["parameters"][name].as<double>(),
                cameras["two"]["parameters"][name].as<double>());
    }
    EXPECT_EQ(cameras["one"]["parameters"]["f_x"].as<double>(),
              cameras["one"]["parameters"]["f_y"].as<double>());
    EXPECT_EQ(Matrix(cameras["one"]["T_camera_rig"]), Eigen::Matrix4d(Eigen::Matrix4d::Identity()));
    Eigen::Matrix4d T = Matrix(cameras["two"]["T_camera_rig"]);
    Eigen::Matrix4d pure = Eigen::Matrix4d::Identity();
    pure(0, 3) = T(0, 3);
    EXPECT_EQ(T, pure);
    EXPECT_NEAR(std::abs(T(0, 3)), pair.t.norm(), 1e-12);
    ExpectOpenCvUses();
    return T;
  }

  // R1 P1 R2 P2 give OpenCV the same row in both images, Q the point.
  void ExpectOpenCvUses() const {
    cv::FileStorage file(Path("out/rectification.yaml").string(), cv::FileStorage::READ);
    std::array<cv::Mat, 2> R, P;
    cv::Mat Q;
    file["R1"] >> R[0];
    file["R2"] >> R[1];
    file["P1"] >> P[0];
    file["P2"] >> P[1];
    file["Q"] >> Q;
    std::array<std::vector<cv::Point2d>, 2> rectified;
    for (int c = 0; c < 2; ++c) {
      const Table table(Read(c == 0 ? "detections_one.csv" : "detections_two.csv"));
      std::vector<cv::Point2d> points;
      const auto x = table.Numbers("x"), y = table.Numbers("y");
      for (std::size_t i = 0; i < x.size(); ++i) points.emplace_back(x[i], y[i]);
      const auto k = static_cast<std::size_t>(c);
      cv::undistortPoints(points,
                          rectified[k],
                          cv::Matx33d(100 + 7 * c, 0, 78.1, 0, 104 + 3 * c, 61.7, 0, 0, 1),
                          kBarrelD,
                          R[k],
                          P[k],
                          cv::TermCriteria(cv::TermCriteria::COUNT, 200, 0));
    }
    for (std::size_t i = 0; i < rectified[0].size(); ++i) {
      const cv::Point2d a = rectified[0][i], b = rectified[1][i];
      EXPECT_NEAR(a.y, b.y, 1e-6);
      std::vector<cv::Point3d> space;
      cv::perspectiveTransform(std::vector{cv::Point3d(a.x, a.y, a.x - b.x)}, space, Q);
      const cv::Matx33d R_1(R[0]);
      const double angle = 0.7 * static_cast<double>(i);
      const cv::Vec3d truth = R_1 * cv::Vec3d(0.3 * std::sin(static_cast<double>(i)),
                                              0.2 * std::cos(2.3 * static_cast<double>(i)),
                                              1 + 0.4 * std::sin(angle));
      EXPECT_LT(cv::norm(cv::Vec3d(space[0].x, space[0].y, space[0].z) - truth), 1e-6);
    }
  }

  mutable std::string output_;
};

Eigen::Matrix3d Turn(double x, double y, double z) { return ExpRotation(Eigen::Vector3d(x, y, z)); }

TEST_F(RectifyPair, PointsLieInEqualRows) {
  EXPECT_LT(ExpectRectified({Turn(0.03, -0.1, 0.05), {-0.2, 0.01, 0.02}})(0, 3), 0);
  EXPECT_THAT(output_, HasSubstr("160 x 120 px"));
  // Swapped: still upright, disparities negative.
  EXPECT_GT(ExpectRectified({Turn(-0.03, 0.1, -0.05), {0.2, -0.01, -0.02}})(0, 3), 0);
  EXPECT_THAT(output_, HasSubstr("negative"));
  ExpectRectified({Turn(0, 0, 0), {-0.2, 0, 0}}, {"--fov", "70", "--size", "200x80"});
  EXPECT_THAT(output_, HasSubstr("200 x 80 px"));
}

TEST_F(RectifyPair, CamerasAboveEachOtherAreTurned) {
  for (const double side : {-1.0, 1.0}) {
    EXPECT_LT(ExpectRectified({Turn(0.05, 0.01, 0.02), {0.01, 0.2 * side, 0.01}})(0, 3), 0);
    EXPECT_THAT(output_, AllOf(HasSubstr("turned"), HasSubstr("120 x 160 px")));
  }
}

TEST_F(RectifyPair, EveryPixelHasASourceWithBalanceZero) {
  WritePair({Turn(0.03, -0.1, 0.05), {-0.2, 0.01, 0.02}});
  Done({"rectify", "pair.yaml", "-o", "out", "--balance", "0", "--mask", "--maps"});
  for (const char* name : {"one", "two"}) {
    EXPECT_EQ(cv::countNonZero(Load(std::string("out/") + name + "/mask.png")), 160 * 120);
    EXPECT_EQ(Load(std::string("out/") + name + "/map_x.tiff").type(), CV_32F);
  }
}

TEST_F(RectifyPair, ImagesArePairedByFrame) {
  WritePair({Turn(0.03, -0.1, 0.05), {-0.2, 0.01, 0.02}});
  for (const char* name : {"l1.png", "l2.png", "r1.png", "r3.png"}) SaveColours(name);
  EXPECT_THAT(Done({"rectify", "pair.yaml", "l*.png", "r*.png", "-o", "out"}),
              AllOf(HasSubstr("l2.png"), HasSubstr("r3.png"), HasSubstr("1 and 1 images")));
  EXPECT_EQ(Load("out/one/1.png").type(), CV_16UC3);
  EXPECT_EQ(Load("out/two/1.png").size(), cv::Size(160, 120));
  EXPECT_FALSE(fs::exists(Path("out/one/2.png")));
  Write("target.yaml", "plenocal: 1\ntype: chessboard\ncolumns: 3\nrows: 4\nsquare: 0.1\n");
  Write("session.yaml",
        "plenocal: 1\ntarget: target.yaml\ncameras:\n  one: {model: pinhole-radial3, images: "
        "l*.png}\n  two: {model: pinhole-radial3, images: r*.png}\n");
  EXPECT_THAT(Done({"rectify", "pair.yaml", "--session", "session.yaml", "-o", "session"}),
              HasSubstr("1 and 1 images"));
  // One file each is a pair whatever their names are.
  EXPECT_THAT(Done({"rectify", "pair.yaml", "l1.png", "r3.png", "-o", "single"}),
              HasSubstr("1 and 1 images"));
  fs::remove_all(Path("out"));
  ExpectRefused(kWrongInput, {"rectify", "pair.yaml", "l*.png", "-o", "out"}, {"LEFT RIGHT"});
  ExpectRefused(
      kWrongInput, {"rectify", "calibration.yaml", "-o", "out"}, {"3 cameras", "--cameras"});
  ExpectRefused(kJobFailed,
                {"rectify", "calibration.yaml", "--cameras", "barrel", "plenoptic", "-o", "out"},
                {"one place"});
  ExpectRefused(kWrongInput,
                {"rectify", "calibration.yaml", "--cameras", "fisheye", "plenoptic", "-o", "out"},
                {"focused-plenoptic"});
  WritePair({Turn(0, 0, 0), {0, 0, -0.2}});
  ExpectRefused(kJobFailed, {"rectify", "pair.yaml", "-o", "out"}, {"along their baseline"});
  fs::remove(Path("detections_two.csv"));
  WritePair({Turn(0, 0, 0), {-0.2, 0, 0}});
  fs::remove(Path("detections_two.csv"));
  EXPECT_THAT(Done({"rectify", "pair.yaml", "-o", "out"}), HasSubstr("--detections"));
}

TEST_F(RectifyPair, FoldersArePairs) {
  WritePair({Turn(0.03, -0.1, 0.05), {-0.2, 0.01, 0.02}});
  for (const char* name : {"l/left01.png", "l/left02.png", "r/right01.png", "r/right03.png"}) {
    fs::create_directories(Path(name).parent_path());
    SaveColours(name);
  }
  EXPECT_THAT(
      Done({"rectify", "pair.yaml", "l", "r", "-o", "folders"}),
      AllOf(HasSubstr("1 and 1 images"), HasSubstr("left02.png"), HasSubstr("right03.png")));
  EXPECT_TRUE(fs::exists(Path("folders/one/01.png")));
  EXPECT_TRUE(fs::exists(Path("folders/two/01.png")));
  // One folder of both cameras, with their names as subfolders or in the files' names.
  for (const char* name : {"set/one/a.png", "set/two/a.png", "flat/one_a.png", "flat/a_two.png"}) {
    fs::create_directories(Path(name).parent_path());
    SaveColours(name);
  }
  for (const char* folder : {"set", "flat"}) {
    EXPECT_THAT(Done({"rectify", "pair.yaml", folder, "-o", "single"}),
                HasSubstr("1 and 1 images"));
    fs::remove_all(Path("single"));
  }
  ExpectRefused(
      kWrongInput, {"rectify", "pair.yaml", "l", "-o", "out"}, {"neither a folder 'one'", "LEFT"});
  // Two images of one frame, of which a pair could have only one.
  fs::create_directories(Path("twice"));
  for (const char* name : {"one_a.png", "_aone.png", "two_a.png"}) {
    SaveColours(std::string("twice/") + name);
  }
  ExpectRefused(kWrongInput,
                {"rectify", "pair.yaml", "twice", "-o", "out"},
                {"one_a.png", "_aone.png", "named '_a.png'"});
}

TEST_F(RectifyPair, OneFileIsNoPair) {
  WritePair({Turn(0.03, -0.1, 0.05), {-0.2, 0.01, 0.02}});
  SaveColours("a1.png");
  SaveColours("a2.png");
  fs::create_directory(Path("folder"));
  fs::create_symlink("../a1.png", Path("folder/b1.png"));
  for (const std::vector<std::string>& pair : {std::vector<std::string>{"a1.png", "a1.png"},
                                               {"a1.png", "./folder/../a1.png"},
                                               {"a1.png", "folder/b1.png"},
                                               {"a*.png", "a*.png"},
                                               {".", "."}}) {
    ExpectRefused(kWrongInput,
                  {"rectify", "pair.yaml", pair[0], pair[1], "-o", "out"},
                  {"a1.png", "one file"});
  }
}

TEST_F(RectifyPair, PreviewShowsBothImagesWithLines) {
  WritePair({Turn(0.03, -0.1, 0.05), {-0.2, 0.01, 0.02}});
  SaveColours("l1.png");
  SaveColours("r1.png");
  Done({"rectify", "pair.yaml", "l*.png", "r*.png", "-o", "out", "--preview"});
  const cv::Mat preview = Load("out/preview/1.png");
  ASSERT_EQ(preview.type(), CV_8UC3);
  ASSERT_EQ(preview.size(), cv::Size(320, 120));
  cv::Mat left = Load("out/one/1.png");
  left.convertTo(left, CV_8U, 1.0 / 257);
  int equal = 0, lines = 0;
  for (int y = 0; y < preview.rows; ++y) {
    const bool same = cv::norm(preview.row(y).colRange(0, 160), left.row(y), cv::NORM_INF) == 0;
    const cv::Mat one_colour = cv::repeat(preview.row(y).col(0), 1, preview.cols);
    const bool line = cv::norm(preview.row(y), one_colour, cv::NORM_INF) == 0;
    equal += same ? 1 : 0;
    lines += line ? 1 : 0;
  }
  EXPECT_EQ(equal, 100);
  EXPECT_GE(lines, 20);
  fs::remove_all(Path("out"));
  ExpectRefused(kWrongInput, {"rectify", "pair.yaml", "-o", "out", "--preview"}, {"--preview"});
  Write("pair.yaml", Replaced(Read("pair.yaml"), "  one:", "  preview:"));
  ExpectRefused(kWrongInput,
                {"rectify", "pair.yaml", "l*.png", "r*.png", "-o", "out", "--preview"},
                {"--preview", "'preview'"});
}

// Corners of pairs of images, as OpenCV's calibration takes them.
struct CornerPairs {
  cv::Size board, size;
  std::vector<std::vector<cv::Point3f>> objects = {};
  std::array<std::vector<std::vector<cv::Point2f>>, 2> corners = {};

  void Add(const std::array<std::vector<cv::Point2f>, 2>& pair) {
    for (std::size_t c = 0; c < 2; ++c) corners[c].push_back(pair[c]);
    objects.emplace_back();
    for (int row = 0; row < board.height; ++row) {
      for (int column = 0; column < board.width; ++column) {
        objects.back().emplace_back(static_cast<float>(column), static_cast<float>(row), 0.0F);
      }
    }
  }
};

// As OpenCV finds them.
CornerPairs FindCorners(const fs::path& set, const std::string& prefix, cv::Size board) {
  CornerPairs pairs{.board = board, .size = {}};
  for (const auto& entry : fs::directory_iterator(set)) {
    const std::string name = entry.path().filename().string();
    if (!name.starts_with(prefix) || entry.path().extension() == ".yml") continue;
    std::array<std::vector<cv::Point2f>, 2> found;
    bool both = true;
    for (std::size_t c = 0; c < 2 && both; ++c) {
      const fs::path path = c == 0 ? entry.path() : set / ("right" + name.substr(4));
      const cv::Mat image = cv::imread(path.string(), cv::IMREAD_GRAYSCALE);
      pairs.size = image.size();
      both = cv::findChessboardCorners(image, board, found[c]);
      if (!both) break;
      cv::cornerSubPix(image, found[c], {5, 5}, {-1, -1}, cv::TermCriteria(3, 100, 1e-6));
      // Both orders fit a board of an odd number of squares.
      if (found[c].front().y > found[c].back().y) std::reverse(found[c].begin(), found[c].end());
    }
    if (both) pairs.Add(found);
  }
  return pairs;
}

// Mean |dy| of OpenCV's calibration of all parameters of the pair, at a focal length of `f`.
double OpenCvEpipolarError(const CornerPairs& pairs, int flags, double f) {
  const cv::TermCriteria to_the_end(3, 100, 1e-9);
  std::array<cv::Mat, 2> K, D, R, P;
  std::vector<cv::Mat> rotations, translations;
  for (std::size_t c = 0; c < 2; ++c) {
    cv::calibrateCamera(pairs.objects,
                        pairs.corners[c],
                        pairs.size,
                        K[c],
                        D[c],
                        rotations,
                        translations,
                        flags,
                        to_the_end);
  }
  cv::Mat R_2_1, T, E, F, Q;
  cv::stereoCalibrate(pairs.objects,
                      pairs.corners[0],
                      pairs.corners[1],
                      K[0],
                      D[0],
                      K[1],
                      D[1],
                      pairs.size,
                      R_2_1,
                      T,
                      E,
                      F,
                      flags | cv::CALIB_USE_INTRINSIC_GUESS,
                      to_the_end);
  cv::stereoRectify(K[0], D[0], K[1], D[1], pairs.size, R_2_1, T, R[0], R[1], P[0], P[1], Q);
  double sum = 0;
  std::size_t count = 0;
  for (std::size_t k = 0; k < pairs.objects.size(); ++k) {
    std::array<std::vector<cv::Point2f>, 2> rectified;
    for (std::size_t c = 0; c < 2; ++c) {
      cv::undistortPoints(pairs.corners[c][k],
                          rectified[c],
                          K[c],
                          D[c],
                          R[c],
                          P[c],
                          cv::TermCriteria(cv::TermCriteria::COUNT, 100, 0));
    }
    for (std::size_t i = 0; i < rectified[0].size(); ++i, ++count) {
      sum += std::abs(rectified[0][i].y - rectified[1][i].y);
    }
  }
  return sum / static_cast<double>(count) * f / P[0].at<double>(1, 1);
}

struct PairSet {
  std::string name, joint, extension;
  cv::Size board;
  std::string model;
  int flags;  // OpenCV's, for the same model
};

class RealPairs : public Undistort {
 protected:
  // Our mean |dy| over the corners of out/detections_*.csv, and the focal length it is for.
  std::array<double, 2> OurError(const PairSet& set, double tolerance) const {
    std::string target =
        fmt::format("plenocal: 1\ntype: chessboard\ncolumns: {}\nrows: {}\nsquare: 0.1\n",
                    set.board.width,
                    set.board.height);
    if (tolerance > 0) target += fmt::format("tolerance: {}\n", tolerance);
    Write("target.yaml", target);
    std::string session = "plenocal: 1\ntarget: target.yaml\ncameras:\n";
    for (const char* side : {"left", "right"}) {
      session += fmt::format("  {}: {{model: {}, images: \"{}\"}}\n",
                             side,
                             set.model,
                             (Folder(set) / (side + set.joint + "*." + set.extension)).string());
    }
    Write("session.yaml", session);
    Calibrate();
    const std::string output =
        Done({"rectify", "out/calibration.yaml", "-o", "rectified", "--session", "session.yaml"});
    const std::string label = "mean |dy| ";
    const std::size_t at = output.find(label);
    if (at == std::string::npos) throw std::runtime_error(output);
    const YAML::Node left = YAML::Load(Read("rectified/calibration.yaml"))["cameras"]["left"];
    return {std::stod(output.substr(at + label.size())), left["parameters"]["f_x"].as<double>()};
  }

  [[nodiscard]] static fs::path Folder(const PairSet& set) {
    return OptionalData("frames/" + set.name);
  }

  // The corners that Plenocal has found.
  [[nodiscard]] CornerPairs OurCorners(const PairSet& set, cv::Size size) const {
    CornerPairs pairs{.board = set.board, .size = size};
    std::map<std::string, std::array<std::vector<cv::Point2f>, 2>> frames;
    for (std::size_t c = 0; c < 2; ++c) {
      const Table table(Read(c == 0 ? "out/detections_left.csv" : "out/detections_right.csv"));
      const auto frame = table.Column("frame");
      const auto x = table.Numbers("x"), y = table.Numbers("y");
      for (std::size_t i = 0; i < x.size(); ++i) {
        frames[frame[i]][c].emplace_back(static_cast<float>(x[i]), static_cast<float>(y[i]));
      }
    }
    for (const auto& [frame, pair] : frames) {
      const auto all = static_cast<std::size_t>(set.board.area());
      if (pair[0].size() == all && pair[1].size() == all) pairs.Add(pair);
    }
    return pairs;
  }

  void ExpectNotWorseThanOpenCv(const PairSet& set) {
    if (!fs::exists(Folder(set))) GTEST_SKIP() << Absent(Folder(set));
    const auto [flat, f] = OurError(set, 0);
    const CornerPairs found = FindCorners(Folder(set), "left" + set.joint, set.board);
    const double theirs = OpenCvEpipolarError(found, set.flags, f);
    EXPECT_LE(flat, theirs);
    // On our corners OpenCV has the same model of the cameras, but not of the board.
    constexpr double kTolerance = 0.001;  // 1 % of a square
    const auto [bent, f_bent] = OurError(set, kTolerance);
    const double on_our_corners =
        OpenCvEpipolarError(OurCorners(set, found.size), set.flags, f_bent);
    EXPECT_LE(bent, on_our_corners);
    RecordProperty("figures",
                   fmt::format("{:.4f} (opencv {:.4f}), with tolerance {:.4f} (opencv, same "
                               "corners: {:.4f})",
                               flat,
                               theirs,
                               bent,
                               on_our_corners));
  }
};

TEST_F(RealPairs, EpipolarErrorOfOpenCvsChessboards) {
  ExpectNotWorseThanOpenCv({"stereo_chess_opencv", "", "jpg", {9, 6}, "pinhole-radtan", 0});
}

TEST_F(RealPairs, EpipolarErrorOfAWideAnamorphicPair) {
  ExpectNotWorseThanOpenCv({"stereo_chess_anamorphic_drobotics",
                            "_",
                            "png",
                            {11, 8},
                            "pinhole-radtan8",
                            cv::CALIB_RATIONAL_MODEL});
}

}  // namespace TEST_FILE
}  // namespace plenocal::testing
