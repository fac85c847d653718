// SPDX-License-Identifier: Apache-2.0
//
// Calibrations from a part of the observations of a finished one.
#pragma once

#include <functional>
#include <string>
#include <vector>

#include "calib/estimate/calibrate.h"

namespace plenocal {

/// Fewer points of a camera are no calibration, and no test of one.
inline constexpr size_t kFewestPartPoints = 30;

/// Per observation of a bundle: whether it belongs to a part.
using PartOfObservations = std::vector<bool>;

/// A calibration from a part of the observations. Its covariance has the scatter of its frames and
/// markers as `Calibrate` finds it, significant or not.
struct PartCalibration {
  Calibration calibration;
  /// Of the observations of the part at the optimum of all, without scatter.
  Uncertainty at_optimum_of_all;
  /// Per camera: the factor on its covariance, and degrees of freedom of that.
  std::vector<double> factors, degrees;
  std::string failure;  ///< why there is none
};

/// Adjusts the used observations of `part` alone, from the optimum of all and with its noise.
/// `go_on`: called in each iteration; false stops (`Stopped` is thrown).
PartCalibration CalibratePart(const Calibration& all,
                              const PartOfObservations& part,
                              Loss loss,
                              const std::function<bool()>& go_on);

/// Uses the observations of `part` that are used in `all`, of frames that have enough for a pose.
void UsePart(const Bundle& all, const PartOfObservations& part, Bundle* bundle);

/// RMS length of the residuals of a camera's used points that project, px.
double RmsResidual(const Bundle& bundle, size_t camera);

}  // namespace plenocal
