// SPDX-License-Identifier: Apache-2.0
#include "assess/views/pose_errors.h"

#include "assess/views/view_information.h"
#include "calib/base/linear_algebra.h"

namespace plenocal {

std::map<int, PoseErrors> ComputePoseErrors(const CalibrationRecord& calibration) {
  const CalibratedViews views(calibration);
  // A root of the unknowns' covariance: its columns are independent errors.
  const SymmetricEigen spectrum = DecomposeSymmetric(views.Predictor().InformationSoFar());
  const Eigen::MatrixXd root = views.Factors().asDiagonal() * spectrum.vectors *
                               spectrum.values.cwiseInverse().cwiseSqrt().asDiagonal();
  std::map<int, PoseErrors> errors;
  views.Predictor().ForFrames([&](const ViewPredictor::FrameInformation& frame) {
    errors[frame.frame] = {frame.pose_covariance, frame.pose_by_unknowns * root};
  });
  return errors;
}

}  // namespace plenocal
