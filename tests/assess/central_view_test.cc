// SPDX-License-Identifier: Apache-2.0
//
// A camera without a single centre as a central one.
#include "assess/central_view.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <string>

#include "calib/camera/rays.h"
#include "models/check/model_properties.h"
#include "models/registry.h"
#include "tests/refusal.h"

namespace plenocal {
namespace TEST_FILE {

using ::testing::HasSubstr;

// One camera that has seen a target of one point at 0.5, 1 and 3 m.
CalibrationRecord RecordOf(const char* model, std::vector<double> params) {
  CalibrationRecord record;
  record.cameras.push_back({.name = "left",
                            .model = FindModel(CameraModels(), model),
                            .image_size = {640, 480},
                            .config = {},
                            .params = std::move(params),
                            .covariance = {},
                            .T_camera_rig = {}});
  record.markers[0] = {.position = {0, 0, 0}};
  for (const double z : {3.0, 0.5, 1.0}) {
    RigidTransform T_target_camera;
    T_target_camera.t.z() = -z;
    record.frames.push_back({"frame", T_target_camera});
  }
  return record;
}

CalibrationRecord WithPupil(double e_0) {
  return RecordOf("equidistant+pupil", {210, 212, 322, 243, e_0, 0, 0});
}

TEST(CentralView, IsExactAtItsDistance) {
  const CalibrationRecord record = WithPupil(0.004);
  const CalibratedCamera& camera = record.cameras[0];
  for (const double distance : {0.3, 1.0, std::numeric_limits<double>::infinity()}) {
    const CentralView view(record, camera, distance);
    EXPECT_TRUE(view.camera().model->IsCentral());
    for (const double x : {10.0, 300.0, 630.0}) {
      const double u[kMaxObservationSize] = {x, 30};
      const auto ray = Unproject(camera, u), central = Unproject(view.camera(), u);
      ASSERT_TRUE(ray && central);
      EXPECT_EQ(central->origin, Eigen::Vector3d::Zero());
      if (std::isinf(distance)) {
        EXPECT_LT((central->direction - ray->direction).norm(), 1e-14);
        continue;
      }
      double seen[2];
      ASSERT_TRUE(Project(camera, u, distance * central->direction, seen));
      EXPECT_NEAR(seen[0], u[0], 1e-9);
      EXPECT_NEAR(seen[1], u[1], 1e-9);
    }
    size_t violated = 0;
    CameraModel model = *view.camera().model;
    model.example = view.camera().params;
    const std::string text = CheckModel(model, &violated);
    EXPECT_EQ(violated, 0) << text;
  }
}

TEST(CentralView, StatesTheTargetsDistanceAndTheErrorAtOthers) {
  const CalibrationRecord record = WithPupil(0.004);
  const CentralView view(record, record.cameras[0], std::nullopt);
  const Provenance stated = view.WithDistance({});
  ASSERT_EQ(stated.size(), 1);
  EXPECT_EQ(stated[0].first, "exact_at");
  EXPECT_EQ(stated[0].second, "left 1 m");
  EXPECT_EQ(view.WithDistance(stated)[0].second, "left 1 m, left 1 m");  // of the second of a pair
  // Of the corner, at half the distance: f z_p sin(theta) (1 / 0.5 - 1 / 1) in first order.
  const double theta = std::hypot(322 / 210.0, 243 / 212.0);
  const double z_p = (theta / std::sin(theta) - 1) * 0.004;
  EXPECT_NEAR(view.LargestError(), 211 * z_p * std::sin(theta), 0.1 * view.LargestError());
}

TEST(CentralView, ReportsItsDistanceAndTheErrorAtOthers) {
  const CalibrationRecord record = WithPupil(0.004);
  std::string messages;
  const plenocal::Run run{
      .listener = {.message = [&](const std::string& line) { messages += line; }}};
  CentralView(record, record.cameras[0], 2.0).Report(run);
  EXPECT_THAT(messages, HasSubstr("exact at the distance 2 m, and off by at most"));
  EXPECT_THAT(messages, HasSubstr("px at half and at twice it; --distance chooses another"));
  messages.clear();
  CentralView(record, record.cameras[0], std::numeric_limits<double>::infinity()).Report(run);
  EXPECT_THAT(messages, HasSubstr("exact at the distance infinite, and off by at most"));
  EXPECT_THAT(messages, HasSubstr("px at 1 m; --distance"));
  messages.clear();
  const CalibrationRecord central = RecordOf("equidistant", {210, 212, 322, 243});
  CentralView(central, central.cameras[0], 2.0).Report(run);
  EXPECT_EQ(messages, "");
}

TEST(CentralView, OfACentralCameraIsTheCameraItself) {
  const CalibrationRecord record = RecordOf("equidistant", {210, 212, 322, 243});
  const CentralView view(record, record.cameras[0], std::nullopt);
  EXPECT_EQ(&view.camera(), &record.cameras[0]);
  EXPECT_TRUE(view.WithDistance({}).empty());
  EXPECT_EQ(view.LargestError(), 0);
}

TEST(CentralView, WithoutFramesNeedsADistance) {
  CalibrationRecord record = WithPupil(0.004);
  record.frames.clear();
  EXPECT_THAT(
      testing::RefusalOf([&] { const CentralView view(record, record.cameras[0], std::nullopt); }),
      HasSubstr("--distance METRES"));
}

}  // namespace TEST_FILE
}  // namespace plenocal
