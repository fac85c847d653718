// SPDX-License-Identifier: Apache-2.0
#include "assess/projection.h"

#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <limits>
#include <vector>

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

TEST(ImageCovariance, IsThatOfTheParametersToFirstOrder) {
  Eigen::Matrix3d C;
  C << 4, 1, 0.5, 1, 9, -2, 0.5, -2, 16;
  CalibratedCamera camera;
  camera.covariance = C;
  const ImageCovariance covariance(camera);
  Eigen::Matrix<double, 2, 3> J;
  J << 1, 2, 0, -1, 0.5, 3;
  EXPECT_LT((covariance.Propagate(J, {}) - J * C * J.transpose()).norm(), 1e-12);
  // By some parameters alone.
  const std::vector<size_t> support{2, 0};
  const Eigen::Matrix2d some = (Eigen::Matrix2d() << 16, 0.5, 0.5, 4).finished(),
                        by = J.leftCols<2>();
  EXPECT_LT((covariance.Propagate(by, support) - by * some * by.transpose()).norm(), 1e-12);
}

TEST(ImageCovariance, IsInfiniteWhereAnOpenParameterHasAnEffect) {
  constexpr double kInfinite = std::numeric_limits<double>::infinity();
  CalibratedCamera camera;
  camera.covariance = Eigen::Vector3d(4, kInfinite, 16).asDiagonal();
  camera.covariance(0, 1) = camera.covariance(1, 2) = std::nan("");  // are not to be read
  const ImageCovariance covariance(camera);
  Eigen::Matrix<double, 2, 3> J;
  J << 1, 0, 2, 3, -0.5, 0;
  const Eigen::MatrixXd all = covariance.Propagate(J, {});
  EXPECT_EQ(all(0, 0), 4 + 4 * 16);
  EXPECT_EQ(all(1, 1), kInfinite);
  EXPECT_EQ(all(0, 1), 3 * 4);
  const Eigen::MatrixXd some = covariance.Propagate(J.leftCols<2>(), {2, 1});
  EXPECT_EQ(some(0, 0), 16);
  EXPECT_EQ(some(1, 1), kInfinite) << "the second of these is open";
  EXPECT_EQ(covariance.Propagate(J.leftCols<2>(), {2, 0})(1, 1), 9 * 16 + 0.25 * 4);
}

}  // namespace TEST_FILE
}  // namespace plenocal::testing
