// SPDX-License-Identifier: Apache-2.0
#include "assess/compare_calibrations.h"

#include <gmock/gmock.h>

#include <cmath>
#include <limits>

#include "calib/base/error.h"
#include "models/registry.h"

namespace plenocal {
namespace TEST_FILE {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::ThrowsMessage;

CalibrationRecord Cameras(const std::vector<std::string>& names) {
  CalibrationRecord record;
  for (const std::string& name : names) {
    CalibratedCamera& camera = record.cameras.emplace_back();
    camera.name = name;
    camera.model = FindModel(CameraModels(), "pinhole");
    camera.image_size = {640, 480};
    camera.params = {500, 500, 320, 240};
    camera.covariance = 1e-4 * Eigen::MatrixXd::Identity(4, 4);
    camera.T_camera_rig.t.x() = -0.1 * static_cast<double>(record.cameras.size() - 1);
    camera.sigma_xi.setConstant(1e-4);
  }
  return record;
}

std::vector<std::string> Names(const std::vector<CalibratedCamera>& cameras) {
  std::vector<std::string> names;
  for (const CalibratedCamera& camera : cameras) names.push_back(camera.name);
  return names;
}

TEST(CompareCalibrations, ComparesCamerasOfEqualNames) {
  const CalibrationRecord a = Cameras({"left", "right", "top"});
  CalibrationRecord b = Cameras({"right", "left", "low"});
  b.cameras[0].params[0] = 505;
  const CalibrationComparison comparison = CompareCalibrations(a, b, {});
  EXPECT_THAT(Names(comparison.a), ElementsAre("left", "right"));
  EXPECT_THAT(Names(comparison.b), ElementsAre("left", "right"));
  EXPECT_THAT(comparison.only_a, ElementsAre("top"));
  EXPECT_THAT(comparison.only_b, ElementsAre("low"));
  ASSERT_EQ(comparison.differences.size(), 2);
  EXPECT_EQ(comparison.extrinsics.size(), 1);
  for (const CameraDifference& difference : comparison.differences) {
    ASSERT_EQ(difference.distances.size(), 2);
    EXPECT_EQ(difference.distances[0].distance, 1);
    EXPECT_TRUE(std::isinf(difference.distances[1].distance));
  }
  EXPECT_LT(comparison.differences[0].distances[1].all.rms, 1e-9);
  EXPECT_GT(comparison.differences[1].distances[1].all.rms, 1);
}

TEST(CompareCalibrations, ComparesSingleCamerasWhateverTheirNames) {
  const CalibrationComparison comparison =
      CompareCalibrations(Cameras({"cam"}), Cameras({"camera"}), {2, 3});
  EXPECT_THAT(Names(comparison.a), ElementsAre("cam"));
  EXPECT_THAT(comparison.only_a, IsEmpty());
  EXPECT_THAT(comparison.only_b, IsEmpty());
  EXPECT_EQ(comparison.differences[0].distances.size(), 2);
  EXPECT_EQ(comparison.differences[0].distances[1].distance, 3);
}

TEST(CompareCalibrations, SuggestsAMapWhereNoNameIsEqual) {
  EXPECT_THAT(
      [] {
        CompareCalibrations(Cameras({"left", "right"}), Cameras({"cam0", "cam1"}), {});
      },
      ThrowsMessage<Error>(HasSubstr("--map")));
  EXPECT_THAT(MapSuggestion({"left", "right"}, {"cam0", "cam1"}),
              HasSubstr("--map left=cam0,right=cam1"));
}

TEST(RenameCameras, GivesCounterpartsTheirNames) {
  CalibrationRecord record = Cameras({"cam0", "cam1"});
  RenameCameras({"left=cam1"}, {"left", "right"}, &record);
  EXPECT_THAT(Names(record.cameras), ElementsAre("cam0", "left"));
  EXPECT_THAT([&] { RenameCameras({"left"}, {"left"}, &record); },
              ThrowsMessage<Error>(HasSubstr("left")));
  EXPECT_THAT([&] { RenameCameras({"lft=cam0"}, {"left"}, &record); },
              ThrowsMessage<Error>(HasSubstr("lft")));
  EXPECT_THAT([&] { RenameCameras({"left=cam7"}, {"left"}, &record); },
              ThrowsMessage<Error>(HasSubstr("cam7")));
}

}  // namespace TEST_FILE
}  // namespace plenocal
