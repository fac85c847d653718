// SPDX-License-Identifier: Apache-2.0
//
// The template of one marker fitted to one micro image.
#pragma once

#include <Eigen/Core>
#include <optional>

#include "detectors/plenoptic/depth/lens_patches.h"
#include "detectors/templates/marker_template.h"

namespace plenocal::internal {

/// A marker as a micro image is expected to show it.
struct ExpectedMarker {
  size_t index = 0;  ///< of its template
  int lens = 0;
  Eigen::Vector2d position{0, 0};  ///< raw px
  /// Homography from raw px about `position` to the template's cells.
  Eigen::Matrix3f cells_by_raw = Eigen::Matrix3f::Identity();
  double cell_px = 0;  ///< size of a cell in the micro image
};

struct Prior {
  double mean, sigma;
};

/// Knowledge before a fit: of the blur, px, and of the template's shape, an unknown of its own (the
/// brightness beyond a tag or the radius of a disc).
struct FitPriors {
  Prior blur, shape;
  /// Beside an edge, px: pixels that the known blur reaches; 0 while the blur is unknown.
  double edge;
};

/// Before anything is known: a tag's surround is about as bright as the tag, and a disc is about as
/// large as it is drawn.
Prior ShapePrior(const MarkerTemplate& marker);

struct TemplateFit {
  Eigen::Vector2d position{0, 0};          ///< of the marker, raw px
  double sigma = 0;                        ///< of each coordinate, px
  double blur = 0;                         ///< px
  double blur_sigma = 0;                   ///< px, with the prior
  double shape = 0;                        ///< see `FitPriors`
  Eigen::Matrix2d vignetting_sensitivity;  ///< see `MarkerMeasurement`
  Eigen::Vector2d depth_sensitivity;       ///< likewise
  Eigen::Matrix2d gradient_sensitivity;    ///< change of `position` with grad ln v in raw px
};

/// Fits translation, brightness, contrast, blur and shape. Nothing when too few pixels are lit, or
/// when the fit fails or moves by more than half a cell.
///
/// Sigma comes from the fit's own residuals, or from the sensor's noise where that is larger.
/// Pixels that have lost more than a quarter of their micro image's light are not used: light of
/// the neighbouring micro image falls on them, and the displacement by vignetting is no longer
/// linear there. The edge of a disc must be lit all around.
std::optional<TemplateFit> FitTemplate(const MarkerTemplate& marker,
                                       const ExpectedMarker& expected,
                                       const LensPatches& patches,
                                       const SensorNoise& noise,
                                       const FitPriors& priors);

}  // namespace plenocal::internal
