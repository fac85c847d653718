// SPDX-License-Identifier: Apache-2.0
#include "assess/frames/frame_influence.h"

#include <Eigen/Cholesky>
#include <cmath>

#include "assess/views/view_information.h"
#include "calib/base/linear_algebra.h"

namespace plenocal {

std::vector<FrameInfluence> FrameInfluences(const CalibrationRecord& calibration) {
  const CalibratedViews views(calibration);
  const RigUnknowns& unknowns = views.Unknowns();
  const Eigen::MatrixXd all = views.Predictor().InformationSoFar();
  const Eigen::VectorXd sigma = Inverse(all).diagonal().cwiseSqrt().cwiseProduct(views.Factors());
  std::vector<FrameInfluence> influences;
  views.Predictor().ForFrames([&](const ViewPredictor::FrameInformation& frame) {
    const Eigen::VectorXd change = (all - frame.information).ldlt().solve(frame.gradient);
    FrameInfluence influence{.frame = frame.frame, .sigmas = 0, .unknown = {}};
    for (Eigen::Index k = 0; k < unknowns.head; ++k) {
      const double sigmas = std::abs(change[k]) / sigma[k];
      if (!(sigmas > influence.sigmas)) continue;
      influence.sigmas = sigmas;
      influence.unknown = unknowns.names[static_cast<size_t>(k)];
    }
    influences.push_back(std::move(influence));
  });
  return influences;
}

}  // namespace plenocal
