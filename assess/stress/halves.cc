// SPDX-License-Identifier: Apache-2.0
#include "assess/stress/halves.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "assess/projection.h"
#include "calib/base/linear_algebra.h"
#include "calib/base/statistics.h"
#include "calib/estimate/describe.h"
#include "calib/noise/matrix_root.h"

namespace plenocal {
namespace {

// Of the difference between two estimates of the same parameters.
double ProbabilityOfDifference(const CalibratedCamera& a,
                               const CalibratedCamera& b,
                               double degrees) {
  Eigen::VectorXd difference(std::ssize(a.params));
  for (size_t k = 0; k < a.params.size(); ++k) {
    difference[static_cast<Eigen::Index>(k)] = b.params[k] - a.params[k];
  }
  const Eigen::MatrixXd root = InverseRoot(a.covariance + b.covariance);
  const auto count = static_cast<double>(root.cols());
  return FTail((root.transpose() * difference).squaredNorm() / count, count, degrees);
}

// Over the same positions in the image and distances for both halves.
Calibration AtPointsOf(const Calibration& all, const Calibration& half) {
  Calibration result = half;
  result.bundle.observations = all.bundle.observations;
  result.bundle.T_rig_target = all.bundle.T_rig_target;
  return result;
}

}  // namespace

void CompareHalves(const Calibration& all,
                   const PartOfObservations& first,
                   const std::array<PartCalibration, 2>& halves,
                   size_t camera,
                   StressTest* test) {
  const std::array<size_t, 1> cameras{camera};
  std::array<Calibration, 2> at_points;
  std::array<CalibratedCamera, 2> described;
  std::array<double, 2> sigmas{};
  ResidualSum own, others;
  for (size_t h = 0; h < 2; ++h) {
    described[h] = DescribeCamera(halves[h].calibration, camera);
    if (!described[h].covariance.allFinite()) {
      test->failure = "a half leaves parameters open";
      return;
    }
    at_points[h] = AtPointsOf(all, halves[h].calibration);
    sigmas[h] = SupportedSigma(at_points[h], cameras);
    own += SumResiduals(halves[h].calibration.bundle, camera);
    PartOfObservations other = first;
    if (h == 0) other.flip();
    others +=
        SumResiduals(WithOwnPoses(halves[h].calibration.bundle, all.bundle, other), camera);
  }
  test->points = static_cast<size_t>(others.points);
  test->factor = others.Rms() / own.Rms();
  test->difference = SupportedDifference(at_points[0], at_points[1], cameras);
  test->predicted = std::hypot(sigmas[0], sigmas[1]);
  test->ratio = test->difference / (sigmas[0] + sigmas[1]);
  test->probability = ProbabilityOfDifference(
      described[0],
      described[1],
      std::min(halves[0].degrees[camera], halves[1].degrees[camera]));
}

}  // namespace plenocal
