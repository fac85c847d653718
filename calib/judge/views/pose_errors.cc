// SPDX-License-Identifier: Apache-2.0
#include "calib/judge/views/pose_errors.h"

#include "calib/base/linear_algebra.h"
#include "calib/judge/views/view_information.h"

namespace plenocal {

std::map<int, PoseErrors> ErrorsOfPoses(const CalibrationRecord& calibration) {
  RigKnowledge rig = KnowledgeOf(calibration);
  ViewTarget target;
  for (const auto& [number, marker] : calibration.markers) target.markers[number] = marker.position;
  SetFactors(calibration, target, &rig);
  const std::vector<double> distances = DistancesOfPoints(rig.bundle, 0);
  const RigUnknowns unknowns =
      UnknownsOf(rig.bundle, distances.empty() ? 1 : distances[distances.size() / 2]);
  const ViewPredictor predictor(rig, unknowns, target);
  // A root of the unknowns' covariance: its columns are independent errors.
  const Eigen::VectorXd factors = ScaleOf(rig, unknowns).cwiseQuotient(unknowns.unit);
  const SymmetricEigen spectrum = DecomposeSymmetric(predictor.InformationSoFar());
  const Eigen::MatrixXd root = factors.asDiagonal() * spectrum.vectors *
                               spectrum.values.cwiseInverse().cwiseSqrt().asDiagonal();
  std::map<int, PoseErrors> errors;
  predictor.ForFrames([&](const ViewPredictor::OfFrame& frame) {
    errors[frame.frame] = {frame.pose_covariance, frame.pose_by_unknowns * root};
  });
  return errors;
}

}  // namespace plenocal
