// SPDX-License-Identifier: Apache-2.0
//
// Vignetting from images of a wall: I = G(t g V(u) C(X)) with the attenuation V by pixel, the
// brightness C by point of the wall and gains g of images (Engel, Usenko, Cremers 2016). The
// logarithm makes it linear: y = ln(U(I) / t) = g + v(u) + c(X), so that c is eliminated exactly
// (Schur's complement) where they alternate. v is a cubic spline: coarse ones with the gains in one
// system, fine ones with the rest fixed, in turns.
#pragma once

#include <array>
#include <opencv2/core/mat.hpp>
#include <string>
#include <vector>

#include "apps/photometry/wall_views.h"

namespace plenocal {

/// A mode of v that the images hardly determine.
struct OpenMode {
  std::string name;  ///< "a tilt along x"
  double sigma = 0;  ///< relative, RMS over the image
};

/// A test for light that moves with the camera (its shadow, a lamp on it), which only views with
/// other roll show.
struct ShadingTest {
  bool tested = false;
  double difference = 0;  ///< relative, RMS over the image, between views of different roll
  double sigma = 0;       ///< of this difference, if there is none
  double chance = 1;      ///< probability of such a difference by noise alone
};

struct VignetteEstimate {
  cv::Mat attenuation;   ///< CV_32F, largest value 1
  cv::Mat sigma;         ///< CV_32F, relative, up to a common factor of all pixels
  cv::Mat wall;          ///< CV_32F, brightness of the wall / largest; NaN: not seen
  double wall_cell = 0;  ///< m, side of its pixels
  /// By view, relative to the recorded exposures, and standard deviations of gain / mean gain.
  std::vector<double> gains, gain_sigma;
  /// Views that show another part of the wall than the pose from their marker predicts: left out,
  /// so that their gain is the prior's.
  std::vector<std::string> misplaced;
  double residual = 0;  ///< robust RMS of y, relative
  double expected = 0;  ///< the same by shot, read and rounding noise
  double outliers = 0;  ///< share of measurements beyond 3 standard deviations
  /// Residual variance of the wall's worst tenth of parts / that of the best fifth, each over what
  /// noise and the wall's texture make of it; of a flat wall 1.3 to 2.5.
  double unevenness = 0;
  std::size_t measurements = 0;
  std::array<double, 5> by_angle{};      ///< mean residual in fifths of the views' angles
  std::array<double, 6> angle_limits{};  ///< rad, from the wall's normal
  std::vector<OpenMode> open;
  ShadingTest shading;
};

/// Throws `Error` of kind kJob when the views do not overlap enough or the wall is not flat.
/// `where` begins messages.
VignetteEstimate FitVignette(WallRecording wall,
                             const std::string& where,
                             int threads,
                             const std::function<bool(const std::string& stage)>& progress);

}  // namespace plenocal
