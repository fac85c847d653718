// SPDX-License-Identifier: Apache-2.0
#include "engine/suggest/read_rig_estimate.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>

#include "calib/camera/micro_lens_array.h"
#include "calib/estimate/calibrate.h"
#include "calib/estimate/describe.h"
#include "tests/calib/plenoptic_synthetic.h"
#include "tests/refusal.h"
#include "tests/temporary_folder.h"

namespace plenocal {
namespace TEST_FILE {

using ReadRigEstimate = testing::InTemporaryFolder;

TEST_F(ReadRigEstimate, OfAPlenopticCameraHasTheMicroLensesInTheFolder) {
  const auto problem = testing::MakePlenopticProblem(1, {.noise = 0.1, .frames = 6});
  CalibrationRecord record = Describe(Calibrate(problem.input, {}));
  ViewTarget target;
  for (const auto& [number, marker] : record.markers) target.markers[number] = marker.position;
  EXPECT_TRUE(MakeRigEstimate(folder_, record, target).lenses[0].lenses.empty());

  CalibratedCamera& camera = record.cameras[0];
  camera.micro_lenses = "micro_lenses_cam0.csv";
  EXPECT_THAT(testing::RefusalOf([&] { MakeRigEstimate(folder_, record, target); }),
              ::testing::HasSubstr("micro_lenses_cam0.csv"));
  MicroLensArray array;
  array.image_size = camera.image_size;
  array.types = 1;
  constexpr double kPitch = 25;
  for (int row = 1; row * kPitch < camera.image_size[1]; ++row) {
    for (int column = 1; column * kPitch < camera.image_size[0]; ++column) {
      array.lenses.push_back(
          {.row = row, .column = column, .centre = {kPitch * column, kPitch * row}});
    }
  }
  Write(camera.micro_lenses, FormatMicroLenses(array));
  const RigEstimate rig = MakeRigEstimate(folder_, record, target);
  ASSERT_EQ(rig.lenses.size(), 1U);
  ASSERT_EQ(rig.lenses[0].lenses.size(), array.lenses.size());
  EXPECT_NEAR(rig.lenses[0].Pitch(), kPitch, 1e-6);
  EXPECT_GE(rig.factors[0], 1);
}

}  // namespace TEST_FILE
}  // namespace plenocal
