// SPDX-License-Identifier: Apache-2.0
//
// Predictions from a calibration in a file: sets of cameras, refusals, tables and texts.
#include "engine/rigs/predict_accuracy.h"

#include <fmt/format.h>
#include <gmock/gmock.h>

#include <cmath>
#include <nlohmann/json.hpp>

#include "calib/files/calibration_file.h"
#include "tests/engine/rigs/parallel_pair.h"
#include "tests/refusal.h"
#include "tests/temporary_folder.h"

namespace plenocal::testing {
namespace TEST_FILE {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

class AccuracyOfFile : public ::testing::Test {
 protected:
  void Write(CalibrationRecord record) {
    record.adjustment.emplace();
    request_.calibration = folder_.Write("c/calibration.yaml", CalibrationYaml(record));
    request_.distances = {2};
    request_.cells = 4;
  }

  [[nodiscard]] std::vector<std::string> Sets() {
    std::vector<std::string> sets;
    for (const RigAccuracy& each : PredictAccuracy(request_, {})) {
      sets.push_back(CamerasText(each.cameras));
    }
    return sets;
  }

  TemporaryFolder folder_;
  AccuracyRequest request_;
};

TEST_F(AccuracyOfFile, IsThatOfTheSetsAskedForOrOfAll) {
  Write(ParallelCameras(1e-6, 3));
  EXPECT_THAT(Sets(),
              ElementsAre("left + right", "left + third", "right + third", "left + right + third"));
  request_.sets = {{"third", "left"}};
  EXPECT_THAT(Sets(), ElementsAre("third + left"));
  const RigAccuracy found = PredictAccuracy(request_, {})[0];
  // Disparity's noise at 2 m over twice the base.
  const double noise = 4 / (kPairFocal * 2 * kPairBase) * std::sqrt(2) * kPairNoise;
  EXPECT_NEAR(found.distances.at(0).z.noise, noise, 0.02 * noise);
}

TEST_F(AccuracyOfFile, OfRequestsThatDoNotFitIsRefused) {
  Write(ParallelCameras(1e-6));
  const auto refused = [&] { return Refusal([&] { PredictAccuracy(request_, {}); }); };
  request_.distances = {2, 0};
  EXPECT_EQ(refused(), "input: --distances: expected lengths above 0 m");
  request_.distances = {1e-3};
  EXPECT_THAT(refused(), ::testing::Not(HasSubstr("--distances")));
  request_.distances = {2};
  request_.noise = {{"up", 1}};
  EXPECT_THAT(refused(), HasSubstr("up"));
  request_.noise = {{"left", 1}};
  EXPECT_EQ(refused(), "");
  request_.sets = {{"left", "up"}};
  EXPECT_THAT(refused(), HasSubstr("up"));
  request_.sets = {{"left", "right", "left"}};
  EXPECT_EQ(refused(), "input: --pair left,right,left: camera 'left' stands there twice");
}

TEST_F(AccuracyOfFile, WithoutStandardErrorsIsNotPredicted) {
  std::vector<std::string> messages;
  plenocal::Run run;
  run.listener.message = [&](const std::string& line) { messages.push_back(line); };
  Write(ParallelCameras(0, 3));
  EXPECT_EQ(Refusal([&] { PredictAccuracy(request_, run); }),
            "input: " + request_.calibration.string() + ": nothing can be predicted");
  ASSERT_EQ(messages.size(), 4U);
  EXPECT_THAT(messages[1], ::testing::StartsWith("left + third: left out: "));
  Write(ParallelCameras(0));
  messages.clear();
  EXPECT_THAT(Refusal([&] { PredictAccuracy(request_, run); }),
              ::testing::EndsWith("give the folder that 'plenocal calibrate' wrote"));
  EXPECT_THAT(messages, IsEmpty());
}

TEST(AccuracyInBrief, IsOfFourSetsAndFewCells) {
  CalibrationRecord record = ParallelCameras(1e-6, 3);
  CalibratedCamera fourth = record.cameras[2];
  fourth.name = "fourth";
  fourth.T_camera_rig.t.x() = -0.5;
  record.cameras.push_back(fourth);
  // All have seen a marker 2 m away.
  record.frames = {{"1", {}}};
  record.markers[0].position = {0.25, 0, 2};
  for (CalibratedCamera& camera : record.cameras) {
    const double x = 320 + kPairFocal * (0.25 + camera.T_camera_rig.t.x()) / 2;
    camera.residuals = {{.frame = 0, .marker = 0, .values = {x, 240}}};
  }
  const std::vector<MicroLensVisibility> lenses(4);
  const std::vector<RigAccuracy> found = AccuracyInBrief(record, lenses);
  ASSERT_EQ(found.size(), 4U);
  for (const RigAccuracy& each : found) {
    EXPECT_EQ(each.cameras.size(), 2U);
    EXPECT_EQ(each.grid.Columns(), 6);
    EXPECT_EQ(each.distances.front().distance, 2);
  }
  record.cameras.resize(1);
  EXPECT_THAT(AccuracyInBrief(record, lenses), IsEmpty());
  EXPECT_THAT(AccuracyInBrief(ParallelCameras(0), lenses), IsEmpty());
}

// One distance of a pair, by hand, and one of a camera without depth.
std::vector<RigAccuracy> ByHand() {
  std::vector<RigAccuracy> all(2);
  all[0].cameras = {"left", "right"};
  all[0].noise = {0.1, 0.2};
  all[0].grid = ImageGrid({640, 480}, 4);
  AccuracyAtDistance& at = all[0].distances.emplace_back();
  at.distance = 2.5;
  at.seen_at = 1.25;
  AccuracyCell& cell = at.cells.emplace_back();
  cell.cell = 5;
  cell.z = {.noise = 3e-3, .calibration = 4e-3, .scale = 0, .jitter = 12e-3};
  cell.lateral = {.noise = 6e-3, .calibration = 3e-3, .scale = 4e-3};
  cell.across = ErrorBudget{.noise = 1e-3};
  all[1].cameras = {"one,a"};
  all[1].noise = {0.3};
  all[1].grid = all[0].grid;
  all[1].has_depth = false;
  all[1].distances = all[0].distances;
  AccuracyCell& other = all[1].distances[0].cells[0];
  all[1].distances[0].seen_at.reset();
  other.across.reset();
  other.along = ErrorBudget{.scale = 2e-3};
  return all;
}

TEST(AccuracyFiles, HaveARowACell) {
  const std::vector<RigAccuracy> all = ByHand();
  AccuracyRequest request;
  request.calibration = "folder";
  const OutputContents files = AccuracyFiles(request, all);
  ASSERT_EQ(files.size(), 2U);
  const Eigen::Vector2d u = all[0].grid.Middle(5);
  const std::string place = fmt::format(",2.5,{:.6g},{:.6g},", u.x(), u.y());
  EXPECT_EQ(files[0].first, "accuracy.csv");
  EXPECT_EQ(
      files[0].second,
      "cameras,distance,x,y,sigma_z,sigma_z_noise,sigma_z_calibration,sigma_lateral,"
      "sigma_lateral_noise,sigma_lateral_calibration,sigma_bar_across,sigma_bar_along,seen_at\n"
      "left+right" +
          place + "0.013,0.003,0.004,0.00781025,0.006,0.005,0.001,,1.25\n\"one,a\"" + place +
          ",,,0.00781025,0.006,0.005,,0.002,\n");
  EXPECT_EQ(files[1].first, "accuracy.json");
  nlohmann::json json = nlohmann::json::parse(files[1].second);
  EXPECT_EQ(json["plenocal"], 1);
  EXPECT_EQ(json["calibration"], "folder");
  EXPECT_EQ(json["frame_of_reference"], "rig");
  EXPECT_EQ(json["accuracy"].size(), 2U);
  request.frame = SpaceFrame::kHousing;
  json = nlohmann::json::parse(AccuracyFiles(request, all)[1].second);
  EXPECT_EQ(json["frame_of_reference"], "housing");
}

TEST(AccuracyText, HasALineADistanceThenWhatIsOpenAndFound) {
  std::vector<RigAccuracy> all = ByHand();
  all.resize(1);
  all[0].open = {"left.f_x", "right.c_y"};
  all[0].findings = {{.code = "x", .what = "What.", .remedy = "Do."}};
  const std::string text = AccuracyText(all), line = text.substr(0, text.find('\n'));
  EXPECT_THAT(line, ::testing::StartsWith("left + right at 2.5 m"));
  EXPECT_EQ(text,
            line +
                "\n  left open by the calibration and taken as exact: left.f_x, right.c_y\n"
                "  x: What. Do.\n");
  all[0].open.clear();
  all[0].findings.clear();
  EXPECT_EQ(AccuracyText(all), line + "\n");
}

}  // namespace TEST_FILE
}  // namespace plenocal::testing
