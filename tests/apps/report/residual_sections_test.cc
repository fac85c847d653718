// SPDX-License-Identifier: Apache-2.0
#include "apps/report/residual_sections.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <numeric>

#include "models/registry.h"

namespace plenocal::testing {
namespace TEST_FILE {

using Json = nlohmann::json;

// One camera, two frames, three markers at 1, 2 and 4 m in the first frame, 0.5 m farther in the
// second. Residuals (n, 0) px of points n = 1 to 6; the fourth is rejected.
CalibrationRecord SixPoints() {
  CalibrationRecord record;
  CalibratedCamera camera;
  camera.name = "cam";
  camera.model = FindModel(CameraModels(), "pinhole");
  camera.image_size = {640, 480};
  camera.params = {500, 500, 320, 240};
  camera.covariance = Eigen::Matrix4d::Zero();
  camera.fit.points = 5;
  camera.fit.noise_sigma = 2;
  const double z[] = {1, 2, 4};
  for (int m = 0; m < 3; ++m) record.markers[10 + m].position = {0, 0, z[m]};
  for (int f = 0; f < 2; ++f) {
    const RigidTransform T_rig_target{Eigen::Matrix3d::Identity(), {0, 0, 0.5 * f}};
    record.frames.push_back({"frame", T_rig_target.Inverse()});
    for (int m = 0; m < 3; ++m) {
      const int n = 3 * f + m + 1;
      camera.residuals.push_back({.frame = f,
                                  .marker = 10 + m,
                                  .values = {10.04 * n, 5.0 * n},
                                  .residual = {1.0 * n, 0},
                                  .noise_sigma = n == 1 ? 0.5 : 0,
                                  .used = n != 4});
    }
  }
  record.cameras.push_back(camera);
  return record;
}

TEST(ResidualSections, SumUsedAndRejectedPointsOfEachGroup) {
  const CalibrationRecord record = SixPoints();
  const CalibratedCamera& camera = record.cameras[0];
  // Groups 0 and 2 of the points 1, 3, 5 and 4; 2 and 6 have none.
  const Json sums = SumsJson(camera, "group", [](size_t row) {
    return row == 3 ? 2 : row % 2 == 0 ? 0 : -1;
  });
  EXPECT_EQ(sums["group"], Json({0, 2}));
  EXPECT_EQ(sums["points"], Json({3, 0}));
  EXPECT_EQ(sums["rejected"], Json({0, 1}));
  EXPECT_NEAR(sums["rms"][0].get<double>(), std::sqrt((1 + 9 + 25) / 3.0), 1e-3);
  EXPECT_TRUE(sums["rms"][1].is_null());

  const Json all = ResidualSections(record, 0, 100, {0, 1, 1, 0, -1, 0});
  EXPECT_EQ(all["frames"]["points"], Json({3, 2}));
  EXPECT_EQ(all["frames"]["rejected"], Json({0, 1}));
  EXPECT_NEAR(all["frames"]["rms"][1].get<double>(), std::sqrt((25 + 36) / 2.0), 1e-2);
  EXPECT_EQ(all["markers"]["marker"], Json({10, 11, 12}));
  EXPECT_EQ(all["markers"]["points"], Json({1, 2, 2}));
  EXPECT_EQ(all["types"]["type"], Json({0, 1}));
  EXPECT_EQ(all["types"]["points"], Json({2, 2}));
  EXPECT_EQ(ResidualSections(record, 0, 100, {})["types"]["type"], Json::array());
}

TEST(ResidualSections, HaveDepthsOfThePointsInTheCamera) {
  CalibrationRecord record = SixPoints();
  record.cameras[0].T_camera_rig.t.z() = 0.25;
  const Json sections = ResidualSections(record, 0, 100, {});
  EXPECT_EQ(sections["sample"]["depth"], Json({1.25, 2.25, 4.25, 1.75, 2.75, 4.75}));
  // 30 bins from the nearest to the farthest used point, 1.25 to 4.75 m.
  const Json& histogram = sections["depth"];
  ASSERT_EQ(histogram["middles"].size(), 30U);
  EXPECT_NEAR(histogram["middles"][0].get<double>(), 1.25 + 3.5 / 60, 1e-2);
  EXPECT_NEAR(histogram["middles"][29].get<double>(), 4.75 - 3.5 / 60, 1e-2);
  std::vector<int> expected(30, 0);
  for (const double depth : {1.25, 2.25, 4.25, 2.75}) {
    ++expected[static_cast<size_t>((depth - 1.25) / (3.5 / 30))];
  }
  ++expected[29];
  EXPECT_EQ(histogram["counts"], Json(expected));
  for (ResidualRow& row : record.cameras[0].residuals) row.used = false;
  EXPECT_TRUE(ResidualSections(record, 0, 100, {})["depth"].is_null());
}

TEST(ResidualSections, SampleEveryKthPoint) {
  CalibrationRecord record = SixPoints();
  record.cameras[0].residuals[2].residual[0] = std::numeric_limits<double>::quiet_NaN();
  const Json sample = ResidualSections(record, 0, 3, {})["sample"];
  EXPECT_EQ(sample["all"], 6);
  EXPECT_EQ(sample["step"], 2);
  EXPECT_EQ(sample["x"], Json({10.0, 50.2}));  // points 1 and 5; 3 is outside the model's domain
  EXPECT_EQ(sample["y"], Json({5, 25}));
  EXPECT_EQ(sample["dx"], Json({1, 5}));
  EXPECT_EQ(sample["frame"], Json({0, 1}));
  EXPECT_EQ(sample["marker"], Json({10, 11}));
  EXPECT_EQ(ResidualSections(record, 0, 4, {})["sample"]["step"], 2);
  EXPECT_EQ(ResidualSections(record, 0, 6, {})["sample"]["step"], 1);
}

TEST(ResidualSections, CountResidualsInTheirStandardDeviations) {
  CalibrationRecord record = SixPoints();
  const Json histogram = ResidualSections(record, 0, 100, {})["histogram"];
  // x / sigma: 2 by its own sigma of 0.5 px, 1, 1.5, 2.5 and 3 by that of the camera; y is 0.
  std::vector<int> expected(49, 0);
  const auto bin = [](double in_sigmas) {
    return static_cast<size_t>(std::floor((in_sigmas + 4.9) / 0.2));
  };
  for (const double in_sigmas : {2.0, 1.0, 1.5, 2.5, 3.0, 0.0, 0.0, 0.0, 0.0, 0.0}) {
    ++expected[bin(in_sigmas)];
  }
  EXPECT_EQ(histogram["counts"], Json(expected));
  EXPECT_EQ(histogram["coordinates"], 10);
  EXPECT_EQ(histogram["outside"], 0);
  EXPECT_EQ(histogram["sigmas"][0], -4.8);
  EXPECT_EQ(histogram["sigmas"][48], 4.8);
  // More unknowns (two poses) than coordinates: the density is that of the whole noise.
  EXPECT_EQ(histogram["noise_left"], 1);
  const double normal = 10 * (std::erf(0.1 / std::sqrt(2.0)));
  EXPECT_NEAR(histogram["expected"][24].get<double>(), normal, 1e-2);

  record.cameras[0].residuals[1].residual = {-9.81, 9.79};  // 4.905 and 4.895 sigmas
  const Json wide = ResidualSections(record, 0, 100, {})["histogram"];
  EXPECT_EQ(wide["outside"], 1);
  EXPECT_EQ(wide["counts"][48], 1);
}

TEST(ResidualSections, LeaveAsMuchNoiseAsUnknownsDoNotAbsorb) {
  CalibrationRecord record = SixPoints();
  record.cameras[0].fit.points = 50;
  // Of 100 coordinates 12 by two poses, 3 by parameters with a standard error, 2 by extrinsics.
  record.cameras[0].covariance.diagonal() << 1, 4, 0, 9;
  record.cameras[0].sigma_xi[1] = record.cameras[0].sigma_xi[4] = 0.1;
  const Json histogram = ResidualSections(record, 0, 100, {})["histogram"];
  EXPECT_NEAR(histogram["noise_left"].get<double>(), 0.83, 1e-9);
  const double middle = 10 * std::erf(0.1 / std::sqrt(2 * 0.83));
  EXPECT_NEAR(histogram["expected"][24].get<double>(), middle, 1e-2);
}

}  // namespace TEST_FILE
}  // namespace plenocal::testing
