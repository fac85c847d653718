// SPDX-License-Identifier: Apache-2.0
#include "engine/json/calibration_json.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <nlohmann/json.hpp>
#include <numbers>

#include "assess/check.h"
#include "models/registry.h"

namespace plenocal {
namespace TEST_FILE {

using Json = nlohmann::json;

constexpr double kInfinity = std::numeric_limits<double>::infinity();

TEST(Short, HasThatManyDigits) {
  EXPECT_EQ(Short(std::numbers::pi), 3.142);
  EXPECT_EQ(Short(0.0123456, 3), 0.0123);
  EXPECT_EQ(Short(-0.00098765), -0.0009877);
  EXPECT_EQ(Short(123456), 123500);
  EXPECT_EQ(Short(123456, 2), 120000);
  EXPECT_EQ(Short(9.9999, 3), 10);
  EXPECT_EQ(Short(2.5e20, 1), 3e20);
  EXPECT_EQ(Short(0), 0);
  for (const double none : {kInfinity, -kInfinity, std::nan("")}) {
    EXPECT_TRUE(Short(none).is_null());
    EXPECT_TRUE(AsInFile(none).is_null());
  }
}

TEST(TransformJson, HasTheRowsOfRAndT) {
  RigidTransform T;
  T.R << 1, 2, 3, 4, 5, 6, 7, 8, 9.123456789;
  T.t = {0.123456789, 20, 30};
  EXPECT_EQ(TransformJson(T, 4), Json::array({1, 2, 3, 0.1235, 4, 5, 6, 20, 7, 8, 9.12, 30}));
  EXPECT_EQ(VectorJson({0.123456789, 1, -2}), Json::array({0.1234568, 1, -2}));
}

TEST(VerdictJson, HasNullForNumbersThatAFindingDoesNotHave) {
  Verdict verdict{.grade = Grade::kUsable, .findings = {}};
  verdict.findings.push_back({.code = "a",
                              .grade = Grade::kUsable,
                              .cameras = {"left"},
                              .value = 0.25,
                              .what = "what",
                              .remedy = "remedy"});
  EXPECT_EQ(VerdictJson(verdict),
            Json({{"grade", "usable"},
                  {"findings",
                   Json::array({{{"code", "a"},
                                 {"grade", "usable"},
                                 {"cameras", Json::array({"left"})},
                                 {"value", 0.25},
                                 {"limit", nullptr},
                                 {"what", "what"},
                                 {"remedy", "remedy"}}})}}));
}

TEST(CheckJson, NamesItsNumbers) {
  CalibrationCheck check;
  check.frames = 7;
  check.valid = false;
  check.level = 0.01;
  check.cameras.push_back({.name = "left",
                           .points = 90,
                           .rms_held = 0.5,
                           .rms_free = 0.25,
                           .expected = 0.375,
                           .probability = 0.125,
                           .extrinsics_probability = 1,
                           .rotation = 0.5,
                           .translation = 2,
                           .valid = false});
  const Json json = CheckJson(check);
  EXPECT_EQ(json["frames"], 7);
  EXPECT_EQ(json["valid"], false);
  EXPECT_EQ(json["verdict"]["findings"][0]["value"], 0.125);
  EXPECT_EQ(json["cameras"],
            Json::array({{{"name", "left"},
                          {"valid", false},
                          {"points", 90},
                          {"rms_poses_only", 0.5},
                          {"rms_expected", 0.375},
                          {"rms_all_free", 0.25},
                          {"probability", 0.125},
                          {"mount_turn", 0.5},
                          {"mount_shift", 2.0},
                          {"mount_probability", 1.0}}}));
}

TEST(SpaceJson, HasWhatMovedOnlyOfATargetThatWasRefined) {
  CalibrationRecord record;
  record.frames.push_back({.name = "07", .T_target_rig = {Eigen::Matrix3d::Identity(), {1, 2, 3}}});
  record.markers[4].position = {0.5, 0, 0.25};
  record.markers[4].nominal = Eigen::Vector3d(0.5, 0, 0);
  record.markers[4].sigma = Eigen::Vector3d(0.001, 0.002, 0.003);
  record.markers[9].position = {1, 1, 1};
  Json json = SpaceJson(record);
  EXPECT_EQ(json["poses"],
            Json::array({{{"name", "07"},
                          {"T_target_rig", Json::array({1, 0, 0, 1, 0, 1, 0, 2, 0, 0, 1, 3})}}}));
  EXPECT_EQ(json["markers"][0], Json({{"number", 4}, {"place", Json::array({0.5, 0, 0.25})}}));
  record.adjustment = AdjustmentRecord{.marker_freedom = MarkerFreedom::Rigid()};
  EXPECT_EQ(SpaceJson(record), json);
  record.adjustment = AdjustmentRecord{.marker_freedom = MarkerFreedom::FromSigma(0.001)};
  json = SpaceJson(record);
  EXPECT_EQ(json["markers"][0]["moved"], Json::array({0, 0, 0.25}));
  EXPECT_EQ(json["markers"][0]["sigma"], Json::array({0.001, 0.002, 0.003}));
  EXPECT_FALSE(json["markers"][1].contains("moved"));
}

TEST(FieldJson, HasMeansWhereThereArePoints) {
  std::vector<ResidualRow> vectors(2);
  vectors[0] = {.values = {1, 1}, .residual = {0.3, -0.4}};
  vectors[1] = {.values = {1.5, 1}, .residual = {0.1, 0}};
  const Json field = FieldJson({640, 480}, vectors);
  const size_t cells = field["columns"].get<size_t>() * field["rows"].get<size_t>();
  ASSERT_EQ(field["points"].size(), cells);
  EXPECT_EQ(field["points"][0], 2);
  EXPECT_EQ(field["mean_x"][0], 0.2);
  EXPECT_EQ(field["mean_y"][0], -0.2);
  EXPECT_EQ(field["rms"][0], Short(std::sqrt((0.25 + 0.01) / 2)));
  for (const char* key : {"mean_x", "mean_y", "rms"}) {
    ASSERT_EQ(field[key].size(), cells);
    EXPECT_TRUE(field[key][cells - 1].is_null()) << key;
  }
}

TEST(CalibrationJson, HasTheCamerasByName) {
  CalibrationRecord record;
  record.verdict = Verdict{.grade = Grade::kGood, .findings = {}};
  record.frames.resize(3);
  record.target_scales = {{"target.scale", {0.01, 0.002}}};
  for (const char* name : {"left", "right"}) {
    CalibratedCamera& camera = record.cameras.emplace_back();
    camera.name = name;
    camera.model = FindModel(CameraModels(), "pinhole");
    camera.image_size = {640, 480};
    camera.params = {500, 501, 320, 240};
    camera.covariance = Eigen::Vector4d(4, kInfinity, 0.25, 0).asDiagonal();
  }
  CalibratedCamera& right = record.cameras[1];
  right.T_camera_rig.t = {-0.25, 0, 0};
  right.fit.rms = 0.2, right.fit.noise_sigma = 0.15, right.fit.detector_sigma = 0.05;
  right.fit.points = 70, right.fit.rejected = 2, right.fit.views = 3;
  const Json json = CalibrationJson(record);
  EXPECT_EQ(json["frames"], 3);
  EXPECT_EQ(json["verdict"]["grade"], "good");
  EXPECT_EQ(json["target_scale"]["target.scale"], Json({{"value", 0.01}, {"sigma", 0.002}}));
  const Json& camera = json["cameras"]["right"];
  EXPECT_EQ(camera["index"], 1);
  EXPECT_EQ(camera["model"], "pinhole");
  EXPECT_EQ(camera["plenoptic"], false);
  EXPECT_EQ(camera["image_size"], Json::array({640, 480}));
  EXPECT_EQ(camera["parameters"],
            Json({{"f_x", 500.0}, {"f_y", 501.0}, {"c_x", 320.0}, {"c_y", 240.0}}));
  EXPECT_EQ(camera["sigma"], Json({{"f_x", 2.0}, {"f_y", nullptr}, {"c_x", 0.5}, {"c_y", 0.0}}));
  EXPECT_EQ(camera["units"][0], Json::array({"f_x", "px"}));
  EXPECT_EQ(camera["T_rig_camera"][3], 0.25);
  EXPECT_EQ(camera["rms"], 0.2);
  EXPECT_EQ(camera["noise"], 0.15);
  EXPECT_EQ(camera["detector_sigma"], 0.05);
  EXPECT_TRUE(json["cameras"]["left"]["detector_sigma"].is_null());
  EXPECT_EQ(camera["points"], 70);
  EXPECT_EQ(camera["rejected"], 2);
  EXPECT_EQ(camera["views"], 3);
}

}  // namespace TEST_FILE
}  // namespace plenocal
