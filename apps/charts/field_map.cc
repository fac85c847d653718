// SPDX-License-Identifier: Apache-2.0
#include "apps/charts/field_map.h"

#include <cairo/cairo.h>
#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "apps/charts/picture.h"

namespace plenocal {
namespace {

// Lengths in pixels of the picture.
constexpr double kMapWidth = 900, kMargin = 24, kTitle = 34, kScale = 120, kFont = 16;

/// From dark blue over green to yellow, even in lightness.
std::array<double, 3> Ramp(double part) {
  constexpr std::array<std::array<double, 3>, 5> kStops{
      {{68, 1, 84}, {59, 82, 139}, {33, 145, 140}, {94, 201, 98}, {253, 231, 37}}};
  const double place = std::clamp(part, 0.0, 1.0) * (kStops.size() - 1);
  const auto k = std::min(static_cast<size_t>(place), kStops.size() - 2);
  const double t = place - static_cast<double>(k);
  std::array<double, 3> colour{};
  for (size_t i = 0; i < 3; ++i) {
    colour[i] = (kStops[k][i] + t * (kStops[k + 1][i] - kStops[k][i])) / 255;
  }
  return colour;
}

double MapHeight(const FieldMap& map) {
  constexpr double kHighest = 4;  // times the width: cairo limits a picture's size
  return kMapWidth * std::min(kHighest, map.image_size[1] / std::max<double>(1, map.image_size[0]));
}

void Text(cairo_t* cr, double x, double y, const std::string& text) {
  cairo_set_source_rgb(cr, 0, 0, 0);
  cairo_move_to(cr, x, y);
  cairo_show_text(cr, text.c_str());
}

void Arrow(cairo_t* cr, double x, double y, double dx, double dy) {
  const double length = std::hypot(dx, dy), head = std::min(7.0, 0.4 * length);
  const double angle = std::atan2(dy, dx);
  cairo_move_to(cr, x, y);
  cairo_line_to(cr, x + dx, y + dy);
  for (const double side : {2.6, -2.6}) {
    cairo_move_to(cr, x + dx, y + dy);
    cairo_rel_line_to(cr, head * std::cos(angle + side), head * std::sin(angle + side));
  }
  cairo_stroke(cr);
}

void DrawMap(cairo_t* cr, const FieldMap& map, double top, double largest) {
  const double width = kMapWidth / map.columns, height = MapHeight(map) / map.rows;
  const double magnify = 2 * width / largest;  // the longest arrow spans two cells
  Text(cr, kMargin, top - 10, map.title);
  for (const bool arrows : {false, true}) {
    for (size_t cell = 0; cell < map.vectors.size(); ++cell) {
      const auto& vector = map.vectors[cell];
      if (!vector) continue;
      const int row = static_cast<int>(cell) / map.columns;
      const int column = static_cast<int>(cell) % map.columns;
      const double x = kMargin + column * width, y = top + row * height;
      if (arrows) {
        cairo_set_source_rgb(cr, 1, 1, 1);
        cairo_set_line_width(cr, 1.2);
        Arrow(cr, x + width / 2, y + height / 2, magnify * (*vector)[0], magnify * (*vector)[1]);
        continue;
      }
      const auto colour = Ramp(std::hypot((*vector)[0], (*vector)[1]) / largest);
      cairo_set_source_rgb(cr, colour[0], colour[1], colour[2]);
      cairo_rectangle(cr, x, y, width + 0.5, height + 0.5);
      cairo_fill(cr);
    }
  }
  cairo_set_source_rgb(cr, 0, 0, 0);
  cairo_set_line_width(cr, 1);
  cairo_rectangle(cr, kMargin, top, kMapWidth, MapHeight(map));
  cairo_stroke(cr);

  const double left = 2 * kMargin + kMapWidth;
  constexpr int kSteps = 100;
  for (int i = 0; i < kSteps; ++i) {
    const auto colour = Ramp((i + 0.5) / kSteps);
    cairo_set_source_rgb(cr, colour[0], colour[1], colour[2]);
    cairo_rectangle(cr,
                    left,
                    top + MapHeight(map) * (kSteps - 1 - i) / kSteps,
                    20,
                    MapHeight(map) / kSteps + 0.5);
    cairo_fill(cr);
  }
  Text(cr, left + 26, top + kFont, fmt::format("{:.3g} px", largest));
  Text(cr, left + 26, top + MapHeight(map) / 2 + kFont / 2, fmt::format("{:.3g}", largest / 2));
  Text(cr, left + 26, top + MapHeight(map), "0");
}

}  // namespace

std::string DrawFieldMaps(const std::vector<FieldMap>& maps, double largest) {
  largest = std::max(largest, 1e-6);  // below it is rounding, which is no difference
  double height = kMargin;
  for (const FieldMap& map : maps) height += kTitle + MapHeight(map) + kMargin;
  const double width = 3 * kMargin + kMapWidth + kScale;
  return DrawPicture({width, height}, PictureFormat::kPng, [&](cairo_t* cr) {
    SetFont(cr, kFont);
    double top = kMargin + kTitle;
    for (const FieldMap& map : maps) {
      DrawMap(cr, map, top, largest);
      top += MapHeight(map) + kMargin + kTitle;
    }
  });
}

}  // namespace plenocal
