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

}  // namespace TEST_FILE
}  // namespace plenocal::testing
