// SPDX-License-Identifier: Apache-2.0
#include <cmath>
#include <nlohmann/json.hpp>

#include "tests/apps/workspace.h"

namespace plenocal::testing {
namespace TEST_FILE {

using ::testing::HasSubstr;

class Locate : public Workspace {
 protected:
  Locate() {
    WriteProblem(EasyProblem());
    Calibrate();
  }

  /// Names of the CSV with the detections of the problem's camera, and of the camera.
  [[nodiscard]] std::string Camera() const { return EasyProblem().input.cameras[0].name; }
  [[nodiscard]] std::string Detections() const { return Camera() + ".csv"; }
};

TEST_F(Locate, FindsThePosesOfTheCalibration) {
  const Outcome run =
      Run({"locate", "out/calibration.yaml", "target.yaml", Detections(), "-o", "poses.csv"});
  ASSERT_EQ(run.status, kDone) << run.err;
  const Table located(Read("poses.csv")), calibrated(Read("out/poses.csv"));
  ASSERT_EQ(located.Column("image"), calibrated.Column("frame"));
  for (const char* axis : {"x", "y", "z"}) {
    const auto found = located.Numbers(axis), expected = calibrated.Numbers(axis);
    const auto variance = located.Numbers(std::string("cov_") + axis + "_" + axis);
    for (size_t i = 0; i < found.size(); ++i) {
      EXPECT_GT(variance[i], 0);
      // The calibration has used the same observations; its parameters are at their best for all.
      EXPECT_NEAR(found[i], expected[i], 1.5 * std::sqrt(variance[i])) << axis << " of " << i;
    }
  }
}

TEST_F(Locate, PrintsALineOfEachImage) {
  const Outcome run = Run({"locate", "out/calibration.yaml", "target.yaml", Detections()});
  ASSERT_EQ(run.status, kDone) << run.err;
  const Table poses(Read("out/poses.csv"));
  const std::vector<std::string> lines = Lines(run.out), frames = poses.Column("frame");
  ASSERT_EQ(lines.size(), frames.size());
  for (size_t i = 0; i < lines.size(); ++i) {
    EXPECT_THAT(lines[i], ::testing::StartsWith(frames[i] + ": ("));
    EXPECT_THAT(lines[i], ::testing::ContainsRegex("\\) m \\+- [0-9.]+ mm, [0-9.]+ mrad; "));
    EXPECT_THAT(lines[i], ::testing::ContainsRegex("([0-9]+) of [0-9]+ points, RMS 0\\.[0-9]+ px"));
  }
}

TEST_F(Locate, PrintsTheCovarianceAsJson) {
  const Outcome run =
      Run({"locate", "out/calibration.yaml", "target.yaml", Detections(), "--json"});
  ASSERT_EQ(run.status, kDone) << run.err;
  const auto poses = nlohmann::json::parse(run.out);
  ASSERT_FALSE(poses.empty());
  for (const auto& pose : poses) {
    ASSERT_EQ(pose["covariance"].size(), 6U);
    for (size_t i = 0; i < 6; ++i) {
      EXPECT_GT(pose["covariance"][i][i], 0);
      for (size_t j = 0; j < i; ++j) {
        EXPECT_NEAR(pose["covariance"][i][j], pose["covariance"][j][i], 1e-12);
      }
    }
  }
}

TEST_F(Locate, LeavesOutWrongPoints) {
  // Another marker's place, 40 px away.
  std::vector<std::string> lines = Lines(Read(Detections()));
  const Table table(Read(Detections()));
  const double x = table.Numbers("x")[0];
  const std::string frame = table.Column("frame")[0];
  std::string text =
      lines[0] + "\n" + Replaced(lines[1], table.Column("x")[0], std::to_string(x + 40)) + "\n";
  for (size_t i = 2; i < lines.size(); ++i) text += lines[i] + "\n";
  Write("wrong.csv", text);
  const Outcome run =
      Run({"locate", "out/calibration.yaml", "target.yaml", "wrong.csv", "-o", "poses.csv"});
  ASSERT_EQ(run.status, kDone) << run.err;
  const Table located(Read("poses.csv"));
  EXPECT_EQ(located.Numbers("used")[0], located.Numbers("points")[0] - 1);
}

TEST_F(Locate, RefusesWhatCannotBeLocated) {
  const auto expect =
      [&](const std::vector<std::string>& arguments, int status, const std::string& message) {
        std::vector<std::string> all{"locate", "out/calibration.yaml"};
        all.insert(all.end(), arguments.begin(), arguments.end());
        const Outcome run = Run(all);
        EXPECT_EQ(run.status, status) << run.err;
        EXPECT_THAT(run.err, HasSubstr(message));
      };
  Write("twice.csv", "marker,x,y,z\n1,0,0,1\n1,0,0,2\n");
  Write("far.csv", "marker,x,y,z\n100000,0,0,1\n");
  expect({"target.yaml", Detections(), "--camera", "nobody"}, kWrongInput, "nobody");
  expect({"nothing.yaml", Detections()}, kWrongInput, "nothing.yaml");
  expect(
      {"twice.csv", Detections()}, kWrongInput, "twice.csv:3:1: marker: point 1 stands here twice");
  expect({"far.csv", Detections()}, kJobFailed, "far.csv");
  expect({"far.csv", "nothing.png"}, kWrongInput, "descriptors.png");
}

}  // namespace TEST_FILE
}  // namespace plenocal::testing
