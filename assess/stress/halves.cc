// SPDX-License-Identifier: Apache-2.0
#include "assess/stress/halves.h"

#include <algorithm>
#include <cmath>
#include <set>
#include <span>
#include <vector>

#include "assess/projection.h"
#include "calib/adjust/poses.h"
#include "calib/base/statistics.h"
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

// Of so large a difference of a camera's parameters between both halves by errors alone, the
// difference by a Gauss-Newton step of each half from the optimum of all: there, parameters that
// points hardly determine have no curvature. At that optimum the gradients of all points and of
// priors add up to zero.
double ProbabilityOfDifference(const std::array<PartCalibration, 2>& halves, size_t camera) {
  const auto& [a, b] = halves;
  const Uncertainty &of_a = a.at_optimum_of_all, &of_b = b.at_optimum_of_all;
  std::set<int> indices(of_a.param_index[camera].begin(), of_a.param_index[camera].end());
  indices.erase(-1);
  const std::vector<int> own(indices.begin(), indices.end());
  const Eigen::VectorXd difference =
      of_b.covariance * of_a.frames_gradient - of_a.covariance * of_b.frames_gradient;
  const Eigen::MatrixXd covariance =
      a.factors[camera] * of_a.covariance + b.factors[camera] * of_b.covariance;
  const Eigen::MatrixXd root = InverseRoot(Eigen::MatrixXd(covariance(own, own)));
  const auto rank = static_cast<double>(root.cols());
  return FTail((root.transpose() * difference(own)).squaredNorm() / rank,
               rank,
               std::min(a.degrees[camera], b.degrees[camera]));
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
  test->difference = SupportedDifference(a, b, cameras);
  test->predicted = std::hypot(SupportedSigma(a, cameras), SupportedSigma(b, cameras));
  test->factor = std::hypot(RmsPredicted(a, all.bundle, second, camera),
                            RmsPredicted(b, all.bundle, first, camera)) /
                 std::hypot(RmsResidual(halves[0].calibration.bundle, camera),
                            RmsResidual(halves[1].calibration.bundle, camera));
  test->probability = ProbabilityOfDifference(halves, camera);
}

}  // namespace plenocal
