// SPDX-License-Identifier: Apache-2.0
#include <opencv2/imgproc.hpp>
#include <set>

#include "tests/apps/chessboard_images.h"
#include "tests/apps/workspace.h"

namespace plenocal::testing {
namespace TEST_FILE {

using ::testing::HasSubstr;
namespace fs = std::filesystem;

constexpr int kViews = 10;

/// Each view of a chessboard twice, sharp with an even number and then blurred with an odd one.
class ChosenFrames : public Workspace {
 protected:
  void SetUp() override {
    fs::create_directories(Path("images"));
    for (int view = 0; view < kViews; ++view) {
      cv::Mat image = ChessboardView(view, {640, 480});
      cv::imwrite(Path(fmt::format("images/{:03}.png", 2 * view)), image);
      constexpr double kBlur = 1.5;  // px
      cv::GaussianBlur(image, image, {}, kBlur);
      cv::imwrite(Path(fmt::format("images/{:03}.png", 2 * view + 1)), image);
    }
    Write("session.yaml",
          fmt::format("plenocal: 1\ntarget: 'chessboard:{}x{}:{}mm'\n"
                      "cameras: {{cam: {{model: pinhole-radial3, images: images/*.png}}}}\n",
                      kColumns,
                      kRows,
                      1000 * kSquare));
  }
};

TEST_F(ChosenFrames, AreTheSharpOnesAndTheOthersAreListed) {
  const Outcome outcome = Run({"detect", "session.yaml", "-o", "out", "--frames", "2"});
  ASSERT_EQ(outcome.status, 0) << outcome.err;
  EXPECT_THAT(outcome.err, HasSubstr("20 frames: at most 2 of them are chosen"));
  const std::vector<std::string> lines = Lines(Read("out/chosen_frames.csv"));
  ASSERT_EQ(lines.size(), 21U);
  EXPECT_EQ(lines[0], "frame,chosen,motion,blur,points,reason");
  size_t count = 0;
  for (size_t i = 1; i < lines.size(); ++i) {
    EXPECT_EQ(lines[i].substr(3, 3) == ",1,", lines[i].ends_with(',')) << lines[i];
    if (lines[i].substr(3, 3) != ",1,") continue;
    ++count;
    EXPECT_EQ(std::stoi(lines[i]) % 2, 0) << "blurred: " << lines[i];
  }
  EXPECT_EQ(count, 2U);
  std::set<std::string> detected;
  for (const std::string& frame : Table(Read("out/detections_cam.csv")).Column("frame")) {
    detected.insert(frame);
  }
  EXPECT_EQ(detected.size(), 2U);
}

TEST_F(ChosenFrames, AreAllWithAllAndOfFewFolderImages) {
  for (const std::vector<std::string>& more :
       {std::vector<std::string>{"--all"}, std::vector<std::string>{}}) {
    std::vector<std::string> arguments{"detect", "session.yaml", "-o", "out"};
    arguments.insert(arguments.end(), more.begin(), more.end());
    const Outcome outcome = Run(arguments);
    ASSERT_EQ(outcome.status, 0) << outcome.err;
    EXPECT_THAT(outcome.err, HasSubstr("20 images, target found in 20"));
    EXPECT_FALSE(fs::exists(Path("out/chosen_frames.csv")));
  }
}

TEST_F(ChosenFrames, ShardsFillTheCacheFromWhichCalibrateTakesTheSameDetections) {
  for (const char* shard : {"1/2", "2/2"}) {
    const Outcome outcome = Run({"detect",
                                 "session.yaml",
                                 "-o",
                                 fmt::format("shard{}", shard[0]),
                                 "--shard",
                                 shard,
                                 "--cache",
                                 "cache"});
    ASSERT_EQ(outcome.status, 0) << outcome.err;
    EXPECT_EQ(Table(Read(fmt::format("shard{}/shard.csv", shard[0]))).Rows(), 10U);
  }
  const Outcome sharded = Run({"detect", "session.yaml", "-o", "a", "--cache", "cache"});
  EXPECT_THAT(sharded.err, HasSubstr("detections of 20 images reused"));
  ASSERT_EQ(Run({"detect", "session.yaml", "-o", "b"}).status, 0);
  EXPECT_EQ(Read("a/detections_cam.csv"), Read("b/detections_cam.csv"));
  EXPECT_EQ(Run({"detect", "session.yaml", "-o", "a", "--cache", "cache", "--shard", "3/2"}).status,
            2);
}

TEST_F(ChosenFrames, FleetWritesAWorkflowAndAnOverview) {
  fs::create_directories(Path("rig1/2026-01"));
  fs::create_directories(Path("rig1/2026-02"));
  Write("rig1/2026-01/session.yaml", "plenocal: 1\n");
  Write("rig1/2026-02/session.yaml", "plenocal: 1\n");
  Write("plan.yaml", "plenocal: 1\nrigs: {rig1: {sessions: rig1/*/session.yaml}}\nshards: 3\n");
  const Outcome outcome = Run({"fleet", "plan.yaml", "-o", "results"});
  ASSERT_EQ(outcome.status, 0) << outcome.err;
  EXPECT_THAT(outcome.out, HasSubstr("1 rigs, 2 calibrations"));
  const std::string snakefile = Read("results/Snakefile");
  EXPECT_THAT(snakefile, HasSubstr("\"2026-02\": \""));
  EXPECT_THAT(snakefile, HasSubstr("SHARDS = 3"));
  // A rig that failed is on the page, with the last line of its log.
  fs::create_directories(Path("results/rig1/2026-01"));
  Write("results/rig1/2026-01/status.txt", "1\n");
  Write("results/rig1/2026-01/calibrate.log", "cam: 3 images\nno <target> found\n");
  ASSERT_EQ(Run({"fleet", "plan.yaml", "-o", "results", "--overview"}).status, 0);
  const std::string page = Read("results/overview.html");
  EXPECT_THAT(page, HasSubstr("1 failed, 1 open"));
}

}  // namespace TEST_FILE
}  // namespace plenocal::testing
