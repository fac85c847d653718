// SPDX-License-Identifier: Apache-2.0
//
// The same corners of real images, as Plenocal detects them, calibrated by Plenocal and by OpenCV.
#include <fmt/format.h>

#include <Eigen/Core>
#include <algorithm>
#include <opencv2/calib3d.hpp>

#include "calib/camera/rigid_transform.h"
#include "tests/apps/workspace.h"
#include "tests/optional_data.h"

namespace plenocal::testing {
namespace TEST_FILE {

namespace fs = std::filesystem;

constexpr int kColumns = 9, kRows = 6;
// The real one is not known; multiples of this are exact in the single precision of OpenCV.
constexpr double kSquare = 0.03125;
constexpr int kViews = 13;
const cv::Size kSize(640, 480);
// The radial polynomial of pinhole-radial3 is OpenCV's k1, k2, k3.
constexpr int kSameModel = cv::CALIB_ZERO_TANGENT_DIST;
const cv::TermCriteria kToTheEnd(cv::TermCriteria::COUNT + cv::TermCriteria::EPS, 1000, 1e-15);

// What one camera sees, as OpenCV wants it, and OpenCV's intrinsics for it.
struct Views {
  std::vector<std::vector<cv::Point3f>> board;
  std::vector<std::vector<cv::Point2f>> image;
  cv::Mat K = cv::Mat::eye(3, 3, CV_64F), distortion = cv::Mat::zeros(5, 1, CV_64F);
  double rms = 0;

  // Of a table with columns frame, marker, x, y the rows for which `use` is true.
  template <typename Use>
  Views(const Table& table, const Use& use) {
    const auto frames = table.Column("frame"), markers = table.Column("marker");
    const auto x = table.Numbers("x"), y = table.Numbers("y");
    std::string frame;
    for (std::size_t i = 0; i < table.Rows(); ++i) {
      if (!use(i)) continue;
      if (frames[i] != frame) {
        frame = frames[i];
        board.emplace_back();
        image.emplace_back();
      }
      const int marker = std::stoi(markers[i]);
      const int row = marker / kColumns, column = marker % kColumns;
      board.back().emplace_back(
          static_cast<float>(kSquare * column), static_cast<float>(kSquare * row), 0.0F);
      image.back().emplace_back(static_cast<float>(x[i]), static_cast<float>(y[i]));
    }
    std::vector<cv::Mat> rotations, translations;
    rms = cv::calibrateCamera(
        board, image, kSize, K, distortion, rotations, translations, kSameModel, kToTheEnd);
  }
  explicit Views(const Table& table) : Views(table, [](std::size_t) { return true; }) {}
};

const std::vector<std::string> kCameras{"left", "right"};

class OpenCvComparison : public Workspace {
 protected:
  // Files of the corners: <camera>_weighted.csv as detected, <camera>.csv without sigmas.
  void SetUp() override {
    const fs::path set = OptionalData("frames/stereo_chess_opencv");
    if (!fs::exists(set)) {
      GTEST_SKIP() << Absent(set);
    }
    Write("target.yaml",
          fmt::format("plenocal: 1\ntype: chessboard\ncolumns: {}\nrows: {}\nsquare: {}\n",
                      kColumns,
                      kRows,
                      kSquare));
    std::string text = "plenocal: 1\ntarget: target.yaml\ncameras:\n";
    for (const std::string& name : kCameras) {
      text += fmt::format("  {}: {{model: pinhole-radial3, images: \"{}\"}}\n",
                          name,
                          (set / (name + "*.jpg")).string());
    }
    Write("session.yaml", text);
    const Outcome outcome = Run({"detect", "session.yaml", "-o", "detected"});
    ASSERT_EQ(outcome.status, kDone) << outcome.err;
    for (const std::string& name : kCameras) {
      const Table table(Read("detected/detections_" + name + ".csv"));
      ASSERT_EQ(table.Rows(), kViews * kColumns * kRows);
      const auto frames = table.Column("frame"), markers = table.Column("marker"),
                 sigmas = table.Column("sigma");
      const auto x = table.Numbers("x"), y = table.Numbers("y");
      std::string plain = "frame,marker,x,y\n", weighted = "frame,marker,x,y,sigma\n";
      for (std::size_t i = 0; i < table.Rows(); ++i) {
        // OpenCV takes single precision.
        const std::string row = fmt::format("{},{},{:.17g},{:.17g}",
                                            frames[i],
                                            markers[i],
                                            static_cast<float>(x[i]),
                                            static_cast<float>(y[i]));
        plain += row + "\n";
        weighted += row + "," + sigmas[i] + "\n";
      }
      Write(name + ".csv", plain);
      Write(name + "_weighted.csv", weighted);
    }
  }

  // Calibrates `cameras` from their <camera><suffix>.csv.
  YAML::Node Solve(const std::vector<std::string>& cameras,
                   const std::string& suffix,
                   const std::string& options) const {
    std::string text = "plenocal: 1\ntarget: target.yaml\ncameras:\n";
    for (const std::string& name : cameras) {
      text += fmt::format(
          "  {}: {{model: pinhole-radial3, detections: {}{}.csv, image_size: [640, 480]}}\n",
          name,
          name,
          suffix);
    }
    Write("session.yaml", text + "options: {" + options + "}\n");
    Calibrate();
    return Result();
  }

  static double Rms(const YAML::Node& result, const std::string& camera) {
    return result["cameras"][camera]["residuals"]["rms"].as<double>();
  }
};

TEST_F(OpenCvComparison, EachCameraIsExplainedAsWell) {
  for (const std::string& name : kCameras) {
    const Table detections(Read(name + ".csv"));
    const double same = Rms(Solve({name}, "", "refine_target: false, loss: none"), name);
    const Table residuals(Read("out/residuals.csv"));
    ASSERT_EQ(residuals.Column("frame"), detections.Column("frame"));
    ASSERT_EQ(residuals.Column("marker"), detections.Column("marker"));
    const std::vector<std::string> used = residuals.Column("used");
    EXPECT_GE(std::count(used.begin(), used.end(), "1"), kViews * kColumns * kRows - 2);
    const Views used_views(detections, [&](std::size_t i) { return used[i] == "1"; });
    // Both stop where the sum of squares changes by less.
    constexpr double kSolvers = 1e-8;
    EXPECT_NEAR(same, used_views.rms, kSolvers * used_views.rms) << name;

    const Views all(detections);
    // OpenCV minimises this very number, and we one in which precise corners count more and gross
    // errors less.
    constexpr double kWeights = 2e-3;
    EXPECT_LT(Rms(Solve({name}, "_weighted", "refine_target: false"), name),
              (1 + kWeights) * all.rms)
        << name;
    EXPECT_LT(Rms(Solve({name}, "_weighted", "refine_target: true"), name), all.rms) << name;
  }
}

TEST_F(OpenCvComparison, TheRigAgreesWithinItsSigmas) {
  Views left(Table(Read("left.csv"))), right(Table(Read("right.csv")));
  cv::Mat R, t, E, F;
  cv::stereoCalibrate(left.board,
                      left.image,
                      right.image,
                      left.K,
                      left.distortion,
                      right.K,
                      right.distortion,
                      kSize,
                      R,
                      t,
                      E,
                      F,
                      kSameModel | cv::CALIB_USE_INTRINSIC_GUESS,
                      kToTheEnd);
  RigidTransform theirs;
  theirs.R = Eigen::Map<const Eigen::Matrix<double, 3, 3, Eigen::RowMajor>>(R.ptr<double>());
  theirs.t = Eigen::Map<const Eigen::Vector3d>(t.ptr<double>());
  const Vector6d xi = Log(theirs);
  struct Case {
    std::string suffix;
    double sigmas;
  };
  // With the same weights the two differ by what the robust loss and the rejected corners do.
  for (const auto& [suffix, sigmas] : {Case{"", 1}, Case{"_weighted", 3}}) {
    const YAML::Node camera = Solve(kCameras, suffix, "refine_target: false")["cameras"]["right"];
    for (int i = 0; i < 6; ++i) {
      EXPECT_NEAR(camera["xi_camera_rig"][i].as<double>(),
                  xi[i],
                  sigmas * camera["sigma_xi"][i].as<double>())
          << "xi " << i << suffix;
    }
  }
}

}  // namespace TEST_FILE
}  // namespace plenocal::testing
