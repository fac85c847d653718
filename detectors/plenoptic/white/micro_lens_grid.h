// SPDX-License-Identifier: Apache-2.0
//
// Search for the micro lenses in a white image.
#pragma once

#include <string>
#include <vector>

#include "calib/camera/micro_lens_array.h"

namespace cv {
class Mat;
}

namespace plenocal {

/// The micro-lens array as found in a white image.
struct MicroLensGrid {
  MicroLensArray array;  ///< centres of the smooth lattice
  /// Per micro lens: highest brightness of its micro image, grey values.
  std::vector<double> gains;

  // Residuals of single micro images about the smooth lattice, per coordinate.
  double centre_rms = 0;    ///< px, of usable micro lenses that are whole in the image
  double centre_sigma = 0;  ///< px, robust
  int degree = 1;           ///< of the polynomial that describes the distorted lattice
  /// Residual of the profile over the brightness of a micro image (root mean square, median).
  double misfit = 0;
  /// Robust relative spread of a micro image's brightness about that of its neighbours.
  double gain_spread = 0;
};

/// Finds all micro lenses whose micro-image centre is on the sensor. `white`: CV_32F, mean white
/// image, Bayer planes of one level. Throws `Error` of kind kJob when there is no lattice.
MicroLensGrid FindMicroLensGrid(const cv::Mat& white, int threads);

/// The reason why the cells of a grid do not fit a white image or an attenuation (CV_32F), or
/// nothing: micro images are brighter in the middle than at their corners; of cells of another
/// pitch half are. Cells of one value do not count.
std::string MisplacedCells(const cv::Mat& white, const MicroLensArray& array);

/// Measures the micro images at the centres of a grid from another source. Keeps its centres and
/// lens types; sets `usable`. Throws `Error` of kind kJob when the grid is of another camera.
MicroLensGrid MeasureMicroLensGrid(const cv::Mat& white, MicroLensArray array, int threads);

}  // namespace plenocal
