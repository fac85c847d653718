// SPDX-License-Identifier: Apache-2.0
#include "calib/traits/lattice_shift.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <vector>

namespace plenocal {
namespace TEST_FILE {

using ::testing::HasSubstr;

LatticeShift Image(double x, double sigma) {
  return {
      .value = {x, 0.02, -0.1, 0.04}, .sigma = sigma * Eigen::Vector4d(1, 1, 1, 2), .corner = 500};
}

TEST(LatticeShift, IsTheWeightedMeanOfTheImagesThatHaveOne) {
  const std::vector<LatticeShift> images{Image(0.3, 0.01), {}, Image(0.33, 0.02), {}};
  const auto shift = SignificantShift(images);
  ASSERT_TRUE(shift);
  EXPECT_NEAR(shift->value[0], (4 * 0.3 + 0.33) / 5, 1e-12);
  EXPECT_NEAR(shift->value[2], -0.1, 1e-12);
  EXPECT_EQ(shift->corner, 500);
  // Of x by the scatter, 1.8 a degree of freedom; of the others, which agree, as they state it.
  EXPECT_NEAR(shift->sigma[0], 0.01 * std::sqrt(1.8 / 1.25), 1e-12);
  EXPECT_NEAR(shift->sigma[2], 0.01 / std::sqrt(1.25), 1e-12);
  EXPECT_NEAR(shift->Largest(), std::hypot(0.306, 0.02) + std::hypot(0.1, 0.04), 1e-12);
}

TEST(LatticeShift, OfOneImageHasItsSigma) {
  const std::vector<LatticeShift> images{Image(0.3, 0.01)};
  EXPECT_EQ(SignificantShift(images)->sigma, images[0].sigma);
}

TEST(LatticeShift, IsNoneWhereItIsChanceOrSmall) {
  EXPECT_FALSE(SignificantShift({}));
  const std::vector<LatticeShift> none(3), chance{Image(0.3, 0.061)}, sure{Image(0.3, 0.059)};
  EXPECT_FALSE(SignificantShift(none));
  EXPECT_FALSE(SignificantShift(chance));
  EXPECT_TRUE(SignificantShift(sure));
  // Images that differ by more than their sigmas.
  const std::vector<LatticeShift> differ{Image(0.9, 0.01), Image(-0.3, 0.01)};
  LatticeShift small = Image(0.03, 1e-4);
  small.value.tail<3>().setZero();
  const std::vector<LatticeShift> one{small};
  EXPECT_FALSE(SignificantShift(one));
  const auto of_both = SignificantShift(differ);
  ASSERT_TRUE(of_both) << "of the pitch";
  EXPECT_NEAR(of_both->sigma[0], 0.6, 1e-3);
}

TEST(LatticeShift, TextHasTheChangeOfPitchAndTheRotation) {
  const std::string text = ShiftText(Image(0.3, 0.01));
  EXPECT_THAT(text, HasSubstr("up to 0.41 px"));
  EXPECT_THAT(text, HasSubstr("pitch -2.0e-04 +- 2.0e-05, rotation +8.0e-05 rad"));
  EXPECT_THAT(text, HasSubstr("displacement +0.30, +0.02 px, each +- "));
}

}  // namespace TEST_FILE
}  // namespace plenocal
