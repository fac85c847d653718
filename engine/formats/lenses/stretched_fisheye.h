// SPDX-License-Identifier: Apache-2.0
//
// Scaramuzza's camera as OCamCalib and MATLAB hold it: polynomial in pixels, and a 2 x 2 stretch
// from the sensor to the image.
#pragma once

#include <string>
#include <string_view>

#include "calib/files/calibration_record.h"

namespace plenocal {

/// A point (x, y) of the sensor, px, rho^2 = x^2 + y^2, is seen in the direction
/// (x, y, a_0 + a_2 rho^2 + a_3 rho^3 + a_4 rho^4) and imaged at stretch (x, y) + centre.
struct StretchedFisheye {
  std::array<double, 4> a{};  ///< a_0 a_2 a_3 a_4
  Eigen::Matrix2d stretch = Eigen::Matrix2d::Identity();
  Eigen::Vector2d centre{0, 0};  ///< (0, 0) is the centre of the first pixel
};

/// The camera `scaramuzza`, with `+skew` where the stretch has one. The rotation in the stretch
/// turns the camera about its axis.
CalibratedCamera FromStretched(const StretchedFisheye& fisheye,
                               ImageSize image_size,
                               const std::string& where);

/// The inverse, with a stretch that is upper triangular and 1 at (`unit`, `unit`). Throws `Error`
/// of kind kJob for another model.
StretchedFisheye ToStretched(const CalibratedCamera& camera,
                             std::string_view tool,
                             Eigen::Index unit);

}  // namespace plenocal
