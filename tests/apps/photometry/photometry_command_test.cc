// SPDX-License-Identifier: Apache-2.0
//
// `plenocal response`, `vignette`, comparisons of attenuations and their export, on simulated
// recordings.
#include <fmt/format.h>

#include <cmath>
#include <fstream>
#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>

#include "tests/apps/workspace.h"

namespace plenocal::testing {
namespace TEST_FILE {

using ::testing::HasSubstr;
using ::testing::Not;

constexpr const char* kCamera =
    "cameras:\n  left:\n    model: pinhole-radial3\n    image_size: [320, 256]\n    parameters: "
    "{f_x: 205, f_y: 206, c_x: 158, c_y: 129, A_0: -0.21, A_1: 0.07, A_2: -0.012}\n    response: "
    "{gamma: 2.2}\n    vignetting: {polynomial: [-0.25, -0.1], centre: [165, 125], axes: [1, "
    "0.95]}\n    blur: 0.4\n";

class PhotometryCommand : public Workspace {
 protected:
  PhotometryCommand() {
    Write(
        "tag.yaml",
        "plenocal: 1\ntype: apriltag\nfamily: tag36h11\ntags:\n  - {id: 0, corners: [[-0.2, -0.2, "
        "0], [0.2, -0.2, 0], [0.2, 0.2, 0], [-0.2, 0.2, 0]]}\n");
  }
  void Simulate(const std::string& folder, const std::string& rest) const {
    Write("spec.yaml", "plenocal: 1\nseed: 4\ntarget: tag.yaml\n" + rest + kCamera);
    const Outcome outcome = Run({"simulate", "spec.yaml", "-o", folder});
    ASSERT_EQ(outcome.status, kDone) << outcome.err;
  }
  void SimulateSweep() const {
    Simulate("sweep",
             "wall: {contrast: 0.4, light: 0.5, structure: 0.008}\nwhite_images: 1\n"
             "exposures: {range: [0.1, 20], nominal: 5, order: sweep}\n"
             "poses: {kind: still, frames: 40, distance: [1.2, 1.2]}\n");
  }
  void SimulateWall(const std::string& exposures = "{range: [2, 5]}") const {
    Simulate("wall",
             "wall: {contrast: 0.2, light: 0.2, structure: 0.012}\nwhite_images: 6\nexposures: " +
                 exposures +
                 "\nposes: {frames: 30, distance: [1.3, 2], partial: 0, kind: varied, roll: 3.1, "
                 "tilt: 0.4}\n");
  }
  [[nodiscard]] Outcome Vignette() const {
    return Run({"vignette",
                "wall/recording.yaml",
                "--target",
                "tag.yaml",
                "--response",
                "wall/truth/pcalib_left.txt",
                "-o",
                "out"});
  }
  [[nodiscard]] cv::Mat Image(const std::string& name) const {
    return cv::imread(Path(name).string(), cv::IMREAD_UNCHANGED);
  }
  // ln(a / b) less its mean; RMS and ratio to `sigma`.
  struct Difference {
    double rms = 0, chi_square = 0;
  };
  [[nodiscard]] static Difference Compare(const cv::Mat& a,
                                          const cv::Mat& b,
                                          const cv::Mat& sigma) {
    cv::Mat difference;
    cv::log(a / b, difference);
    difference -= cv::mean(difference)[0];
    cv::Mat ratio = difference / sigma;
    return {std::sqrt(cv::mean(difference.mul(difference))[0]), cv::mean(ratio.mul(ratio))[0]};
  }
};

TEST_F(PhotometryCommand, FindsTheResponseOfASweep) {
  SimulateSweep();
  const std::string times = Read("sweep/times_left.txt");
  const size_t line = times.find("000120 ");
  Write("sweep/times_left.txt", times.substr(0, line) + times.substr(times.find('\n', line) + 1));
  const Outcome outcome = Run({"response", "sweep/recording.yaml", "-o", "out"});
  ASSERT_EQ(outcome.status, kDone) << outcome.err;
  EXPECT_THAT(outcome.out, HasSubstr("39 exposures"));
  EXPECT_THAT(outcome.err, Not(HasSubstr("warning")));
  EXPECT_THAT(outcome.err, HasSubstr("000120.png: has no time"));
  EXPECT_THAT(Read("out/response.csv"), HasSubstr("value,U,sigma,count\n"));
  EXPECT_THAT(Read("out/report.html"), HasSubstr("Response of a camera"));
  std::ifstream file(Path("out/pcalib.txt"));
  const std::vector<double> U{std::istream_iterator<double>(file), {}};
  ASSERT_EQ(U.size(), 256U);
  double scale = 0, norm = 0;
  for (size_t k = 5; k <= 245; ++k) {
    scale += U[k] * 255 * std::pow(static_cast<double>(k) / 255, 2.2);
    norm += U[k] * U[k];
  }
  for (size_t k = 5; k <= 245; ++k) {
    const double truth = 255 * std::pow(static_cast<double>(k) / 255, 2.2);
    EXPECT_NEAR(U[k] * scale / norm, truth, 0.005 * 255) << k;
  }
}

TEST_F(PhotometryCommand, NamesSaturatedImages) {
  Simulate("wall",
           "wall: {contrast: 0.2, light: 0.2, structure: 0.012}\n"
           "exposures: {range: [200, 500], nominal: 2}\n"
           "poses: {frames: 10, distance: [1.3, 2], partial: 0, kind: varied}\n");
  const Outcome outcome = Vignette();
  EXPECT_EQ(outcome.status, kJobFailed);
  EXPECT_THAT(outcome.err, HasSubstr("of its pixels are saturated: expose it shorter"));
}

TEST_F(PhotometryCommand, FindsTheVignettingOfAWallAndComparesItWithWhiteImages) {
  SimulateWall();
  const Outcome outcome = Vignette();
  ASSERT_EQ(outcome.status, kDone) << outcome.err;
  EXPECT_THAT(outcome.err, Not(HasSubstr("not flat")));
  EXPECT_THAT(outcome.err, Not(HasSubstr("exposures differ")));
  EXPECT_THAT(outcome.err, Not(HasSubstr("light goes with the camera")));
  EXPECT_THAT(outcome.out, HasSubstr("wall against white images: RMS"));
  const cv::Mat truth = Image("wall/truth/vignetting_left.tiff");
  const cv::Mat found = Image("out/vignetting_left.tiff");
  const Difference difference = Compare(found, truth, Image("out/vignetting_sigma_left.tiff"));
  EXPECT_LT(difference.rms, 0.003);
  // A smooth error has few independent values.
  EXPECT_GT(difference.chi_square, 0.3);
  EXPECT_LT(difference.chi_square, 1.8);
  double largest = 0;
  cv::minMaxLoc(found, nullptr, &largest);
  EXPECT_NEAR(largest, 1, 1e-6);

  const Table table(Read("out/vignetting_compare.csv"));
  for (const double ratio : table.Numbers("ratio")) EXPECT_NEAR(ratio, 1, 0.03);
  EXPECT_THAT(table.Column("section"), ::testing::Contains("radial"));

  // The same by the command for any two, and the formats of DSO as another reader has them.
  const Outcome compared = Run(
      {"compare", "out/vignetting_left.tiff", "wall/truth/vignetting_left.tiff", "-o", "compared"});
  ASSERT_EQ(compared.status, kDone) << compared.err;
  EXPECT_THAT(compared.out, HasSubstr("in the corners"));
  EXPECT_THAT(Read("compared/report.html"), HasSubstr("Two vignettings"));
  const cv::Mat png = Image("out/vignette.png");
  ASSERT_EQ(png.type(), CV_16UC1);
  cv::minMaxLoc(png, nullptr, &largest);
  EXPECT_EQ(largest, 65535);
  cv::Mat again;
  png.convertTo(again, CV_32F, 1 / 65535.0);
  EXPECT_LT(cv::norm(again, found, cv::NORM_INF), 1e-5);
}

TEST_F(PhotometryCommand, ListsExposuresThatDifferFromThoseRecorded) {
  SimulateWall("{range: [2, 5], late: {camera: left, change: 0.1, share: 0.1}}");
  const Outcome outcome = Vignette();
  ASSERT_EQ(outcome.status, kDone) << outcome.err;
  EXPECT_THAT(outcome.err, HasSubstr("exposures differ from those recorded in"));
  const Table found(Read("out/exposures.csv")), truth(Read("wall/truth/exposures.csv"));
  const std::vector<double> exposures = found.Numbers("exposure_ms");
  const std::vector<double> exact = truth.Numbers("exposure_ms");
  ASSERT_EQ(exposures.size(), exact.size());
  // A factor that all share is open.
  double factor = 1;
  for (size_t i = 0; i < exact.size(); ++i) {
    factor *= std::pow(exposures[i] / exact[i], 1 / static_cast<double>(exact.size()));
  }
  for (size_t i = 0; i < exact.size(); ++i) {
    // The tilt of the small tag is mirrored in some views, which are left out.
    if (outcome.err.find(found.Column("frame")[i] + " shows another part") != std::string::npos) {
      continue;
    }
    EXPECT_NEAR(exposures[i] / exact[i] / factor, 1, 0.005) << found.Column("frame")[i];
  }
}

TEST_F(PhotometryCommand, RefusesRecordingsThatLackWhatItNeeds) {
  Simulate(
      "wall",
      "wall: {}\nwhite_images: 1\nexposures: {range: [1, 1], known: false}\nposes: {frames: 12, "
      "distance: [1.3, 2], partial: 0}\n");
  const Outcome no_exposures = Run({"response", "wall/recording.yaml", "-o", "out"});
  EXPECT_EQ(no_exposures.status, kWrongInput);
  EXPECT_THAT(no_exposures.err, HasSubstr("12 of 12 images have no exposure time; write lines"));
  // Another tag than the one on the wall.
  Write("other.yaml",
        "plenocal: 1\ntype: apriltag\nfamily: tag36h11\ntags:\n  - {id: 9, corners: [[-0.2, -0.2, "
        "0], [0.2, -0.2, 0], [0.2, 0.2, 0], [-0.2, 0.2, 0]]}\n");
  const Outcome no_marker =
      Run({"vignette", "wall/recording.yaml", "--target", "other.yaml", "-o", "out"});
  EXPECT_EQ(no_marker.status, kJobFailed);
  EXPECT_THAT(no_marker.err, HasSubstr("the marker was found in 0 of 12 images"));
  Write("bent.yaml",
        "plenocal: 1\ntype: apriltag\nfamily: tag36h11\ntags:\n  - {id: 0, corners: [[-0.2, -0.2, "
        "0], [0.2, -0.2, 0], [0.2, 0.2, 0.1], [-0.2, 0.2, 0.1]]}\n");
  const Outcome bent =
      Run({"vignette", "wall/recording.yaml", "--target", "bent.yaml", "-o", "out"});
  EXPECT_EQ(bent.status, kWrongInput);
  EXPECT_THAT(bent.err, HasSubstr("off its plane z = 0"));
  EXPECT_TRUE(Files("out").empty());
}

TEST_F(PhotometryCommand, WritesImagesThatAreProportionalToTheLight) {
  SimulateSweep();
  const Outcome outcome = Run({"undistort",
                               "sweep/truth/calibration.yaml",
                               "sweep/left/000160.png",
                               "sweep/left/000190.png",
                               "--photometric",
                               "sweep/truth/pcalib_left.txt",
                               "-o",
                               "out"});
  ASSERT_EQ(outcome.status, kDone) << outcome.err;
  const cv::Mat a = Image("out/000160.png"), b = Image("out/000190.png");
  ASSERT_EQ(a.type(), CV_16UC1);
  // Exposures rise by equal factors over 40 images.
  const double factor = std::pow(20 / 0.1, 6.0 / 39);
  EXPECT_NEAR(cv::mean(b)[0] / cv::mean(a)[0], factor, 0.01 * factor);
  const Outcome exported = Run({"export",
                                "sweep/truth/calibration.yaml",
                                "--format",
                                "kalibr",
                                "--response",
                                "sweep/truth/pcalib_left.txt",
                                "-o",
                                "camchain.yaml"});
  EXPECT_EQ(exported.status, kWrongInput);
  EXPECT_THAT(exported.err, HasSubstr("has no place for a response"));
}

TEST_F(PhotometryCommand, FindsFramesWhoseSecondCameraIsLate) {
  const std::string left = kCamera;
  std::string right = left.substr(left.find("  left:"));
  right.replace(right.find("left"), 4, "right");
  Write("spec.yaml",
        "plenocal: 1\nseed: 6\ntarget: tag.yaml\nwall: {contrast: 0.4, light: 0.2, structure: "
        "0.01}\nexposures: {range: [2, 5], late: {camera: right, share: 0.2, change: 0.1}}\n"
        "poses: {frames: 15, distance: [1.3, 1.8], partial: 0}\n" +
            left + right + "    xi_camera_rig: [-0.1, 0, 0, 0, 0, 0]\n");
  ASSERT_EQ(Run({"simulate", "spec.yaml", "-o", "pair"}).status, kDone);
  // Without the photometric calibration the grey values' ratio depends on the brightness.
  Write("pair/recording.yaml",
        Read("pair/recording.yaml") +
            "response: {left: truth/pcalib_left.txt, right: truth/pcalib_right.txt}\n"
            "vignetting: {left: truth/vignetting_left.tiff, right: truth/vignetting_right.tiff}\n");
  const Outcome outcome = Run({"recording", "pair/recording.yaml", "--exposures", "-o", "out"});
  ASSERT_EQ(outcome.status, kDone) << outcome.err;
  const Table found(Read("out/exposures.csv")), truth(Read("pair/truth/exposures.csv"));
  ASSERT_EQ(found.Column("camera"), truth.Column("camera"));
  ASSERT_EQ(found.Column("frame"), truth.Column("frame"));
  int late = 0;
  for (size_t i = 0; i < found.Rows(); ++i) {
    EXPECT_NEAR(found.Numbers("exposure_ms")[i] / truth.Numbers("exposure_ms")[i], 1, 0.01) << i;
    if (std::abs(found.Numbers("relative")[i]) > 0.05) ++late;
  }
  EXPECT_GT(late, 0);
  EXPECT_THAT(outcome.out, HasSubstr(fmt::format("exposures differ in {} of 15 images", late)));
  // They are read back.
  Write("pair/recording.yaml", Read("pair/recording.yaml") + "exposures: ../out/exposures.csv\n");
  const Outcome again = Run({"recording", "pair/recording.yaml", "--exposures", "-o", "again"});
  EXPECT_THAT(again.out, HasSubstr("exposures differ in 0 of 15 images")) << again.err;
}

TEST_F(PhotometryCommand, OneCameraHasNoOtherToCompareWith) {
  SimulateSweep();
  const Outcome outcome = Run({"recording", "sweep/recording.yaml", "--exposures", "-o", "out"});
  EXPECT_EQ(outcome.status, 2);
  EXPECT_THAT(outcome.err, HasSubstr("has one camera"));
}

}  // namespace TEST_FILE
}  // namespace plenocal::testing
