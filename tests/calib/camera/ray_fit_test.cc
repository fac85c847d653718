// SPDX-License-Identifier: Apache-2.0
#include "calib/camera/ray_fit.h"

#include <gmock/gmock.h>

#include "models/registry.h"

namespace plenocal::testing {
namespace TEST_FILE {

const std::vector<double> kParams{500, 505, 322, 238, -0.2, 0.05, 1e-3, -2e-3};

// Directions over the image of a camera with the parameters above, and their places there.
class RayFit : public ::testing::Test {
 protected:
  RayFit() {
    for (int row = -4; row <= 4; ++row) {
      for (int column = -5; column <= 5; ++column) {
        const Eigen::Vector3d direction(0.1 * column, 0.09 * row, 1);
        Eigen::Vector2d u;
        EXPECT_TRUE(model_.Project(kParams.data(), nullptr, nullptr, direction, u.data()));
        directions_.push_back(direction);
        image_.push_back(u);
      }
    }
  }

  const CameraModel& model_ = *FindModel(CameraModels(), "pinhole-radtan4");
  const std::vector<double> start_{450, 450, 300, 250, 0, 0, 0, 0};
  std::vector<Eigen::Vector3d> directions_;
  std::vector<Eigen::Vector2d> image_;
};

TEST_F(RayFit, FindsTheParameters) {
  std::vector<double> params = start_;
  ASSERT_TRUE(FitToRays(model_, {}, directions_, image_, {.tolerance = 1e-15}, &params));
  for (size_t k = 0; k < params.size(); ++k) EXPECT_NEAR(params[k], kParams[k], 1e-6) << k;
}

TEST_F(RayFit, KeepsWhatIsFixed) {
  std::vector<double> params = start_;
  params[1] = 505;
  params[6] = 1e-3;
  ASSERT_TRUE(
      FitToRays(model_, {}, directions_, image_, {.fixed = {1, 6}, .tolerance = 1e-15}, &params));
  EXPECT_EQ(params[1], 505);
  EXPECT_EQ(params[6], 1e-3);
  for (size_t k = 0; k < params.size(); ++k) EXPECT_NEAR(params[k], kParams[k], 1e-6) << k;
  params = start_;
  EXPECT_FALSE(
      FitToRays(model_, {}, directions_, image_, {.fixed = {0, 1, 2, 3, 4, 5, 6, 7}}, &params));
  EXPECT_EQ(params, start_);
}

TEST_F(RayFit, NeedsAsManyDirectionsAsParameters) {
  std::vector<double> params = start_;
  directions_.resize(8);
  image_.resize(8);
  EXPECT_TRUE(FitToRays(model_, {}, directions_, image_, {}, &params));
  directions_.resize(7);
  image_.resize(7);
  params = start_;
  EXPECT_FALSE(FitToRays(model_, {}, directions_, image_, {}, &params));
  EXPECT_EQ(params, start_);
}

TEST_F(RayFit, DoesNotCountWhatIsNotImaged) {
  // Behind the camera, with places that no parameters explain.
  for (int i = 0; i < 10; ++i) {
    directions_.emplace_back(0.1 * i, 0.2, -1);
    image_.emplace_back(1000, 1000);
  }
  std::vector<double> params = start_;
  ASSERT_TRUE(FitToRays(model_, {}, directions_, image_, {.tolerance = 1e-15}, &params));
  for (size_t k = 0; k < params.size(); ++k) EXPECT_NEAR(params[k], kParams[k], 1e-6) << k;
}

TEST_F(RayFit, StaysWithinTheBounds) {
  const CameraModel& pinhole = *FindModel(CameraModels(), "pinhole");
  ASSERT_GE(pinhole.params[0].lower, 0);
  for (size_t i = 0; i < image_.size(); ++i) {
    // Mirrored: f_x is -300.
    image_[i] = {320 - 300 * directions_[i].x(), 240 + 300 * directions_[i].y()};
  }
  const std::vector<double> start{100, 250, 310, 230};
  std::vector<double> free = start, bounded = start;
  ASSERT_TRUE(FitToRays(pinhole, {}, directions_, image_, {.max_iterations = 300}, &free));
  EXPECT_NEAR(free[0], -300, 1e-3);
  FitToRays(
      pinhole, {}, directions_, image_, {.within_bounds = true, .max_iterations = 300}, &bounded);
  EXPECT_GT(bounded[0], 0);
  EXPECT_LT(bounded[0], 100);
}

}  // namespace TEST_FILE
}  // namespace plenocal::testing
