// SPDX-License-Identifier: Apache-2.0
#include "assess/residual_field.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>

namespace plenocal {
namespace TEST_FILE {

ResidualRow Row(double x, double y, const Eigen::Vector2d& residual) {
  ResidualRow row;
  row.values = {x, y};
  row.residual = {residual.x(), residual.y()};
  return row;
}

CalibratedCamera Camera() {
  CalibratedCamera camera;
  camera.image_size = {400, 200};
  camera.fit.noise_sigma = 0.25;
  return camera;
}

TEST(ResidualField, HasMeansOfItsCells) {
  CalibratedCamera camera = Camera();
  camera.residuals = {Row(5, 5, {0.5, -1}),
                      Row(10, 15, {1.5, 3}),
                      Row(12, 12, {100, 100}),
                      Row(395, 195, {-0.5, 0})};
  camera.residuals[1].noise_sigma = 0.5;
  camera.residuals[2].used = false;
  const ResidualField field = MakeResidualField(camera);
  ASSERT_EQ(field.grid.Columns(), 20);
  ASSERT_EQ(field.grid.Rows(), 10);
  EXPECT_EQ(field.points[0], 2);
  EXPECT_EQ(field.mean[0], Eigen::Vector2d(1, 1));
  EXPECT_EQ(field.square[0], (1.25 + 11.25) / 2);
  EXPECT_EQ(field.variance_of_mean[0], (0.0625 + 0.25) / 4);
  EXPECT_EQ(field.points[199], 1);
  EXPECT_EQ(field.mean[199], Eigen::Vector2d(-0.5, 0));
  EXPECT_EQ(field.square[199], 0.25);
  EXPECT_EQ(field.variance_of_mean[199], 0.0625);
  EXPECT_EQ(field.points[1], 0);
  EXPECT_EQ(field.square[1], 0);
  // Two points of mean (1, 1) and one of (-0.5, 0), less the noise of the means.
  EXPECT_NEAR(field.Pattern(), std::sqrt((2 * (1 - 0.3125 / 4) + (0.125 - 0.0625)) / 3), 1e-12);
}

// RMS of a coordinate of the error of the model, whatever the noise.
TEST(ResidualField, PatternIsWhatNoiseDoesNotContribute) {
  std::mt19937 random(1);
  std::normal_distribution<double> normal(0, 0.25);
  std::uniform_real_distribution<double> uniform(0, 1);
  for (const double error : {0.0, 0.1, 0.5}) {
    CalibratedCamera camera = Camera();
    for (int i = 0; i < 20000; ++i) {
      const double x = 400 * uniform(random), y = 200 * uniform(random);
      const double noise_x = normal(random), noise_y = normal(random);
      camera.residuals.push_back(Row(x, y, {error + noise_x, -error + noise_y}));
    }
    EXPECT_NEAR(MakeResidualField(camera).Pattern(), error, 0.01);
  }
  EXPECT_EQ(MakeResidualField(Camera()).Pattern(), 0);
}

}  // namespace TEST_FILE
}  // namespace plenocal
