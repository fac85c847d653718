// SPDX-License-Identifier: Apache-2.0
//
// Directions of the unknowns that only the noise of poses seems to determine. Rotations about one
// axis leave a translation open, but estimated poses have noise, and about other axes they turn by
// it: the normal matrix has information on that translation that there is not.
#pragma once

#include <Eigen/Core>
#include <functional>
#include <string>
#include <vector>

#include "calib/files/calibration_record.h"

namespace plenocal {

/// Normal matrix at an estimate, and samples of the part of it that the poses' noise makes.
struct NoisyInformation {
  Eigen::MatrixXd information;
  std::vector<Eigen::MatrixXd> of_noise;
};

/// `information_at(sample, sign)`: normal matrix with the poses moved from their estimate by `sign`
/// (1 or -1) times the random errors number `sample`. The mean of both less that at the estimate is
/// of second order in the errors, as the noise's part is.
NoisyInformation SampleNoise(
    Eigen::MatrixXd information,
    const std::function<Eigen::MatrixXd(unsigned sample, double sign)>& information_at);

struct DeterminedPart {
  Eigen::MatrixXd covariance;  ///< zero along `open`
  /// Columns: open directions, in which as few unknowns take part as the noise allows.
  Eigen::MatrixXd open;
};

/// Separates what motion determines from what noise does. `unit`: natural size of each unknown.
/// With I the information along a direction and N the noise's part of it, the direction is open
/// where I is not significantly larger than N; the variance of others is I / (I - N)^2, as that of
/// a regression whose abscissae have errors (Fuller, Measurement Error Models, 1987, eq. 1.2.22).
DeterminedPart Separate(const NoisyInformation& noisy, const Eigen::VectorXd& unit);

/// The unknowns with a tenth or more of the largest part of a direction, in natural units.
OpenDirection Describe(const Eigen::VectorXd& direction,
                       double sigma,
                       const std::vector<std::string>& names);

}  // namespace plenocal
