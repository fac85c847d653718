// SPDX-License-Identifier: Apache-2.0
//
// Findings about what a calibration without a target leaves open (docs/scene.md).
#pragma once

#include <vector>

#include "calib/estimate/calibrate.h"
#include "calib/files/finding.h"

namespace plenocal {

/// True if a distance, extrinsics or a length inside of a plenoptic camera gives the scale.
bool HasScale(const Bundle& bundle);

/// Defects of the scene and of the path: no scale, one depth, no turning, no parallax, B of a
/// plenoptic camera less certain than 1 %, its points at too few virtual depths. Where the
/// parameters are certain all the same, the grade is good.
std::vector<Finding> FindingsOfScene(const Calibration& calibration);

/// That patches of images were followed, whose common errors the standard errors do not contain.
Finding FindingOfPatches();

/// The range of T (the depth factor of docs/plenoptic.md, 1 / (1 - dx_R / dc_I)) over the used
/// points of a plenoptic camera: two and 98 % of them are below.
struct DepthFactors {
  double low = 0, high = 0;
};
DepthFactors DepthFactorsOf(const Bundle& bundle, size_t camera);

}  // namespace plenocal
