// SPDX-License-Identifier: Apache-2.0
//
// Ground truth from real stereo images.
#include <sstream>

#include "tests/apps/workspace.h"
#include "tests/optional_data.h"

namespace plenocal::testing {
namespace TEST_FILE {

using ::testing::HasSubstr;

class ImageLoop : public Workspace {
 protected:
  Outcome GroundTruth(const std::filesystem::path& recording,
                      const std::vector<std::string>& more = {}) const {
    std::vector<std::string> arguments{"groundtruth",
                                       recording.string(),
                                       "--calibration",
                                       (recording / "calibration.yaml").string(),
                                       "-o",
                                       "truth"};
    arguments.insert(arguments.end(), more.begin(), more.end());
    return Run(arguments);
  }
};

TEST_F(ImageLoop, IsRegisteredWhereItsEndSeesTheStart) {
  const std::filesystem::path data = OptionalData("scene_real/stereo_loop_library");
  if (!std::filesystem::exists(data)) GTEST_SKIP() << Absent(data);
  const Outcome run = GroundTruth(data, {"--points", "300", "--start", ":0020", "--end", "0335:"});
  ASSERT_EQ(run.status, kDone) << run.err;
  const YAML::Node truth = YAML::Load(Read("truth/groundtruth.yaml"));
  EXPECT_EQ(truth["segments"]["start"]["frames"].as<int>(), 20);
  EXPECT_EQ(truth["segments"]["end"]["frames"].as<int>(), 12);
  EXPECT_GT(truth["common_points"].as<int>(), 30);
  EXPECT_LT(truth["cameras"]["left"]["rms"].as<double>(), 1);
  EXPECT_THAT(Read("truth/report.html"), HasSubstr("Ground truth of a loop"));
  // An image of the recording, in the frame of the points: its pose is that of the segment.
  const Outcome located = Run({"locate",
                               (data / "calibration.yaml").string(),
                               "truth/points.csv",
                               (data / "left" / "0005.jpg").string(),
                               "--camera",
                               "left",
                               "-o",
                               "poses.csv"});
  ASSERT_EQ(located.status, kDone) << located.err;
  const std::vector<std::string> lines = Lines(Read("truth/segments_left.txt"));
  std::istringstream row(lines[5]);  // a comment, then the frames from 0001 on
  double time = 0, x = 0, y = 0, z = 0;
  row >> time >> x >> y >> z;
  const Table poses(Read("poses.csv"));
  EXPECT_NEAR(poses.Numbers("x")[0], x, 0.02);
  EXPECT_NEAR(poses.Numbers("y")[0], y, 0.02);
  EXPECT_NEAR(poses.Numbers("z")[0], z, 0.02);
}

TEST_F(ImageLoop, IsRefusedWhereTheEndIsElsewhere) {
  const std::filesystem::path data = OptionalData("scene_real/stereo_walk_backyard");
  if (!std::filesystem::exists(data)) GTEST_SKIP() << Absent(data);
  const Outcome run = GroundTruth(data, {"--points", "300", "--start", ":0010", "--end", "0180:"});
  EXPECT_EQ(run.status, kJobFailed);
  EXPECT_THAT(run.err, HasSubstr("start and end do not see the same scene"));
  EXPECT_TRUE(Files("truth").empty());
}

}  // namespace TEST_FILE
}  // namespace plenocal::testing
