// SPDX-License-Identifier: Apache-2.0
//
// What makes a formula useless as a camera model although its text is correct.
#pragma once

#include <span>
#include <string>

#include "calib/camera/camera_model.h"
#include "models/formula/lens.h"

namespace plenocal::formula {

/// The first defect on the axis at the example's lens parameters, as a sentence without its full
/// stop, with the sub-expression and the remedy; empty when there is none.
std::string DefectOnAxis(LensNodes nodes, const double* example);

/// Likewise around the axis, of a lens without the defects above. `params` are the lens'.
std::string DefectAround(const LensFormula& lens,
                         Form form,
                         std::span<const Param> params,
                         std::span<const double> example);

}  // namespace plenocal::formula
