// SPDX-License-Identifier: Apache-2.0
//
// Calibrations in files, merged: weighted means of independent numbers, refusals, texts and tables.
#include "engine/rigs/merge_calibrations.h"

#include <fmt/format.h>
#include <gmock/gmock.h>

#include "calib/files/calibration_file.h"
#include "models/registry.h"
#include "tests/refusal.h"
#include "tests/temporary_folder.h"

namespace plenocal::testing {
namespace TEST_FILE {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::StartsWith;

CalibratedCamera Camera(const std::string& name, double focal, double sigma) {
  CalibratedCamera camera;
  camera.name = name;
  camera.model = FindModel(CameraModels(), "pinhole");
  camera.image_size = {640, 480};
  camera.params = {focal, 500, 320, 240};
  camera.covariance = sigma * sigma * Eigen::MatrixXd::Identity(4, 4);
  return camera;
}

class MergeCalibrationsInFiles : public ::testing::Test {
 protected:
  std::filesystem::path WriteRecord(const std::string& name,
                                    double focal,
                                    double sigma,
                                    const Provenance& provenance = {}) {
    CalibrationRecord record;
    record.cameras = {Camera("left", focal, sigma)};
    record.adjustment.emplace();
    record.provenance = provenance;
    folder_.Write(name + "/calibration.yaml", CalibrationYaml(record));
    return folder_ / name;
  }

  TemporaryFolder folder_;
};

TEST_F(MergeCalibrationsInFiles, NumbersAreMeansByTheirStandardErrors) {
  MergeRequest request;
  request.calibrations = {WriteRecord("a", 500, 3), WriteRecord("b", 505, 4) / "calibration.yaml"};
  folder_.Write("out/mounts.csv", "old");
  request.out = folder_ / "out";
  std::vector<std::string> stages;
  plenocal::Run run;
  run.listener.progress = [&](const std::string& stage, size_t, size_t) {
    stages.push_back(stage);
  };
  const MergedFiles found = MergeFiles(request, run);
  EXPECT_THAT(stages, ElementsAre("merge"));
  EXPECT_THAT(found.names,
              ElementsAre((folder_ / "a/calibration.yaml").string(),
                          (folder_ / "b/calibration.yaml").string()));
  const CalibratedCamera& camera = found.merged.record.cameras.at(0);
  // Weights 16 and 9 of 25.
  EXPECT_NEAR(camera.params[0], 501.8, 1e-9);
  EXPECT_NEAR(camera.Sigma(0), 2.4, 1e-9);
  EXPECT_NEAR(found.merged.chi_square, 1, 1e-9);
  EXPECT_EQ(found.merged.degrees, 4);
  EXPECT_EQ(found.merged.record.verdict.value().grade, Grade::kGood);
  const std::string csv = folder_.Read("out/merge.csv");
  EXPECT_THAT(csv,
              StartsWith("calibration,unknown,deviation,sigma,in_sigmas\n" + found.names[0] +
                         ",left.f_x,-1.8,1.8,-1.000\n"));
  EXPECT_THAT(csv, HasSubstr(found.names[1] + ",left.f_x,3.2,3.2,1.000\n"));
  EXPECT_FALSE(std::filesystem::exists(folder_ / "out/mounts.csv"));
  EXPECT_THAT(folder_.Read("out/correlations.csv"), HasSubstr("left.f_x"));
  const std::string yaml = folder_.Read("out/calibration.yaml");
  EXPECT_THAT(yaml, HasSubstr("merged_1: "));
  EXPECT_THAT(yaml, HasSubstr("merged_2: "));
  EXPECT_THAT(yaml, HasSubstr("plenocal_version: "));
}

TEST_F(MergeCalibrationsInFiles, ADisagreementIsTheVerdict) {
  MergeRequest request;
  request.calibrations = {WriteRecord("a", 500, 1), WriteRecord("b", 520, 1)};
  const MergedFiles found = MergeFiles(request, {});
  EXPECT_EQ(found.merged.record.verdict.value().grade, Grade::kUsable);
  ASSERT_FALSE(found.merged.record.findings.empty());
  EXPECT_EQ(found.merged.record.findings[0].code, "calibrations_disagree");
  EXPECT_THAT(MergeText(found),
              HasSubstr("; the calibrations disagree, and standard errors were "
                        "scaled by 7.07\n"));
}

TEST_F(MergeCalibrationsInFiles, NoneCountsTwice) {
  const auto refused = [&](const std::vector<std::filesystem::path>& calibrations) {
    MergeRequest request;
    request.calibrations = calibrations;
    std::string why = Refusal([&] { MergeFiles(request, {}); });
    const std::string path = (folder_ / "").string();
    for (size_t at = why.find(path); at != std::string::npos; at = why.find(path)) {
      why.erase(at, path.size());
    }
    return why;
  };
  const auto a = WriteRecord("a", 500, 1);
  EXPECT_EQ(refused({a, a / "calibration.yaml"}), "input: a/calibration.yaml: is given twice");
  for (const std::string session : {"from: ../a/calibration.yaml\n",
                                    "from: {file: ../a/calibration.yaml}\n",
                                    "cameras: {left: {from: ../a/calibration.yaml}}\n"}) {
    const auto b = WriteRecord("b",
                               500,
                               1,
                               {{"folder", (folder_ / "").string()},
                                {"session", "b/session.yaml"},
                                {"session_text", session}});
    for (const auto& both : {std::vector{a, b}, {b, a}}) {
      EXPECT_EQ(
          refused(both),
          "input: b/calibration.yaml: was calibrated from a/calibration.yaml, which it contains "
          "already; leave a/calibration.yaml out");
    }
    EXPECT_EQ(refused({b}), "");
  }
  const auto other = WriteRecord("c",
                                 500,
                                 1,
                                 {{"folder", (folder_ / "").string()},
                                  {"session", "c/session.yaml"},
                                  {"session_text", "from: ../d/calibration.yaml\n"}});
  EXPECT_EQ(refused({a, other}), "");
}

TEST_F(MergeCalibrationsInFiles, AStopEndsTheWork) {
  MergeRequest request;
  request.calibrations = {WriteRecord("a", 500, 1), WriteRecord("b", 500, 1)};
  request.out = folder_ / "out";
  std::stop_source stop;
  stop.request_stop();
  plenocal::Run run;
  run.stop = stop.get_token();
  EXPECT_THROW(MergeFiles(request, run), Stopped);
  EXPECT_FALSE(std::filesystem::exists(folder_ / "out/calibration.yaml"));
}

// Two cameras, of which the second moved; deviations of the first calibration alone.
MergedFiles ByHand() {
  MergedFiles result;
  MergedCalibrations& merged = result.merged;
  merged.record.cameras = {Camera("left", 500, 2), Camera("right", 510, 0)};
  CalibratedCamera& right = merged.record.cameras[1];
  right.T_camera_rig.t.x() = -0.25;
  right.sigma_xi << 1e-3, 2e-3, 3e-3, 0, 0, 0;
  merged.mounts = {
      {.calibration = 1, .camera = 1, .T_camera_rig = {Eigen::Matrix3d::Identity(), {1, 0, 0}}}};
  merged.deviations = {{.camera = 0, .param = 0, .deviation = -3, .sigma = 1},
                       {.camera = 0, .param = 1, .deviation = 8, .sigma = 2},
                       {.camera = 0, .param = 2, .deviation = 100, .sigma = 0},
                       {.camera = 1, .component = 1, .deviation = 2e-3, .sigma = 1e-3}};
  merged.degrees = 3;
  merged.chi_square = 29;
  result.names = {"a.yaml", "b.yaml"};
  return result;
}

TEST(MergeText, NamesNumbersPlacesAndTheFarthestDeviations) {
  MergedFiles result = ByHand();
  const std::string head =
      "left  (pinhole, 640 x 480 px)\n"
      "  f_x                     500 +- 2\n"
      "  f_y                     500 +- 2\n"
      "  c_x                     320 +- 2\n"
      "  c_y                     240 +- 2\n"
      "right  (pinhole, 640 x 480 px)\n"
      "  f_x                     510 +- 0\n"
      "  f_y                     500 +- 0\n"
      "  c_x                     320 +- 0\n"
      "  c_y                     240 +- 0\n"
      "  on the rig: xi = (-250.000, 0.000, 0.000) +- (1.000, 2.000, 3.000) mm, (0.0000, 0.0000, "
      "0.0000) +- (0.0000, 0.0000, 0.0000) degrees\n"
      "right on the rig in b.yaml: xi = (1000.000, 0.000, 0.000) +- (0.000, 0.000, 0.000) mm, "
      "(0.0000, 0.0000, 0.0000) +- (0.0000, 0.0000, 0.0000) degrees\n"
      "\n" +
      fmt::format("{:<40} RMS sigmas  farthest from the merged calibration\n", "calibration") +
      // Root of (9 + 16 + 4) / 3.
      fmt::format("{:<40}       3.11  left.f_y by 8 px, 4.0 sigma\n", "a.yaml") +
      fmt::format("{:<40}             has nothing in common with others\n", "b.yaml");
  EXPECT_EQ(MergeText(result),
            head +
                "chi-square of all deviations: 29.0 at 3 degrees of freedom; the calibrations "
                "agree\n");
  result.merged.scale = 3.109;
  result.merged.degrees = 1;
  result.merged.record.findings = {{.code = "x", .what = "What.", .remedy = "Do."}};
  EXPECT_EQ(MergeText(result),
            head +
                "chi-square of all deviations: 29.0 at 1 degree of freedom; the calibrations "
                "disagree, and standard errors were scaled by 3.11\n\nWhat. Do.\n");
  result.merged.degrees = 0;
  result.merged.record.findings.clear();
  EXPECT_EQ(MergeText(result), head);
}

}  // namespace TEST_FILE
}  // namespace plenocal::testing
