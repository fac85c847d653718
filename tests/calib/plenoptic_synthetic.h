// SPDX-License-Identifier: Apache-2.0
//
// Calibration problems of a simulated focused plenoptic camera with known truth.
#pragma once

#include <Eigen/Core>
#include <array>
#include <map>
#include <vector>

#include "calib/estimate/calibrate.h"

namespace plenocal::testing {

struct PlenopticOptions {
  double f_L = 0.016;
  bool galilean = true;
  bool corner = false;  ///< two planes at right angles in place of one
  double noise = 0;     ///< px
  /// Factor on the noise of each of the array's interleaved sets.
  std::array<double, 3> noise_of_type{1, 1, 1};
  bool state_sigmas = true;
  double marker_tolerance = 0;
  int frames = 12;
  int columns = 6, rows = 5;  ///< of markers
  double depth_span = 0.25;   ///< of the target's distances, to either side
  double tilt_factor = 1;
  double common_noise = 0;  ///< px, of all micro images of a marker in a frame
  double frame_slope = 0;   ///< sigma of a factor on x - c less one, one a frame
  double shared_slope = 0;  ///< likewise, one for all frames, stated in `View::by_nuisance`
  /// Angles of the array, rad, of a focused-plenoptic-tilt camera; zeros: focused-plenoptic.
  std::array<double, 2> tilt{0, 0};
  /// T_1 to T_4, m^-2, of a plenoptic-thick camera whose pupil is in the thin lens; or zeros.
  std::array<double, 4> third_order{0, 0, 0, 0};
  /// Least one; 0 for 2.2 to 2.8. The number of micro images of a marker goes with its square.
  double virtual_depth = 0;
};

struct PlenopticProblem {
  CalibrationInput input;
  std::vector<double> params;
  double shared_size = 0;  ///< of the displacement by `shared_slope`, in its standard deviations
  std::map<int, Eigen::Vector3d> markers;
};

/// A camera focused so that all of [0.6, 1.4] distances of the target has a virtual depth.
PlenopticProblem MakePlenopticProblem(unsigned seed, const PlenopticOptions& options);

}  // namespace plenocal::testing
