// SPDX-License-Identifier: Apache-2.0
#include "apps/charts/cairo_path.h"

#include <numbers>

namespace plenocal::print {

void AddPolygon(cairo_t* context, const Polygon& polygon) {
  cairo_new_sub_path(context);
  for (const Eigen::Vector2d& p : polygon) cairo_line_to(context, p.x(), p.y());
  cairo_close_path(context);
}

void FillBlack(cairo_t* context, const TargetPart& part) {
  cairo_set_fill_rule(context, CAIRO_FILL_RULE_WINDING);
  for (const Polygon& polygon : part.black) AddPolygon(context, polygon);
  for (const Disc& disc : part.black_discs) {
    cairo_new_sub_path(context);
    cairo_arc(context, disc.centre.x(), disc.centre.y(), disc.radius, 0, 2 * std::numbers::pi);
  }
  cairo_fill(context);
}

}  // namespace plenocal::print
