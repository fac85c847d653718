// SPDX-License-Identifier: Apache-2.0
//
// Ground truth of a scene that repeats itself: a pair passes shelves of equal bays twice.
#include <fmt/format.h>

#include <Eigen/Core>
#include <cmath>
#include <filesystem>
#include <string>
#include <vector>

#include "engine/scene/locate_view.h"
#include "models/registry.h"
#include "tests/apps/workspace.h"
#include "tests/calib/random.h"

namespace plenocal::testing {
namespace TEST_FILE {

using ::testing::HasSubstr;

constexpr double kFocal = 500, kCentre = 400, kBaseline = 0.1, kNoise = 0.3;  // px, m

class Shelves : public Workspace {
 protected:
  // The end calls so many of the 20 points of each bay by the numbers of the next bay's.
  [[nodiscard]] Outcome GroundTruth(int copies, int frames = 15, unsigned seed = 5) const {
    constexpr double kBay = 1.5;
    constexpr int kBays = 18, kPoints = 20;
    Random random(seed);
    std::vector<Eigen::Vector3d> points;
    for (int i = 0; i < kPoints; ++i) {
      points.emplace_back(random.Uniform(0, kBay), random.Uniform(-1.5, 1.5), random.Uniform(2, 5));
    }
    std::string tracks[2] = {"frame,marker,x,y,sigma\n", "frame,marker,x,y,sigma\n"};
    std::string times;
    for (int frame = 0; frame < 2 * frames; ++frame) {
      const bool at_end = frame >= frames;
      const double step = 0.3 * (frame % frames);
      const Eigen::Vector3d place(step, 0.5 * std::sin(step), 0.3 * std::cos(step) + 0.1 * at_end);
      times += fmt::format("{:04} {:.3f} 5\n", frame, step + (at_end ? 100 : 0));
      for (int c = 0; c < 2; ++c) {
        for (int bay = 0; bay < kBays; ++bay) {
          for (int i = 0; i < kPoints; ++i) {
            const Eigen::Vector3d p = points[static_cast<size_t>(i)] +
                                      Eigen::Vector3d((bay - 4) * kBay - c * kBaseline, 0, 0) -
                                      place;
            const double x = kCentre + kFocal * p.x() / p.z(), y = kCentre + kFocal * p.y() / p.z();
            if (p.z() < 0.5 || x < 0 || x > 2 * kCentre || y < 0 || y > 2 * kCentre) continue;
            tracks[c] += fmt::format("{:04},{},{:.4f},{:.4f},{}\n",
                                     frame,
                                     1000 * (bay + (at_end && i < copies ? 1 : 0)) + i,
                                     x + random.Gaussian(kNoise),
                                     y + random.Gaussian(kNoise),
                                     kNoise);
          }
        }
      }
    }
    const std::string camera = fmt::format(
        "    model: pinhole\n    image_size: [{0}, {0}]\n    parameters: {{f_x: {1}, f_y: {1}, "
        "c_x: {2}, c_y: {2}}}\n",
        2 * kCentre,
        kFocal,
        kCentre);
    const auto place = [](double x) {
      return fmt::format(
          "    T_camera_rig: [[1, 0, 0, {}], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]\n", x);
    };
    std::filesystem::create_directories(Path("recording"));
    Write("recording/tracks_left.csv", tracks[0]);
    Write("recording/tracks_right.csv", tracks[1]);
    Write("recording/times.txt", times);
    Write("recording/calibration.yaml",
          "plenocal: 1\ncameras:\n  left:\n" + camera + place(0) + "  right:\n" + camera +
              place(-kBaseline));
    const std::string stream = "times: times.txt, exposure_unit: ms}\n";
    Write("recording/recording.yaml",
          "plenocal: 1\ncalibration: calibration.yaml\npairing: {by: name}\ncameras:\n"
          "  left: {tracks: tracks_left.csv, " +
              stream + "  right: {tracks: tracks_right.csv, " + stream);
    return Run({"groundtruth", "recording", "-o", "out"});
  }
};

TEST_F(Shelves, OfWhichMostEndPointsAreCopiesFitTheStartInTwoWays) {
  const Outcome outcome = GroundTruth(12);
  EXPECT_EQ(outcome.status, kJobFailed) << outcome.err;
  EXPECT_THAT(outcome.err, HasSubstr("the end fits the start in two ways"));
  EXPECT_THAT(outcome.err, HasSubstr("agree on another one, 1.5"));
}

// The error of a long path exceeds the limit of agreement: no one pose fits all frames of the end.
TEST_F(Shelves, OfALongPathFitTheStartInTwoWays) {
  for (const unsigned seed : {2, 3}) {
    const Outcome outcome = GroundTruth(12, 40, seed);
    EXPECT_THAT(outcome.err, HasSubstr("the end fits the start in two ways")) << "seed " << seed;
  }
}

TEST_F(Shelves, WithoutCopiesFitTheStartInOneWay) {
  const Outcome outcome = GroundTruth(0);
  EXPECT_EQ(outcome.status, kDone) << outcome.err;
  EXPECT_EQ(outcome.err.find("contradict this pose"), std::string::npos) << outcome.err;
}

// A pose among points of which so many of 100 were taken for those 1.5 m beside them.
std::optional<LocatedView> LocatedAmongCopies(int copies) {
  Random random(3);
  CalibratedCamera camera{.name = "camera",
                          .model = FindModel(CameraModels(), "pinhole"),
                          .image_size = {800, 800},
                          .config = {},
                          .params = {kFocal, kFocal, kCentre, kCentre},
                          .covariance = Eigen::Matrix4d::Zero(),
                          .T_camera_rig = {}};
  std::map<int, Eigen::Vector3d> points;
  View view;
  for (int i = 0; i < 100; ++i) {
    const Eigen::Vector3d p(random.Uniform(-1, 1), random.Uniform(-1, 1), random.Uniform(2, 5));
    points[i] = p + Eigen::Vector3d(i < copies ? 1.5 : 0, 0, 0);
    Observation seen;
    seen.marker = i;
    seen.values[0] = kCentre + kFocal * p.x() / p.z() + random.Gaussian(kNoise);
    seen.values[1] = kCentre + kFocal * p.y() / p.z() + random.Gaussian(kNoise);
    view.observations.push_back(seen);
  }
  return LocateView(camera, view, points, Numbering::kByAppearance);
}

TEST(LocatedViews, AmongCopiesHaveAAlternativePose) {
  for (const int copies : {40, 60}) {
    const auto located = LocatedAmongCopies(copies);
    ASSERT_TRUE(located && located->alternative);
    EXPECT_TRUE(located->alternative->IsAmbiguous());
    EXPECT_NEAR(located->alternative->distance, 1.5, 0.05);
  }
  const auto located = LocatedAmongCopies(0);
  ASSERT_TRUE(located);
  EXPECT_FALSE(located->alternative);
}

}  // namespace TEST_FILE
}  // namespace plenocal::testing
