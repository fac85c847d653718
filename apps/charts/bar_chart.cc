// SPDX-License-Identifier: Apache-2.0
#include "apps/charts/bar_chart.h"

#include <cairo/cairo.h>
#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>

#include "apps/charts/cairo_handles.h"

namespace plenocal {
namespace {

// Lengths in points (SVG) or pixels at scale 1.
constexpr double kMargin = 16, kAxis = 54, kTitle = 40, kPlotHeight = 240, kNames = 24;
constexpr double kTop = kMargin + kTitle, kBottom = kTop + kPlotHeight;  // of the plots
constexpr double kBar = 30, kBarGap = 14, kFont = 12;
constexpr double kPngScale = 2;
constexpr double kSmallestRange = 1e-4;
constexpr std::array<std::array<double, 3>, 6> kColours{{{0.12, 0.38, 0.66},
                                                         {0.85, 0.45, 0.13},
                                                         {0.25, 0.58, 0.30},
                                                         {0.58, 0.33, 0.62},
                                                         {0.70, 0.20, 0.22},
                                                         {0.40, 0.40, 0.40}}};

enum class Align { kLeft, kCentre, kRight };

double TextWidth(cairo_t* cr, const std::string& text) {
  cairo_text_extents_t extents;
  cairo_text_extents(cr, text.c_str(), &extents);
  return extents.x_advance;
}

void Text(cairo_t* cr, double x, double y, const std::string& text, Align align) {
  const double width = TextWidth(cr, text);
  const double shift = align == Align::kLeft ? 0 : align == Align::kCentre ? width / 2 : width;
  cairo_move_to(cr, x - shift, y);
  cairo_show_text(cr, text.c_str());
}

/// 1, 2 or 5 times a power of ten, so that about four steps fill `range`.
double Step(double range) {
  const double raw = range / 4;
  const double power = std::pow(10, std::floor(std::log10(raw)));
  for (const double factor : {1.0, 2.0, 5.0}) {
    if (raw <= factor * power) return factor * power;
  }
  return 10 * power;
}

/// Width per run into which names, values and titles fit.
double SlotWidth(cairo_t* cr, const BarChart& chart) {
  double widest = std::max(kBar, TextWidth(cr, "0.00000"));
  for (const std::string& run : chart.runs) widest = std::max(widest, TextWidth(cr, run));
  double slot = widest + kBarGap;
  for (const BarPanel& panel : chart.panels) {
    slot = std::max(slot, TextWidth(cr, panel.title) / static_cast<double>(chart.runs.size()));
  }
  return slot;
}

/// The vertical axis of a panel.
struct Scale {
  double base, step, limit;  ///< lowest value, between two grid lines, highest value

  [[nodiscard]] double Y(double value) const {
    return kBottom - (value - base) / (limit - base) * kPlotHeight;
  }
};

Scale ChooseScale(const BarPanel& panel) {
  constexpr double kHeadroom = 1.05;  // over the highest bar
  double highest = panel.base;
  for (const std::optional<double>& value : panel.values) {
    if (value && std::isfinite(*value)) highest = std::max(highest, *value);
  }
  // A perfect run is not magnified to its rounding errors.
  const double range = std::max(highest - panel.base, kSmallestRange);
  const double step = Step(range);
  return {panel.base, step, panel.base + step * std::ceil(kHeadroom * range / step)};
}

void DrawGrid(cairo_t* cr, const Scale& scale, double left, double width) {
  cairo_set_line_width(cr, 0.5);
  const int decimals = std::max(0, static_cast<int>(std::ceil(-std::log10(scale.step) - 1e-9)));
  for (int i = 0; scale.base + i * scale.step <= scale.limit + 0.5 * scale.step; ++i) {
    const double value = scale.base + i * scale.step, y = scale.Y(value);
    cairo_set_source_rgb(cr, 0.8, 0.8, 0.8);
    cairo_move_to(cr, left, y);
    cairo_line_to(cr, left + width, y);
    cairo_stroke(cr);
    cairo_set_source_rgb(cr, 0, 0, 0);
    Text(cr, left - 6, y + kFont / 3, fmt::format("{:.{}f}", value, decimals), Align::kRight);
  }
}

/// A hatched frame of the panel's height.
void DrawFailedBar(cairo_t* cr, double centre) {
  constexpr double kHatch = 8;
  cairo_save(cr);
  cairo_rectangle(cr, centre - kBar / 2, kTop, kBar, kPlotHeight);
  cairo_stroke_preserve(cr);
  cairo_clip(cr);
  for (double y = kTop - kBar; y < kBottom; y += kHatch) {
    cairo_move_to(cr, centre - kBar / 2, y + kBar);
    cairo_line_to(cr, centre + kBar / 2, y);
  }
  cairo_stroke(cr);
  cairo_restore(cr);
  cairo_set_source_rgb(cr, 0, 0, 0);
  Text(cr, centre, kTop - 4, "failed", Align::kCentre);
}

void DrawBar(cairo_t* cr, const Scale& scale, double centre, double value) {
  const double y = scale.Y(value);
  cairo_rectangle(cr, centre - kBar / 2, y, kBar, kBottom - y);
  cairo_fill(cr);
  cairo_set_source_rgb(cr, 0, 0, 0);
  Text(cr, centre, y - 3, fmt::format("{:.5g}", value), Align::kCentre);
}

void DrawPanel(
    cairo_t* cr, const BarChart& chart, const BarPanel& panel, double left, double slot) {
  const double width = slot * static_cast<double>(chart.runs.size());
  const Scale scale = ChooseScale(panel);
  cairo_set_source_rgb(cr, 0, 0, 0);
  Text(cr, left + width / 2, kTop - 24, panel.title, Align::kCentre);
  DrawGrid(cr, scale, left, width);
  for (size_t i = 0; i < chart.runs.size(); ++i) {
    const double centre = left + (static_cast<double>(i) + 0.5) * slot;
    const auto& colour = kColours[i % kColours.size()];
    cairo_set_source_rgb(cr, 0, 0, 0);
    Text(cr, centre, kBottom + kFont + 6, chart.runs[i], Align::kCentre);
    const std::optional<double>& value = panel.values[i];
    if (!value) {
      Text(cr, centre, kBottom - 4, "-", Align::kCentre);
      continue;
    }
    cairo_set_source_rgb(cr, colour[0], colour[1], colour[2]);
    if (std::isfinite(*value)) {
      DrawBar(cr, scale, centre, *value);
    } else {
      DrawFailedBar(cr, centre);
    }
  }
  cairo_set_source_rgb(cr, 0, 0, 0);
  cairo_set_line_width(cr, 1);
  cairo_rectangle(cr, left, kTop, width, kPlotHeight);
  cairo_stroke(cr);
}

}  // namespace

std::string DrawBarChart(const BarChart& chart, PictureFormat format) {
  const print::Surface scratch(cairo_image_surface_create(CAIRO_FORMAT_RGB24, 1, 1));
  const print::Context measure(cairo_create(scratch.get()));
  SetFont(measure.get(), kFont);
  const double slot = SlotWidth(measure.get(), chart);
  const double panel_width = kAxis + slot * static_cast<double>(chart.runs.size()) + kMargin;
  const PictureSize size{.width = kMargin + panel_width * static_cast<double>(chart.panels.size()),
                         .height = kMargin + kTitle + kPlotHeight + kNames + kMargin,
                         .png_scale = kPngScale};
  return DrawPicture(size, format, [&](cairo_t* cr) {
    SetFont(cr, kFont);
    for (size_t i = 0; i < chart.panels.size(); ++i) {
      const double left = kMargin + kAxis + panel_width * static_cast<double>(i);
      DrawPanel(cr, chart, chart.panels[i], left, slot);
    }
  });
}

}  // namespace plenocal
