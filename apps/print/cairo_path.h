// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cairo/cairo.h>

#include <memory>

#include "detectors/target_drawing.h"

namespace plenocal::print {

struct CairoDeleter {
  void operator()(cairo_t* context) const { cairo_destroy(context); }
  void operator()(cairo_surface_t* surface) const { cairo_surface_destroy(surface); }
};
using Context = std::unique_ptr<cairo_t, CairoDeleter>;
using Surface = std::unique_ptr<cairo_surface_t, CairoDeleter>;

/// Adds a polygon to the context's path.
void AddPolygon(cairo_t* context, const Polygon& polygon);
/// Fills all black shapes of a part at once, so that no light shows between shapes that touch.
void FillBlack(cairo_t* context, const TargetPart& part);

}  // namespace plenocal::print
