// SPDX-License-Identifier: Apache-2.0
#include "calib/estimate/fit.h"

#include <gtest/gtest.h>

#include <cmath>
#include <vector>

#include "models/registry.h"

namespace plenocal {
namespace TEST_FILE {

// Two pinhole cameras in one place, three frames at the origin.
class FitOfACamera : public ::testing::Test {
 protected:
  FitOfACamera() {
    for (const char* name : {"left", "right"}) {
      bundle_.cameras.push_back({.name = name,
                                 .image_size = {640, 480},
                                 .model = FindModel(CameraModels(), "pinhole"),
                                 .config = {},
                                 .params = {400, 400, 320, 240},
                                 .fixed = std::vector<bool>(4, true),
                                 .T_camera_rig = {}});
    }
    bundle_.T_rig_target.resize(3);
    bundle_.markers.resize(2);
    bundle_.markers[0].position = {0.1, -0.2, 2};
    bundle_.markers[1].position = {0.1, -0.2, -2};  // behind
  }
  // Of the first marker, this far from its image.
  void Add(int camera, int frame, double dx, double dy, bool used, int lens_type = 0) {
    BundleObservation& each = bundle_.observations.emplace_back();
    each.camera = camera;
    each.frame = frame;
    each.seen.values = {340 + dx, 200 + dy};
    each.seen.lens_type = lens_type;
    each.used = used;
  }

  Bundle bundle_;
};

TEST_F(FitOfACamera, IsThatOfItsUsedPoints) {
  Add(0, 0, 3, 4, true);
  Add(0, 0, 0, 2, true, 1);
  Add(0, 2, 6, 8, false);
  Add(0, 2, 0, 0, false);
  bundle_.observations.back().marker = 1;  // is not imaged at all
  Add(1, 1, 1, 0, true);
  const CameraFit fit = MeasureFit(bundle_, 0, {.typical = 0.25, .stated = true});
  EXPECT_EQ(fit.points, 2);
  EXPECT_EQ(fit.rejected, 2);
  EXPECT_EQ(fit.views, 1);
  EXPECT_DOUBLE_EQ(fit.rms, std::sqrt((25 + 4) / 2.0));
  EXPECT_DOUBLE_EQ(fit.rms_all, std::sqrt((25 + 4 + 100) / 3.0));
  ASSERT_EQ(fit.lens_types.size(), 2U);
  EXPECT_DOUBLE_EQ(fit.lens_types.at(0).rms, 5);
  EXPECT_DOUBLE_EQ(fit.lens_types.at(1).rms, 2);
  EXPECT_EQ(fit.lens_types.at(1).points, 1);
  EXPECT_EQ(fit.detector_sigma, 0.25);
  EXPECT_EQ(fit.noise_sigma, bundle_.cameras[0].noise.Sigma(0.25));
  const CameraFit other = MeasureFit(bundle_, 1, {.typical = 0.25, .stated = false});
  EXPECT_DOUBLE_EQ(other.rms, 1);
  EXPECT_TRUE(other.lens_types.empty()) << "one type";
  EXPECT_EQ(other.detector_sigma, 0);
}

TEST_F(FitOfACamera, IsZeroWithoutPoints) {
  const CameraFit fit = MeasureFit(bundle_, 0, {});
  EXPECT_EQ(fit.points, 0);
  EXPECT_EQ(fit.rms, 0);
  EXPECT_EQ(fit.rms_all, 0);
}

}  // namespace TEST_FILE
}  // namespace plenocal
