// SPDX-License-Identifier: Apache-2.0
#include "assess/text/compare_text.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <limits>
#include <numbers>

#include "models/registry.h"

namespace plenocal {
namespace TEST_FILE {

using ::testing::AllOf;
using ::testing::HasSubstr;
using ::testing::Not;

CalibratedCamera Camera(const std::string& name, double f_x, double sigma) {
  Eigen::MatrixXd covariance = Eigen::MatrixXd::Zero(4, 4);
  covariance(0, 0) = sigma * sigma;
  return {.name = name,
          .model = FindModel(CameraModels(), "pinhole"),
          .image_size = {640, 480},
          .config = {},
          .params = {f_x, 500, 320, 240},
          .covariance = covariance,
          .T_camera_rig = {}};
}

// One camera, or a pair, compared at 2 m and far away.
CalibrationComparison Comparison(size_t cameras) {
  CalibrationComparison comparison;
  for (size_t c = 0; c < cameras; ++c) {
    const std::string name = c == 0 ? "left" : "right";
    comparison.a.push_back(Camera(name, 503, 3));
    comparison.b.push_back(Camera(name, 500, 4));
    CameraDifference difference;
    difference.name = name;
    difference.T_b_a = {ExpRotation({0, 0, 0.25 * std::numbers::pi / 180}), {0.001, -0.002, 0}};
    difference.has_prediction = true;
    difference.same = true;
    for (const double distance : {2.0, std::numeric_limits<double>::infinity()}) {
      DistanceDifference at{};
      at.distance = distance;
      at.all.rms = 0.125;
      at.all.largest = 0.5;
      at.all.predicted = 0.25;
      at.all.points = 300;
      difference.distances.push_back(at);
    }
    comparison.differences.push_back(difference);
  }
  if (cameras == 2) {
    comparison.extrinsics.push_back({.rotation = std::numbers::pi / 180,
                                     .translation = 0.003,
                                     .rotation_sigma = 2 * std::numbers::pi / 180,
                                     .translation_sigma = 0.004,
                                     .has_prediction = true});
  }
  return comparison;
}

TEST(ComparisonText, HasParametersInSigmasAndTheMotionInDegreesAndMillimetres) {
  const std::string text = ComparisonText(Comparison(1), "a", "b");
  EXPECT_THAT(text, HasSubstr("left  (pinhole and pinhole, 640 x 480 px)\n"));
  EXPECT_THAT(
      text,
      HasSubstr("  f_x                     503              500              3        0.6\n"
                "  f_y                     500              500              0           \n"));
  EXPECT_THAT(text,
              HasSubstr("taken out: a rotation vector (0.0000, 0.0000, 0.2500) degrees and a "
                        "translation (1.000, -2.000, 0.000) mm of the camera's frame\n"));
  EXPECT_THAT(
      text,
      AllOf(
          HasSubstr("  2 m        all                0.1250     0.5000       0.2500      300\n"),
          HasSubstr("  far away   all                0.1250     0.5000       0.2500      300\n")));
  EXPECT_TRUE(text.ends_with("\nsame within uncertainty\n")) << text;
}

TEST(ComparisonText, HasTheExtrinsicsOfAllButTheFirstCamera) {
  CalibrationComparison comparison = Comparison(2);
  const std::string line =
      "  on the rig: turned by 1.0000 degrees (sigmas: 2.0000), shifted by 3.000 mm (sigmas: 4.000)\n";
  EXPECT_THAT(ComparisonText(comparison, "a", "b"),
              AllOf(HasSubstr(line), HasSubstr("\nsame within uncertainty\n")));
  comparison.extrinsics[0].differs = true;
  EXPECT_THAT(ComparisonText(comparison, "a", "b"),
              AllOf(HasSubstr("4.000): more than the sigmas explain\n"),
                    HasSubstr("\nnot the same within uncertainty\n")));
  comparison.has_correlations = false;
  EXPECT_THAT(ComparisonText(comparison, "a", "b"),
              HasSubstr("4.000; too large, without the correlations of a correlations.csv beside "
                        "each file): more"));
}

TEST(ComparisonText, HasNoVerdictWithoutSigmas) {
  for (const bool of_extrinsics : {false, true}) {
    CalibrationComparison comparison = Comparison(2);
    (of_extrinsics ? comparison.extrinsics[0].has_prediction
                   : comparison.differences[1].has_prediction) = false;
    const std::string text = ComparisonText(comparison, "a", "b");
    EXPECT_THAT(text, HasSubstr("\nno verdict for all cameras\n"));
    EXPECT_EQ(text.find("unknown") == std::string::npos, of_extrinsics);
  }
  CalibrationComparison other = Comparison(2);
  other.differences[0].same = false;
  EXPECT_THAT(ComparisonText(other, "a", "b"), HasSubstr("\nnot the same within uncertainty\n"));
}

TEST(ComparisonText, NamesCamerasWithoutACounterpart) {
  CalibrationComparison comparison = Comparison(1);
  comparison.only_a = {"cam1", "cam2"};
  EXPECT_THAT(
      ComparisonText(comparison, "x.yaml", "y.yaml"),
      AllOf(HasSubstr("not compared, only in x.yaml: cam1, cam2\n"), Not(HasSubstr("--map"))));
  comparison.only_b = {"third"};
  EXPECT_THAT(ComparisonText(comparison, "x.yaml", "y.yaml"),
              AllOf(HasSubstr("not compared, only in y.yaml: third\n"), HasSubstr("--map")));
}

TEST(ComparisonCsv, HasARowForEachDistance) {
  CalibrationComparison comparison = Comparison(1);
  comparison.differences[0].distances.resize(1);
  comparison.differences[0].distances[0].all.probability = 0.04;
  comparison.differences[0].distances[0].all.differs = true;
  const std::string csv = ComparisonCsv(comparison);
  EXPECT_THAT(csv,
              HasSubstr("camera,distance,part,rms,largest,predicted,probability,pixels,differs\n"
                        "left,2,all,0.125,0.5,0.25,0.04,300,1\n"));
  comparison.differences[0].has_prediction = false;
  EXPECT_THAT(ComparisonCsv(comparison), HasSubstr("left,2,all,0.125,0.5,,,300,1\n"));
}

}  // namespace TEST_FILE
}  // namespace plenocal
