// SPDX-License-Identifier: Apache-2.0
#include "assess/stress/halves.h"

#include <algorithm>
#include <cmath>
#include <span>

#include "assess/projection.h"
#include "calib/adjust/poses.h"
#include "calib/base/statistics.h"
#include "calib/estimate/describe.h"
#include "calib/noise/matrix_root.h"

namespace plenocal {
namespace {

// The half with points and poses of all, to compare both halves at the same places and distances.
Calibration AtPointsOf(const Calibration& all, const Calibration& half) {
  Calibration result = half;
  result.bundle.observations = all.bundle.observations;
  result.bundle.T_rig_target = all.bundle.T_rig_target;
  return result;
}

// RMS residual of the points of `part`, whose frames get poses and nothing else.
double RmsPredicted(const Calibration& trained,
                    const Bundle& all,
                    const PartOfObservations& part,
                    size_t camera) {
  Bundle bundle = all;
  bundle.cameras = trained.bundle.cameras;
  UsePart(all, part, &bundle);
  AdjustPoses(&bundle, std::vector<bool>(bundle.T_rig_target.size(), true));
  return RmsResidual(bundle, camera);
}

}  // namespace

void CompareHalves(const Calibration& all,
                   const PartOfObservations& first,
                   const std::array<PartCalibration, 2>& halves,
                   size_t camera,
                   StressTest* test) {
  const std::span cameras(&camera, 1);
  PartOfObservations second = first;
  second.flip();
  const Calibration a = AtPointsOf(all, halves[0].calibration),
                    b = AtPointsOf(all, halves[1].calibration);
  const CalibratedCamera of_a = DescribeCamera(a, camera), of_b = DescribeCamera(b, camera);
  if (!of_a.covariance.allFinite() || !of_b.covariance.allFinite()) {
    test->failure = "a half leaves parameters open";
    return;
  }
  test->difference = SupportedDifference(a, b, cameras);
  test->predicted = std::hypot(SupportedSigma(a, cameras), SupportedSigma(b, cameras));
  test->factor = std::hypot(RmsPredicted(a, all.bundle, second, camera),
                            RmsPredicted(b, all.bundle, first, camera)) /
                 std::hypot(RmsResidual(halves[0].calibration.bundle, camera),
                            RmsResidual(halves[1].calibration.bundle, camera));
  const auto count = static_cast<Eigen::Index>(of_a.params.size());
  const Eigen::VectorXd difference = Eigen::VectorXd::Map(of_b.params.data(), count) -
                                     Eigen::VectorXd::Map(of_a.params.data(), count);
  const Eigen::MatrixXd root = InverseRoot(of_a.covariance + of_b.covariance);
  const auto rank = static_cast<double>(root.cols());
  test->probability = FTail((root.transpose() * difference).squaredNorm() / rank,
                            rank,
                            std::min(halves[0].degrees[camera], halves[1].degrees[camera]));
}

}  // namespace plenocal
