// SPDX-License-Identifier: Apache-2.0
//
// The shapes of a target as paths of cairo.
#pragma once

#include <cairo/cairo.h>

#include "targets/target_drawing.h"

namespace plenocal::print {

/// Adds a polygon to the context's path.
void AddPolygon(cairo_t* context, const Polygon& polygon);
/// Fills all black shapes of a part at once, so that no light shows between shapes that touch.
void FillBlack(cairo_t* context, const TargetPart& part);

}  // namespace plenocal::print
