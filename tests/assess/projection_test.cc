// SPDX-License-Identifier: Apache-2.0
#include "assess/projection.h"

#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <limits>
#include <set>
#include <utility>
#include <vector>

#include "assess/compare.h"
#include "assess/views/rig_estimate.h"
#include "calib/estimate/describe.h"
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

using Cells = std::set<std::pair<int, int>>;  // column and row

// RMS over cells of the compared grid at the distances between which four fifths of the points lie.
double SigmaInCells(const Calibration& calibration, const Cells& cells) {
  const CalibratedCamera camera = DescribeCamera(calibration, 0);
  CalibratedCamera exact = camera;
  exact.covariance.setZero();
  const std::vector<double> sorted = PointDistances(calibration.bundle, 0);
  const size_t tenth = sorted.size() / 10;
  double sum = 0, count = 0;
  for (const DistanceDifference& at :
       CompareCameras(camera, exact, {sorted[tenth], sorted[sorted.size() - 1 - tenth]})
           .distances) {
    for (const PixelDifference& pixel : at.pixels) {
      const Eigen::Vector2d cell = (pixel.u_px.array() + 0.5) /
                                   Eigen::Array2d(camera.image_size[0], camera.image_size[1]) *
                                   Eigen::Array2d(kComparedColumns, kComparedRows);
      if (!cells.contains({static_cast<int>(cell.x()), static_cast<int>(cell.y())})) continue;
      sum += pixel.predicted_px * pixel.predicted_px;
      ++count;
    }
  }
  EXPECT_EQ(count, 2 * cells.size());
  return std::sqrt(sum / count);
}

// The calibration with these points alone, px.
Calibration WithPointsAt(Calibration calibration, const std::vector<Eigen::Vector2d>& points) {
  std::vector<BundleObservation>& observations = calibration.bundle.observations;
  const size_t step = observations.size() / points.size();
  for (BundleObservation& each : observations) each.used = false;
  for (size_t i = 0; i < points.size(); ++i) {
    observations[i * step].used = true;
    observations[i * step].seen.values[0] = points[i].x();
    observations[i * step].seen.values[1] = points[i].y();
  }
  return calibration;
}

TEST(SupportedSigma, IsOverCellsWithPointsAndGapsOfTwoCells) {
  const Calibration calibration = Calibrate(MakeProblem(5, {.noise = 0.1}).input, {});
  const ImageSize size = calibration.bundle.cameras[0].image_size;
  const double width = size[0] / double{kComparedColumns}, height = size[1] / double{kComparedRows};
  // Pixels have integers in their middles: the image begins at -0.5.
  const auto at = [&](double column, double row) {
    return Eigen::Vector2d(column * width - 0.5, row * height - 0.5);
  };
  const auto expect = [&](const std::vector<Eigen::Vector2d>& points, const Cells& cells) {
    const std::array<size_t, 1> camera{0};
    const Calibration part = WithPointsAt(calibration, points);
    EXPECT_NEAR(SupportedSigma(part, camera), SigmaInCells(part, cells), 1e-12);
  };
  // On both sides of an edge, outside of the image, and in its last cell.
  expect({at(9.99, 5.5), at(3.5, 7.99)}, {{9, 5}, {3, 7}});
  expect({at(10.01, 5.5), at(3.5, 8.01)}, {{10, 5}, {3, 8}});
  expect({at(-0.5, 5.5), at(3.5, 20.5), at(29.9, 0.1)}, {{0, 5}, {3, 19}, {29, 0}});
  // Gaps of two cells are closed, of three not.
  expect({at(5.5, 5.5), at(8.5, 5.5)}, {{5, 5}, {6, 5}, {7, 5}, {8, 5}});
  expect({at(5.5, 5.5), at(5.5, 8.5)}, {{5, 5}, {5, 6}, {5, 7}, {5, 8}});
  expect({at(5.5, 5.5), at(9.5, 5.5)}, {{5, 5}, {9, 5}});
  expect({at(28.5, 5.5), at(1.5, 6.5)}, {{28, 5}, {1, 6}});
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
