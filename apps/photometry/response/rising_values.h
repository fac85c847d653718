// SPDX-License-Identifier: Apache-2.0
//
// Response values that rise: gaps are filled, falling ones are pooled.
#pragma once

#include <array>

#include "detectors/photometry/response_curve.h"

namespace plenocal {

/// Fills values that are NaN: between others by a cubic that rises where they do (F. N. Fritsch,
/// R. E. Carlson, "Monotone Piecewise Cubic Interpolation", 1980), beyond them by a straight line.
/// REQUIRES: two values that are not NaN.
void FillGaps(ResponseCurve::Table& values);

/// The nearest values, in weighted least squares, that do not fall (pool adjacent violators), then
/// with steps of at least 1e-6 of the range.
void MakeRising(ResponseCurve::Table& values,
                const std::array<double, ResponseCurve::kValues>& weights);

}  // namespace plenocal
