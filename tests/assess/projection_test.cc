// SPDX-License-Identifier: Apache-2.0
#include "assess/projection.h"

#include <gtest/gtest.h>

#include <array>
#include <cmath>

#include "tests/calib/synthetic.h"

namespace plenocal::testing {
namespace TEST_FILE {

// An adjustment that went astray may leave a camera that sees nothing of what the other sees.
TEST(SupportedDifference, IsInfiniteWithoutACommonPixel) {
  const Calibration calibration = Calibrate(MakeProblem(5, {.noise = 0.1}).input, {});
  Calibration astray = calibration;
  astray.bundle.cameras[0].params[2] = 1e6;  // c_x
  astray.bundle.cameras[0].params[0] = 1;    // f_x
  const std::array<size_t, 1> camera{0};
  EXPECT_TRUE(std::isinf(SupportedDifference(calibration, astray, camera)));
  EXPECT_LT(SupportedDifference(calibration, calibration, camera), 1e-9);
}

TEST(UnexplainedDifference, IsWhatStandardErrorsDoNotExplainInTheImageCircle) {
  Calibration calibration = Calibrate(MakeProblem(5, {.noise = 0.1}).input, {});
  const std::array<size_t, 1> camera{0};
  constexpr size_t kA0 = 4;
  const double sigma = calibration.uncertainty.param_std_errors[0][kA0];
  const auto moved_by = [&](double sigmas) {
    Calibration moved = calibration;
    moved.bundle.cameras[0].params[kA0] += sigmas * sigma;
    return UnexplainedDifference(calibration, moved, camera);
  };
  EXPECT_EQ(moved_by(0.5), 0);
  const double whole = moved_by(100);
  EXPECT_GT(whole, 0.1);
  const ImageSize size = calibration.bundle.cameras[0].image_size;
  calibration.bundle.cameras[0].image_circle =
      ImageCircle{{size[0] / 2.0, size[1] / 2.0}, {size[1] / 4.0, size[1] / 4.0}};
  EXPECT_LT(moved_by(100), 0.8 * whole);
}

}  // namespace TEST_FILE
}  // namespace plenocal::testing
