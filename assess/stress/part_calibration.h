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
  std::vector<double> degrees;  ///< per camera: degrees of freedom of its covariance's scale
  std::string failure;          ///< why there is none
};

/// Adjusts the used observations of `part` alone, from the optimum of all and with its noise.
/// `go_on`: called in each iteration; false stops (`Stopped` is thrown).
PartCalibration CalibratePart(const Calibration& all,
                              const PartOfObservations& part,
                              Loss loss,
                              const std::function<bool()>& go_on);

/// Lengths of the residuals of some points of a camera.
struct ResidualSum {
  double squares = 0, points = 0;  ///< px^2
  size_t unseen = 0;               ///< outside of the model's domain

  void operator+=(const ResidualSum& other);
  [[nodiscard]] double Rms() const;
};

/// Of the used points.
ResidualSum SumResiduals(const Bundle& bundle, size_t camera);

/// The bundle with the points of `part` alone: cameras and markers of `trained`, poses from these
/// points.
Bundle WithOwnPoses(const Bundle& trained, const Bundle& all, const PartOfObservations& part);

}  // namespace plenocal
