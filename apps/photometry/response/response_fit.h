// SPDX-License-Identifier: Apache-2.0
//
// Response of a sensor from images of a static scene at several exposures t: U(I) = t E for each
// pixel's unknown E (Engel, Usenko, Cremers 2016). Where they take for U(k) the mean of t E over
// pixels of grey value k, which noise draws towards the more frequent brightness, the borders
// between grey values are estimated here, together with the errors of the exposures.
#pragma once

#include <array>
#include <cstdint>
#include <string>
#include <vector>

#include "apps/photometry/response/sensor_curve.h"
#include "detectors/photometry/response_curve.h"

namespace plenocal {

/// The same pixels in all images.
struct ExposureSweep {
  std::vector<std::string> frames;              ///< names of the images
  std::vector<double> exposures;                ///< ms
  std::vector<std::vector<std::uint8_t>> grey;  ///< by image and pixel
  /// Beside saturated pixels, which may receive their charge: not used. Like `grey`.
  std::vector<std::vector<bool>> beside_saturated;
};

struct ResponseEstimate {
  ResponseCurve curve;
  /// Standard deviation of U(k) up to a common factor of all, from the pixels' scatter and from
  /// errors of exposures; NaN where the sweep does not have the value.
  std::array<double, ResponseCurve::kValues> sigma{};
  std::array<std::size_t, ResponseCurve::kValues> count{};  ///< pixels of each grey value
  SensorNoise noise;
  double exposure_sigma = 0;            ///< relative error of single exposures
  std::vector<double> exposure_errors;  ///< relative, by image, against the others
  double rms = 0;                       ///< of U(I) - t E, light
  std::size_t pixels = 0;               ///< used
  std::size_t moving = 0;               ///< left out: no constant light
  int first = 0, last = 255;            ///< grey values between which borders were measured
};

/// Throws `Error` of kind kJob, whose message ends with the remedy, when the exposures hardly
/// differ, most pixels are saturated or dark, or the scene moves. `where` begins messages.
ResponseEstimate FitResponse(const ExposureSweep& sweep, const std::string& where, int threads);

}  // namespace plenocal
