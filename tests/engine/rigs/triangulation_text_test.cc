// SPDX-License-Identifier: Apache-2.0
//
// Tables, summary and text of points and measures that are put together by hand.
#include <fmt/format.h>
#include <gmock/gmock.h>

#include <nlohmann/json.hpp>
#include <numbers>

#include "calib/io/output_folder.h"
#include "engine/rigs/triangulate_points.h"
#include "tests/temporary_folder.h"

namespace plenocal::testing {
namespace TEST_FILE {

using ::testing::EndsWith;
using ::testing::HasSubstr;
using ::testing::StartsWith;

// Noise of 1, 2 and 3 mm, errors of the calibration of 4 mm in z and by jitter of 12 mm in z.
TriangulatedPoint PointOf(int marker, double z) {
  TriangulatedPoint made{.frame = "f1", .marker = marker, .point = {}, .used = true};
  SpacePoint& point = made.point;
  point.position = {0.1, -0.2, z};
  point.rho = 1 / z;
  point.sigma_rho = 0.01;
  point.noise = Eigen::Vector3d(1e-6, 4e-6, 9e-6).asDiagonal();
  point.noise(0, 1) = point.noise(1, 0) = 5e-7;
  point.shared = Eigen::MatrixXd::Zero(3, 3);
  point.shared(0, 0) = 1e-3;
  point.shared(2, 1) = 4e-3;
  point.shared(2, 2) = 12e-3;
  point.frame_columns = 1;
  point.observations = 2;
  point.rms = 0.25;
  point.probability = 0.5;
  return made;
}

Triangulation Made() {
  Triangulation made;
  made.cameras = {"left", "right"};
  made.calibration = "c.yaml";
  made.correlation = 0.25;
  made.sigmas = 2;
  made.points = {PointOf(3, 2), PointOf(4, 4)};
  made.rays = {.chi_square = 1.5, .degrees = 2, .probability = 0.125};
  return made;
}

std::vector<std::string> Written(const Triangulation& made) {
  const TemporaryFolder folder;
  OutputFolder out(folder / "out");
  WriteTriangulation(made, &out);
  out.Commit();
  std::vector<std::string> files;
  for (const char* name : {"points.csv", "shared.csv", "measures.csv", "triangulation.yaml"}) {
    files.push_back(folder.Read(std::string("out/") + name));
  }
  return files;
}

TEST(TriangulationFiles, PointsHaveCovariancesAndTheirParts) {
  Triangulation made = Made();
  made.points[1].point.reason = "none";  // is not in the table
  made.points.push_back(PointOf(5, 4));
  made.points[2].used = false;
  EXPECT_EQ(
      Written(made)[0],
      "frame,marker,x,y,z,rho,sigma_rho,nearest,farthest,cov_x_x,cov_x_y,cov_x_z,cov_y_y,cov_y_z,"
      "cov_z_z,noise_x_x,noise_x_y,noise_x_z,noise_y_y,noise_y_z,noise_z_z,sigma_z_noise,"
      "sigma_z_calibration,sigma_z_jitter,rays,rms,probability,used\n"
      "f1,3,0.1,-0.2,2,0.5,0.01,1.92307692,2.08333333,2e-06,5e-07,0,4e-06,0,0.000169,1e-06,5e-07,0,"
      "4e-06,0,9e-06,0.003,0.004,0.012,2,0.25,0.5,1\n"
      "f1,5,0.1,-0.2,4,0.25,0.01,3.7037037,4.34782609,2e-06,5e-07,0,4e-06,0,0.000169,1e-06,5e-07,0,"
      "4e-06,0,9e-06,0.003,0.004,0.012,2,0.25,0.5,0\n");
}

TEST(TriangulationFiles, SharedErrorsAreThoseOfUsedPoints) {
  Triangulation made = Made();
  made.points[0].used = false;
  EXPECT_EQ(Written(made)[1],
            "frame,marker,coordinate,c_1,c_2,jitter_1\n"
            "f1,4,x,0.001,0,0\nf1,4,y,0,0,0\nf1,4,z,0,0.004,0.012\n");
}

std::vector<TriangulatedMeasure> Measures() {
  const Measured number{
      .value = 0.5, .noise = 3e-3, .calibration = 4e-3, .jitter = 12e-3, .bias = 1e-5};
  MeasuredPlane plane, line;
  plane.rms = 2e-3;
  plane.chi_square = 1.25;
  plane.degrees = 2;
  line.degrees = -1;
  return {{"f,1", "length", "3 4", number, {}},
          {"f1", "angle", "3 4 5", number, {}},
          {"f1", "plane", "3 4 5 6", {}, plane},
          {"f1", "plane", "7 8", {}, line}};
}

TEST(TriangulationFiles, MeasuresHaveIntervalsAndUnits) {
  Triangulation made = Made();
  made.measures = Measures();
  EXPECT_EQ(
      Written(made)[2],
      "frame,kind,of,value,unit,sigma,sigma_noise,sigma_calibration,sigma_jitter,bias,low,high,"
      "chi_square,degrees\n"
      "\"f,1\",length,3 4,0.5,m,0.013,0.003,0.004,0.012,1e-05,0.474,0.526,,\n"
      "f1,angle,3 4 5,0.5,rad,0.013,0.003,0.004,0.012,1e-05,0.474,0.526,,\n"
      "f1,plane,3 4 5 6,0.002,m,,,,,,,,1.25,2\n"
      "f1,plane,7 8,,m,,,,,,,,,\n");
}

TEST(TriangulationFiles, TheSummaryIsYamlOfTheSameNumbersAsTheJson) {
  Triangulation made = Made();
  made.measures = Measures();
  made.frame = SpaceFrame::kHousing;
  made.left_out = {{.where = "f1 point 9", .reason = "why"}};
  made.adjusted = {{"left.f_x", -0.5, 2, 1}};
  made.findings = {{.code = "undetermined", .what = "What.", .remedy = "Do."}};
  made.points[1].used = false;
  const std::string yaml = Written(made)[3];
  EXPECT_THAT(yaml, StartsWith("plenocal: 1\ncalibration: \"c.yaml\"\n"));
  EXPECT_THAT(yaml, HasSubstr("\nframe_of_reference: \"housing\"\npoints: 1\nleft_out: 1\n"));
  EXPECT_THAT(yaml, HasSubstr("\nchi_square: 1.5\ndegrees: 2\nprobability: 0.125\nlevel: 0.95\n"));
  EXPECT_THAT(yaml, HasSubstr("\ncorrelation: 0.25\n"));
  EXPECT_THAT(yaml, HasSubstr("\"left.f_x\""));
  const std::string text = TriangulationJson(made);
  EXPECT_THAT(text, EndsWith("}\n"));
  const nlohmann::json json = nlohmann::json::parse(text);
  EXPECT_EQ(json["cameras"], nlohmann::json({"left", "right"}));
  EXPECT_EQ(json["adjusted"]["left.f_x"],
            nlohmann::json({{"change", -0.5}, {"sigma_before", 2}, {"sigma", 1}}));
  EXPECT_EQ(json["findings"][0]["code"], "undetermined");
  ASSERT_EQ(json["points"].size(), 2U);
  EXPECT_EQ(json["points"][0]["frame"], "f1");
  EXPECT_EQ(json["points"][0]["marker"], 3);
  EXPECT_EQ(json["points"][1]["z"], 4);
  EXPECT_EQ(json["points"][1]["used"], 0);
  ASSERT_EQ(json["shared"].size(), 3U);
  EXPECT_EQ(json["shared"][2]["coordinate"], "z");
  EXPECT_EQ(json["shared"][2]["jitter_1"], 0.012);
  ASSERT_EQ(json["measures"].size(), 4U);
  EXPECT_EQ(json["measures"][1]["of"], "3 4 5");
  EXPECT_EQ(json["measures"][1]["kind"], "angle");
  EXPECT_EQ(json["measures"][1]["unit"], "rad");
  EXPECT_EQ(json["measures"][3]["value"], nullptr);
  made.frame = SpaceFrame::kRig;
  made.points[1].point.sigma_rho = 0.2;  // may lie at infinity
  const nlohmann::json far = nlohmann::json::parse(TriangulationJson(made));
  EXPECT_EQ(far["frame_of_reference"], "rig");
  EXPECT_EQ(far["points"][1]["farthest"], nullptr);
}

TEST(TriangulationText, HasMediansOfTheErrorsOfZ) {
  Triangulation made = Made();
  EXPECT_EQ(
      TriangulationText(made),
      "left + right: 2 points, 0 left out; sigma of z 13 mm (noise 3, calibration 4, jitter 12; "
      "medians)\n");
  for (TriangulatedPoint& each : made.points) each.point.shared.col(2).setZero();
  made.points[1].used = false;
  EXPECT_EQ(
      TriangulationText(made),
      "left + right: 1 points, 1 left out; sigma of z 5 mm (noise 3, calibration 4; medians)\n");
  made.points[0].point.rho = 0;
  EXPECT_EQ(TriangulationText(made), "left + right: 1 points, 1 left out; all at infinity\n");
}

TEST(TriangulationText, MeasuresAreInMillimetresAndDegrees) {
  Triangulation made = Made();
  made.measures = Measures();
  made.measures[1].number =
      Measured{.value = std::numbers::pi / 3, .noise = std::numbers::pi / 180};
  EXPECT_THAT(TriangulationText(made),
              EndsWith("\nf,1: length 3 4: 500 +- 13 mm (noise 3, calibration 4, jitter 12)\n"
                       "f1: angle 3 4 5: 60 +- 1 degrees (noise 1, calibration 0)\n"
                       "f1: plane 3 4 5 6: 2 mm RMS from the plane, chi-square 1.25 of 2 degrees\n"
                       "f1: plane 7 8: no plane: the points lie on a line\n"));
}

TEST(TriangulationText, NamesTheNumbersThatChangedAndThatAreDeterminedMost) {
  Triangulation made = Made();
  made.adjusted = {{"left.f_x", 1, 2, 1.9}, {"left.c_x", -3, 2, 1.8}, {"right.f_x", 0.5, 4, 1}};
  EXPECT_THAT(
      TriangulationText(made),
      EndsWith("\ncalibration adjusted: left.c_x by 1.5 of its standard errors, the others by "
               "less; right.f_x has 0.25 of its standard error left\n"));
}

TEST(TriangulationText, ListsTwentyMeasuresAndReasonsAndAllFindings) {
  Triangulation made = Made();
  for (int k = 0; k < 20; ++k) {
    made.measures.push_back({"f1", "length", std::to_string(k), Measured{}, {}});
    made.left_out.push_back({.where = fmt::format("f1 point {}", k), .reason = "why"});
  }
  made.findings = {{.code = "a", .grade = Grade::kBad, .what = "A.", .remedy = "Do a."},
                   {.code = "b", .grade = Grade::kUsable, .what = "B.", .remedy = "Do b."}};
  std::string text = TriangulationText(made);
  EXPECT_THAT(text,
              HasSubstr("f1: length 19: 0 +- 0 mm (noise 0, calibration 0)\nleft out: f1 point 0: "
                        "why\n"));
  EXPECT_THAT(text,
              EndsWith("left out: f1 point 19: why\nbad [a] A.\n    Do a.\nusable [b] B.\n    Do "
                       "b.\n"));
  made.measures.resize(23, made.measures[0]);
  made.left_out.push_back({.where = "f1 point 20", .reason = "why"});
  text = TriangulationText(made);
  EXPECT_THAT(text, HasSubstr("\nand 3 more in measures.csv\nleft out: f1 point 0: why\n"));
  EXPECT_THAT(text, ::testing::Not(HasSubstr("point 20")));
}

}  // namespace TEST_FILE
}  // namespace plenocal::testing
