// SPDX-License-Identifier: Apache-2.0
//
// `plenocal focus`: files in, files, summary and messages out.
#include <fmt/format.h>

#include <cmath>
#include <cstdint>
#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>
#include <string>
#include <tuple>

#include "tests/apps/workspace.h"
#include "tests/detectors/plenoptic/plenoptic_scene.h"

namespace plenocal::testing {
namespace TEST_FILE {

using ::testing::AllOf;
using ::testing::HasSubstr;
namespace fs = std::filesystem;

class FocusCommandLine : public Workspace {
 protected:
  FocusCommandLine() : array_(scene_.Array()), attenuation_(scene_.Attenuation(array_)) {
    Write("micro_lenses.csv", FormatMicroLenses(array_));
    WriteImage("vignetting.tiff", attenuation_);
    WriteImage("raw/a.png", scene_.Raw(array_));
  }

  void WriteImage(const std::string& name, const cv::Mat& image) const {
    fs::create_directories(Path(name).parent_path());
    cv::imwrite(Path(name).string(), image);
  }

  /// An image of the size of the others in which nothing fits the grid.
  [[nodiscard]] cv::Mat Even(double value) const {
    return {scene_.height, scene_.width, CV_8U, cv::Scalar(value)};
  }

  [[nodiscard]] Outcome WithGrid(const char* command,
                                 const char* images,
                                 const std::vector<std::string>& more = {}) const {
    std::vector<std::string> arguments{command,
                                       images,
                                       "--grid",
                                       "micro_lenses.csv",
                                       "--vignetting",
                                       "vignetting.tiff",
                                       "-o",
                                       "out"};
    arguments.insert(arguments.end(), more.begin(), more.end());
    return Run(arguments);
  }
  [[nodiscard]] Outcome Focus(const std::vector<std::string>& more = {}) const {
    return WithGrid("focus", "raw", more);
  }

  /// The outcome must have this status, one line with all of `parts`, and leave nothing.
  void ExpectRefused(const Outcome& outcome,
                     int status,
                     const std::vector<std::string>& parts) const {
    EXPECT_EQ(outcome.status, status) << outcome.err;
    EXPECT_EQ(Lines(outcome.err).size(), 1u) << outcome.err;
    for (const std::string& part : parts) EXPECT_THAT(outcome.err, HasSubstr(part));
    EXPECT_TRUE(Files("out").empty());
  }

  /// 65535 (1 - 1 / v), 0 where unknown.
  static void ExpectRxLive(const cv::Mat& values, const cv::Mat& depth) {
    ASSERT_EQ(values.type(), CV_16U);
    ASSERT_EQ(values.size(), depth.size());
    int known = 0;
    for (int y = 0; y < depth.rows; ++y) {
      for (int x = 0; x < depth.cols; ++x) {
        const double value = values.at<std::uint16_t>(y, x), v = depth.at<float>(y, x);
        if (std::isnan(v)) {
          EXPECT_EQ(value, 0);
        } else {
          EXPECT_NEAR(value, 65535 * (1 - 1 / v), 1);
          ++known;
        }
      }
    }
    EXPECT_GT(known, 0);
  }

  /// All result files of one frame, readable and of `size`.
  void ExpectResults(const std::string& folder, cv::Size size, int type = CV_16U) const {
    const auto read = [&](const std::string& name) {
      return cv::imread(Path(folder + "/" + name).string(), cv::IMREAD_UNCHANGED);
    };
    const cv::Mat image = read("focused.png");
    EXPECT_EQ(image.size(), size);
    EXPECT_EQ(image.type(), type) << "as the raw image";
    for (const char* name : {"virtual_depth.tiff", "virtual_depth_sigma.tiff"}) {
      const cv::Mat map = read(name);
      EXPECT_EQ(map.size(), size) << name;
      EXPECT_EQ(map.type(), CV_32F) << name;
    }
    EXPECT_FALSE(read("virtual_depth.png").empty());
    ExpectRxLive(read("virtual_depth_16bit.png"), read("virtual_depth.tiff"));
  }

  PlenopticScene scene_;
  MicroLensArray array_;
  cv::Mat attenuation_;
};

TEST_F(FocusCommandLine, WritesImageDepthAndTheirGeometry) {
  const Outcome outcome = Focus();
  ASSERT_EQ(outcome.status, kDone) << outcome.err;
  EXPECT_THAT(outcome.err, AllOf(HasSubstr("a: 200 x 200 pixels"), HasSubstr("Galilean")));
  EXPECT_EQ(Files("out").size(), 6u);
  ExpectResults("out", {200, 200});
  const YAML::Node geometry = YAML::Load(Read("out/focused.yaml"));
  EXPECT_EQ(geometry["plenocal"].as<int>(), 1);
  EXPECT_EQ(geometry["scale"].as<double>(), 2);
  EXPECT_EQ(geometry["offset"].as<std::vector<double>>(), (std::vector<double>{0, 0}));
}

TEST_F(FocusCommandLine, MakesPixelsOfTheSizeAskedFor) {
  const Outcome outcome = Focus({"--scale", "4"});
  ASSERT_EQ(outcome.status, kDone) << outcome.err;
  ExpectResults("out", {100, 100});
  EXPECT_EQ(YAML::Load(Read("out/focused.yaml"))["scale"].as<double>(), 4);
}

TEST_F(FocusCommandLine, MeasuresTheCameraOnWhiteImages) {
  cv::Mat white;
  attenuation_.convertTo(white, CV_8U, 220);
  for (int i = 0; i < 3; ++i) WriteImage(fmt::format("white/{}.png", i), white);
  const Outcome outcome = Run({"focus", "raw", "--white", "white", "-o", "out"});
  ASSERT_EQ(outcome.status, kDone) << outcome.err;
  ExpectResults("out", {200, 200});
}

TEST_F(FocusCommandLine, GivesEachOfManyImagesAFolder) {
  WriteImage("raw/b.png", scene_.Raw(array_));
  const Outcome outcome = Focus();
  ASSERT_EQ(outcome.status, kDone) << outcome.err;
  EXPECT_EQ(Files("out").size(), 12u);
  ExpectResults("out/a", {200, 200});
  ExpectResults("out/b", {200, 200});
}

TEST_F(FocusCommandLine, LeavesOutABadImageOfMany) {
  WriteImage("raw/b.png", Even(0));
  const Outcome outcome = Focus();
  ASSERT_EQ(outcome.status, kDone) << outcome.err;
  EXPECT_THAT(outcome.err, HasSubstr("left out raw/b.png: is black"));
  EXPECT_EQ(Files("out").size(), 6u);
  ExpectResults("out/a", {200, 200});
}

TEST_F(FocusCommandLine, KeepsTheColoursOfARawImage) {
  scene_.colour = true;
  WriteImage("raw/a.png", scene_.Raw(array_));
  const Outcome outcome = Focus();
  ASSERT_EQ(outcome.status, kDone) << outcome.err;
  ExpectResults("out", {200, 200}, CV_16UC3);
}

TEST_F(FocusCommandLine, TakesTheColoursOfAMosaicAsAnnounced) {
  scene_.bayer = BayerOrder::kRggb;
  WriteImage("raw/a.png", scene_.Raw(array_));
  for (const auto& [order, red, blue] :
       {std::tuple{"RGGB", 0.5, 0.7}, std::tuple{"BGGR", 0.7, 0.5}}) {
    const Outcome outcome = Focus({"--bayer", order});
    ASSERT_EQ(outcome.status, kDone) << outcome.err;
    ExpectResults("out", {200, 200}, CV_16UC3);
    const cv::Scalar mean =
        cv::mean(cv::imread(Path("out/focused.png").string(), cv::IMREAD_UNCHANGED));
    EXPECT_NEAR(mean[0] / mean[1], blue, 0.01) << order;
    EXPECT_NEAR(mean[2] / mean[1], red, 0.01) << order;
  }
}

TEST_F(FocusCommandLine, RefusesAMosaicThatHasColoursAlready) {
  scene_.colour = true;
  WriteImage("raw/a.png", scene_.Raw(array_));
  ExpectRefused(Focus({"--bayer", "RGGB"}), kWrongInput, {"raw/a.png", "leave --bayer out"});
}

TEST_F(FocusCommandLine, SaysThatTheCameraIsMissing) {
  ExpectRefused(Run({"focus", "raw", "-o", "out"}),
                kWrongInput,
                {"centres are missing", "--white", "--grid"});
}

TEST_F(FocusCommandLine, SaysThatThereAreNoWhiteImages) {
  fs::create_directories(Path("white"));
  ExpectRefused(Run({"focus", "raw", "--white", "white", "-o", "out"}),
                kWrongInput,
                {"white images", "no image", "folder white"});
}

TEST_F(FocusCommandLine, NamesARawImageOfAnotherSize) {
  WriteImage("raw/a.png", cv::Mat(300, 400, CV_8U, cv::Scalar(100)));
  ExpectRefused(Focus(), kWrongInput, {"raw/a.png", "400 x 300", "400 x 400"});
}

TEST_F(FocusCommandLine, NamesABlackImage) {
  WriteImage("raw/a.png", Even(0));
  ExpectRefused(Focus(), kJobFailed, {"raw/a.png", "is black", "lens cap"});
}

TEST_F(FocusCommandLine, NamesARawImageThatDoesNotBelongToTheGrid) {
  PlenopticScene other = scene_;
  other.pitch = 15;
  const MicroLensArray array = other.Array();
  WriteImage("raw/a.png", other.Raw(array));
  ExpectRefused(Focus(), kJobFailed, {"raw/a.png", "does not show micro images where the grid"});
}

TEST_F(FocusCommandLine, SaysThatAGridAloneIsNotChecked) {
  for (const char* command : {"focus", "views"}) {
    const Outcome outcome = Run({command, "raw/a.png", "--grid", "micro_lenses.csv", "-o", "out"});
    EXPECT_EQ(outcome.status, kDone) << outcome.err;
    EXPECT_THAT(outcome.out + outcome.err, HasSubstr("the grid is used unchecked"));
  }
}

TEST_F(FocusCommandLine, NamesWhiteImagesOfAnotherFocus) {
  PlenopticScene wider = scene_;
  wider.pitch *= 1.001;
  WriteImage("raw/a.png", wider.Raw(wider.Array()));
  for (const char* command : {"focus", "views"}) {
    const Outcome outcome = WithGrid(command, "raw/a.png");
    EXPECT_EQ(outcome.status, 0) << outcome.err;
    EXPECT_THAT(
        outcome.out + outcome.err,
        AllOf(HasSubstr("the micro images lie up to 0.3"), HasSubstr("of another focus or zoom")));
  }
}

TEST_F(FocusCommandLine, NamesAnImageWithoutDetail) {
  cv::Mat flat;
  attenuation_.convertTo(flat, CV_16U, 20000);
  WriteImage("raw/a.png", flat);
  ExpectRefused(Focus(), kJobFailed, {"raw/a.png", "no detail"});
}

TEST_F(FocusCommandLine, DoesNotReplaceARawImage) {
  WriteImage("out/focused.png", scene_.Raw(array_));
  const Outcome outcome = WithGrid("focus", "out/focused.png");
  EXPECT_EQ(outcome.status, kWrongInput);
  EXPECT_THAT(outcome.err, HasSubstr("the results would replace this input"));
}

using ViewsCommandLine = FocusCommandLine;

TEST_F(ViewsCommandLine, WritesViewsAndRefocusedImages) {
  const Outcome outcome = Run({"views",
                               "raw/a.png",
                               "--grid",
                               "micro_lenses.csv",
                               "--vignetting",
                               "vignetting.tiff",
                               "--views",
                               "3",
                               "-o",
                               "out"});
  ASSERT_EQ(outcome.status, kDone) << outcome.err;
  const YAML::Node geometry = YAML::Load(Read("out/views.yaml"));
  ASSERT_EQ(geometry["views"].size(), 9u);
  ASSERT_EQ(geometry["refocused"].size(), 3u);
  size_t read = 0;
  for (const char* list : {"views", "refocused"}) {
    for (const YAML::Node& item : geometry[list]) {
      const cv::Mat image =
          cv::imread(Path("out/" + item["file"].as<std::string>()).string(), cv::IMREAD_UNCHANGED);
      EXPECT_EQ(image.size(), cv::Size(200, 200));
      EXPECT_GT(cv::countNonZero(image), image.total() / 2);
      ++read;
    }
  }
  EXPECT_EQ(read, 12u);
  EXPECT_EQ(Files("out").size(), 9u + 3 + 2);
  // The sheet has the views in rows.
  const cv::Mat sheet = cv::imread(Path("out/views.png").string(), cv::IMREAD_UNCHANGED);
  ASSERT_EQ(sheet.size(), cv::Size(600, 600));
  for (int row = 0; row < 3; ++row) {
    for (int column = 0; column < 3; ++column) {
      const std::string name = fmt::format("out/view_{}_{}.png", row, column);
      const cv::Mat view = cv::imread(Path(name).string(), cv::IMREAD_UNCHANGED);
      const cv::Mat part = sheet(cv::Rect(200 * column, 200 * row, 200, 200));
      EXPECT_EQ(cv::norm(view, part, cv::NORM_INF), 0) << name;
    }
  }
}

TEST_F(ViewsCommandLine, NeedsACalibrationForDistances) {
  const Outcome outcome =
      Run({"views", "raw/a.png", "--grid", "micro_lenses.csv", "--distance", "0.5", "-o", "out"});
  ExpectRefused(outcome, kWrongInput, {"--distance", "--calibration"});
}

// A point at 0.5 m is imaged at b_L = 1 / (1 / f_L - 1 / 0.5 m) behind the main lens, at v = (b_L -
// b_L0) / B by the micro lenses, whose centres are b_L0 / (b_L0 + B) times as far from the axis as
// their micro images'.
TEST_F(ViewsCommandLine, FocusesAtDistancesOfACalibratedCamera) {
  constexpr double kF = 0.0161, kB0 = 0.0149, kB = 0.00052;
  Write("calibration.yaml",
        fmt::format("plenocal: 1\ncameras:\n  plenoptic:\n    model: focused-plenoptic\n"
                    "    image_size: [400, 400]\n    pixel_size: 5.5e-6\n"
                    "    T_camera_rig: [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]\n"
                    "    parameters:\n"
                    "      {{f_L: {}, b_L0: {}, B: {}, c_x: 199.5, c_y: 199.5, A_0: 0, A_1: 0, "
                    "B_0: 0, B_1: 0}}\n",
                    kF,
                    kB0,
                    kB));
  const Outcome outcome = WithGrid(
      "views",
      "raw/a.png",
      {"--views", "1", "--calibration", "calibration.yaml", "--depth", "4", "--distance", "0.5"});
  ASSERT_EQ(outcome.status, kDone) << outcome.err;
  const YAML::Node planes = YAML::Load(Read("out/views.yaml"))["refocused"];
  ASSERT_EQ(planes.size(), 2u);
  EXPECT_EQ(planes[0]["virtual_depth"].as<double>(), 4);
  EXPECT_EQ(planes[1]["distance"].as<double>(), 0.5);
  const double b_L = 1 / (1 / kF - 1 / 0.5), v = (b_L - kB0) / kB;
  const double by_centres = 1 / (1 - (1 - 1 / v) * kB0 / (kB0 + kB));
  EXPECT_NEAR(planes[1]["virtual_depth"].as<double>(), by_centres, 1e-4);
}

TEST_F(ViewsCommandLine, NeedsMicroImageCentres) {
  ExpectRefused(Run({"views", "raw/a.png", "-o", "out"}), kWrongInput, {"--white", "--grid"});
}

}  // namespace TEST_FILE
}  // namespace plenocal::testing
