// SPDX-License-Identifier: Apache-2.0
#include "detectors/plenoptic/markers/aperture_shape.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

namespace plenocal::internal {
namespace TEST_FILE {

TEST(ApertureShape, IsThatOfACutDisc) {
  EXPECT_EQ(ApertureShape(1), 0);
  EXPECT_EQ(ApertureShape(1.01), 0);
  for (const double d : {0.4, 0.6, 0.8, 0.95}) {
    const double segment = (std::acos(d) - d * std::sqrt(1 - d * d)) / std::numbers::pi;
    EXPECT_NEAR(ApertureShape(1 - segment), 4.0 / 3 * (1 - d * d), 0.02) << d;
  }
}

}  // namespace TEST_FILE
}  // namespace plenocal::internal
