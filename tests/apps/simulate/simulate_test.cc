// SPDX-License-Identifier: Apache-2.0
//
// Whole simulations in this process: names and texts of their files, in one to a few small frames.
#include "apps/simulate/simulate.h"

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <opencv2/core.hpp>

#include "calib/base/error.h"
#include "detectors/images/image.h"
#include "models/registry.h"
#include "tests/apps/workspace.h"

namespace plenocal::testing {
namespace TEST_FILE {

using ::testing::ElementsAre;
using ::testing::HasSubstr;

const std::string kCamera =
    "model: pinhole-radial3, image_size: [48, 40], detection_sigma: 0.1, blur: 0, "
    "parameters: {f_x: 40, f_y: 40, c_x: 24, c_y: 20}";

class InProcess : public Workspace {
 protected:
  InProcess() {
    Write("board.yaml",
          "plenocal: 1\ntype: chessboard\ncolumns: 5\nrows: 4\nsquare: 0.03\ntolerance: 0.0002\n");
  }
  std::string Make(const std::string& spec, bool points, size_t stop_after = 1000000) {
    Write("spec.yaml", "plenocal: 1\nseed: 3\n" + spec);
    stages_.clear();
    return Simulate({Path("spec.yaml"), Path("set"), points},
                    {.models = CameraModels(),
                     .program = "program",
                     .threads = 1,
                     .progress = [&](const std::string& stage, size_t done, size_t total) {
                       stages_.push_back(fmt::format("{} {}/{}", stage, done, total));
                       return stages_.size() < stop_after;
                     }});
  }
  [[nodiscard]] std::vector<std::string> Names() const {
    std::vector<std::string> names;
    for (const auto& [name, text] : Files("set")) names.push_back(name);
    return names;
  }
  std::vector<std::string> stages_;
};

const std::string kPair = "cameras:\n  left: {" + kCamera + "}\n  right: {" + kCamera +
                          ", xi_camera_rig: [-0.05, 0, 0, 0, 0, 0]}\n";

TEST_F(InProcess, PointsAreASessionWithItsTruth) {
  EXPECT_EQ(Make("target: board.yaml\nposes: {frames: 3, distance: [0.2, 0.3]}\n" + kPair, true),
            "left: the target in 3 of 3 frames\nright: the target in 3 of 3 frames\n");
  EXPECT_THAT(stages_, ElementsAre("poses 0/1", "markers 1/2", "markers 2/2"));
  EXPECT_THAT(Names(),
              ElementsAre("detections_left.csv",
                          "detections_right.csv",
                          "session.yaml",
                          "target.yaml",
                          "truth/calibration.yaml",
                          "truth/detections_left.csv",
                          "truth/detections_right.csv",
                          "truth/frames.csv",
                          "truth/poses.csv",
                          "truth/target.yaml"));
  EXPECT_EQ(
      Read("set/session.yaml"),
      "plenocal: 1\ntarget: target.yaml\ncameras:\n"
      "  left:\n    model: pinhole-radial3\n    detections: detections_left.csv\n    image_size: [48, 40]\n"
      "  right:\n    model: pinhole-radial3\n    detections: detections_right.csv\n    image_size: [48, 40]\n");
  const Table exact(Read("set/truth/detections_right.csv")),
      noisy(Read("set/detections_right.csv"));
  ASSERT_EQ(exact.Rows(), noisy.Rows());
  const auto columns = Lines(Read("set/detections_right.csv"))[0];
  double squares = 0;
  for (size_t i = 0; i < exact.Rows(); ++i)
    squares += std::pow(exact.Numbers("x")[i] - noisy.Numbers("x")[i], 2);
  EXPECT_NEAR(std::sqrt(squares / static_cast<double>(exact.Rows())), 0.1, 0.03) << columns;
  const Table frames(Read("set/truth/frames.csv"));
  EXPECT_THAT(frames.Column("frame"), ElementsAre("000100", "000105", "000110"));
  EXPECT_THAT(frames.Column("kind"), ElementsAre("good", "good", "good"));
  const auto markers = frames.Numbers("markers_right");
  EXPECT_EQ(markers[0] + markers[1] + markers[2], static_cast<double>(exact.Rows()));
  const YAML::Node truth = YAML::Load(Read("set/truth/calibration.yaml"));
  EXPECT_THAT(Read("set/truth/calibration.yaml"), HasSubstr("program simulate "));
  EXPECT_THAT(Read("set/truth/calibration.yaml"), HasSubstr(" --points"));
  EXPECT_EQ(truth["cameras"]["left"]["parameters"]["f_x"].as<double>(), 40);
  EXPECT_EQ(Table(Read("set/truth/poses.csv")).Rows(), 3u);
  EXPECT_THAT(Read("set/truth/target.yaml"), HasSubstr("markers:"));
  EXPECT_EQ(Read("set/target.yaml").find("markers:"), std::string::npos);
}

TEST_F(InProcess, MovingRigsHaveTimesAndSeveralTargetsTheirFiles) {
  Make(
      "target: board.yaml\nposes: {kind: moving, rate: 4, frames: 3, distance: [0.25, 0.3]}\ncameras:\n  left: {" +
          kCamera + ", time_shift: 0.125}\n  right: {" + kCamera +
          ", time_offset: 0.5, time_shift: 0.25, xi_camera_rig: [-0.05, 0, 0, 0, 0, 0]}\n",
      true);
  EXPECT_EQ(Read("set/times_left.txt"),
            "# frame, s\n000100 0.000000000\n000105 0.250000000\n000110 0.500000000\n");
  EXPECT_EQ(Read("set/times_right.txt"),
            "# frame, s\n000100 0.500000000\n000105 0.750000000\n000110 1.000000000\n");
  EXPECT_THAT(Read("set/session.yaml"), HasSubstr("    times: times_right.txt\n"));
  const YAML::Node truth = YAML::Load(Read("set/truth/calibration.yaml"));
  EXPECT_EQ(truth["cameras"]["right"]["time_shift"].as<double>(), 0.125);
  EXPECT_FALSE(truth["cameras"]["left"]["time_shift"]);

  Make(
      "targets: {a: board.yaml, b: {target: board.yaml, xi_target_own: [1, 0, 0, 0, 0, 0]}}\n"
      "poses: {frames: 4, distance: [0.25, 0.3], aim: all}\n" +
          kPair,
      true);
  EXPECT_THAT(Read("set/session.yaml"),
              HasSubstr("targets:\n  a: target_a.yaml\n  b: target_b.yaml\n"));
  EXPECT_THAT(
      Names(),
      ::testing::IsSupersetOf(
          {"target_a.yaml", "target_b.yaml", "truth/target_a.yaml", "truth/target_b.yaml"}));
  const YAML::Node two = YAML::Load(Read("set/truth/calibration.yaml"));
  EXPECT_TRUE(two["targets"]["b"]);
}

TEST_F(InProcess, ImagesAreExposedAndStillOnesDifferByNoiseAlone) {
  EXPECT_EQ(Make("target: board.yaml\nwhite_images: 1\n"
                 "exposures: {range: [2, 4], nominal: 4, order: sweep, error: 0}\n"
                 "poses: {kind: still, frames: 2, distance: [0.3, 0.3]}\ncameras:\n  left: {" +
                     kCamera + ", full_well: 1e6, response: {gamma: 2}, vignetting: 0}\n",
                 false),
            "left: the target in 2 of 2 frames\n");
  EXPECT_THAT(Names(),
              ElementsAre("left/000100.png",
                          "left/000105.png",
                          "left_white/white_00.png",
                          "recording.yaml",
                          "session.yaml",
                          "target.yaml",
                          "times_left.txt",
                          "truth/calibration.yaml",
                          "truth/detections_left.csv",
                          "truth/exposures.csv",
                          "truth/frames.csv",
                          "truth/pcalib_left.txt",
                          "truth/poses.csv",
                          "truth/target.yaml",
                          "truth/vignetting_left.tiff"));
  EXPECT_EQ(
      Read("set/session.yaml"),
      "plenocal: 1\ntarget: target.yaml\ncameras:\n  left:\n    model: pinhole-radial3\n    images: left/*.png\n"
      "    white_images: left_white/*.png\n");
  EXPECT_EQ(Read("set/times_left.txt"),
            "# frame time_s exposure_ms\n000100 0.200000 2\n000105 0.400000 4\n");
  EXPECT_THAT(
      stages_,
      ElementsAre(
          "poses 0/1", "markers 1/1", "optics 0/1", "images 1/3", "images 2/3", "images 3/3"));
  // Half the light, and the square root of it in grey values.
  const cv::Mat first = ReadImage(Path("set/left/000100.png")),
                second = ReadImage(Path("set/left/000105.png"));
  ASSERT_EQ(first.size(), cv::Size(48, 40));
  int bright = 0;
  for (int y = 0; y < 40; ++y) {
    for (int x = 0; x < 48; ++x) {
      if (second.at<std::uint8_t>(y, x) < 150) continue;
      EXPECT_NEAR(first.at<std::uint8_t>(y, x), second.at<std::uint8_t>(y, x) * std::sqrt(0.5), 2);
      ++bright;
    }
  }
  EXPECT_GT(bright, 100);
  // White paper at the nominal exposure: 0.8 of the largest light.
  EXPECT_NEAR(cv::mean(ReadImage(Path("set/left_white/white_00.png")))[0], 255 * std::sqrt(0.8), 4);
}

TEST_F(InProcess, AScenesTracksAndGivenCalibration) {
  const std::string spec =
      "scene: {points: 30, near: 0.5, far: 2, boxes: 3, distances: 1}\n"
      "trajectory: {kind: handheld, frames: 12, rate: 10}\n" +
      kPair;
  const std::string summary = Make(spec, true);
  EXPECT_THAT(
      summary,
      ::testing::MatchesRegex("left: [0-9]+ points in 12 frames, each in [0-9]+ of them\n"
                              "right: [0-9]+ points in 12 frames, each in [0-9]+ of them\n"));
  EXPECT_THAT(stages_, ElementsAre("scene 0/1", "tracks 0/2", "tracks 1/2"));
  EXPECT_THAT(Names(),
              ElementsAre("calibration.yaml",
                          "recording.yaml",
                          "session.yaml",
                          "times.txt",
                          "tracks_left.csv",
                          "tracks_right.csv",
                          "truth/calibration.yaml",
                          "truth/moving.csv",
                          "truth/points.csv",
                          "truth/poses.csv",
                          "truth/segments_left.txt",
                          "truth/segments_right.txt",
                          "truth/trajectory_left.txt",
                          "truth/trajectory_right.txt",
                          "truth/wrong_matches_left.csv",
                          "truth/wrong_matches_right.csv"));
  const Table tracks(Read("set/tracks_left.csv"));
  std::set<std::string> markers;
  for (const std::string& marker : tracks.Column("marker")) markers.insert(marker);
  EXPECT_THAT(summary,
              ::testing::StartsWith(fmt::format(
                  "left: {} points in 12 frames, each in {:.0f} of them\n",
                  markers.size(),
                  static_cast<double>(tracks.Rows()) / static_cast<double>(markers.size()))));
  EXPECT_THAT(Read("set/session.yaml"), HasSubstr("  distances:\n    - {between: [point "));
  EXPECT_THAT(Read("set/calibration.yaml"),
              HasSubstr("the parameters are true but for errors of the stated sigmas"));
  EXPECT_THAT(Read("set/truth/calibration.yaml"),
              HasSubstr("the parameters are true, not estimated"));
  EXPECT_EQ(Lines(Read("set/truth/segments_left.txt")).size(), 13u);
  EXPECT_EQ(Read("set/truth/calibration.yaml").find("vignetting"), std::string::npos);
  EXPECT_THROW(Make(spec, true, 2), Stopped);
}

TEST_F(InProcess, AScenesImages) {
  const std::string summary = Make(
      "scene: {near: 0.5, far: 2, boxes: 3}\ntrajectory: {kind: handheld, frames: 2}\ncameras:\n  left: {" +
          kCamera + "}\n",
      false);
  EXPECT_EQ(summary, "left: 2 images\n");
  EXPECT_THAT(stages_, ElementsAre("scene 0/1", "optics 0/1", "images 1/2", "images 2/2"));
  EXPECT_THAT(Names(),
              ElementsAre("calibration.yaml",
                          "left/000000.png",
                          "left/000015.png",
                          "recording.yaml",
                          "session.yaml",
                          "times.txt",
                          "truth/calibration.yaml",
                          "truth/poses.csv",
                          "truth/segments_left.txt",
                          "truth/trajectory_left.txt",
                          "truth/vignetting_left.tiff"));
  EXPECT_THAT(Read("set/truth/calibration.yaml"), HasSubstr("vignetting_left.tiff"));
  const cv::Mat image = ReadImage(Path("set/left/000000.png"));
  cv::Scalar mean, deviation;
  cv::meanStdDev(image, mean, deviation);
  EXPECT_NEAR(mean[0], 255 * 0.8 * 0.45 * 0.93, 15);  // the texture's mean, some lost by vignetting
  EXPECT_TRUE(deviation[0] > 12 && deviation[0] < 50);
}

}  // namespace TEST_FILE
}  // namespace plenocal::testing
