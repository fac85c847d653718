// SPDX-License-Identifier: Apache-2.0
//
// Standard errors of plenoptic cameras whose micro-image centres have errors.
#include "calib/estimate/common_errors.h"

#include <gtest/gtest.h>

#include <cmath>

#include "calib/base/linear_algebra.h"
#include "calib/estimate/calibrate.h"
#include "tests/calib/plenoptic_synthetic.h"
#include "tests/calib/random.h"

namespace plenocal {
namespace TEST_FILE {

using testing::MakePlenopticProblem;
using testing::PlenopticProblem;
using testing::Random;

// Polynomials of degree 3 whose coefficients have errors of 0.06 px.
LatticeErrors LargeErrors(ImageSize image_size) {
  const Eigen::MatrixXd C = 3.6e-3 * Eigen::MatrixXd::Identity(10, 10);
  return {image_size, {C.data(), C.data() + C.size()}};
}

// Moves the micro-image centres of all views by one draw of the errors.
void Displace(const LatticeErrors& errors, Random* random, CameraInput* camera) {
  const Eigen::MatrixXd root = errors.Root();
  const auto draw = [&] { return random->Gaussian(1); };
  const Eigen::MatrixX2d coefficients = root * Eigen::MatrixX2d::NullaryExpr(root.cols(), 2, draw);
  for (View& view : camera->views) {
    for (Observation& seen : view.observations) {
      const Eigen::Vector2d moved =
          coefficients.transpose() * errors.Terms({seen.values[2], seen.values[3]});
      seen.values[2] += moved.x();
      seen.values[3] += moved.y();
    }
  }
}

struct Squares {
  double params = 0;   // chi-square over the number of parameters, mean over the trials
  double markers = 0;  // of single coordinates over their variances
};

Squares MeanSquares(unsigned trials, bool known) {
  Squares mean;
  Random random(9);
  for (unsigned trial = 0; trial < trials; ++trial) {
    PlenopticProblem problem =
        MakePlenopticProblem(trial, {.noise = 0.05, .marker_tolerance = 1e-4, .frames = 8});
    CameraInput& camera = problem.input.cameras[0];
    const LatticeErrors errors = LargeErrors(camera.image_size);
    Displace(errors, &random, &camera);
    if (known) camera.lattice_errors = errors;
    const Calibration calibration = Calibrate(problem.input, {});
    const Uncertainty& uncertainty = calibration.uncertainty;
    const std::vector<int>& index = uncertainty.param_index[0];
    const auto count = std::ssize(problem.params);
    Eigen::VectorXd error(count);
    for (Eigen::Index k = 0; k < count; ++k) {
      const auto i = static_cast<size_t>(k);
      error[k] = calibration.bundle.cameras[0].params[i] - problem.params[i];
      const double variance = uncertainty.covariance(index[i], index[i]);
      EXPECT_NEAR(
          uncertainty.param_std_errors[0][i], std::sqrt(variance), 1e-9 * std::sqrt(variance));
    }
    // Of unit diagonal: variances are up to 1e24 apart.
    const Eigen::MatrixXd C = uncertainty.covariance(index, index);
    const Eigen::VectorXd scale = C.diagonal().cwiseSqrt().cwiseInverse();
    const Eigen::VectorXd z = scale.cwiseProduct(error);
    const Eigen::MatrixXd R = scale.asDiagonal() * C * scale.asDiagonal();
    mean.params += z.dot(SolveSymmetric(R, z)) / static_cast<double>(count) / trials;
    double squares = 0;
    for (size_t m = 0; m < uncertainty.marker_std_errors.size(); ++m) {
      const BundleMarker& marker = calibration.bundle.markers[m];
      squares += (marker.position - problem.markers.at(marker.number))
                     .cwiseQuotient(uncertainty.marker_std_errors[m])
                     .squaredNorm();
    }
    mean.markers += squares / (3.0 * std::ssize(uncertainty.marker_std_errors)) / trials;
  }
  return mean;
}

TEST(LatticeErrors, AreInTheStandardErrors) {
  const Squares with = MeanSquares(40, true), without = MeanSquares(10, false);
  // 99 % of the means of 40 times 9 squares; coordinates of markers are correlated.
  EXPECT_GT(with.params, 0.82);
  EXPECT_LT(with.params, 1.20);
  EXPECT_GT(with.markers, 0.8);
  EXPECT_LT(with.markers, 1.25);
  EXPECT_GT(without.params, 2);
  EXPECT_GT(without.markers, with.markers);
}

}  // namespace TEST_FILE
}  // namespace plenocal
