// SPDX-License-Identifier: Apache-2.0
#include "apps/suggest/view_sheet.h"

#include <cairo/cairo.h>
#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>

#include "assess/views/view_information.h"

namespace plenocal {
namespace {

// Lengths in points (SVG) or pixels at scale 1.
constexpr double kMargin = 16, kGap = 14, kLine = 17, kFont = 13;
constexpr double kWords = 3 * kLine;  // place for them below an image
constexpr double kPngScale = 2;

/// A frame of one camera's image in the sheet.
struct Panel {
  double left = 0, top = 0, scale = 1;

  [[nodiscard]] Eigen::Vector2d At(const Eigen::Vector2d& u_px) const {
    return {left + scale * (u_px.x() + 0.5), top + scale * (u_px.y() + 0.5)};
  }
};

// Words below a single image need room.
double ImageWidth(const RigEstimate& rig) { return rig.bundle.cameras.size() == 1 ? 460 : 300; }

double PanelHeight(const RigEstimate& rig) {
  double height = 0;
  for (const BundleCamera& camera : rig.bundle.cameras) {
    height = std::max(height, ImageWidth(rig) * camera.image_size[1] / camera.image_size[0]);
  }
  return height;
}

/// Words in lines that fit into `width`.
std::vector<std::string> Wrapped(cairo_t* cr, const std::string& text, double width) {
  std::vector<std::string> lines{""};
  size_t begin = 0;
  while (begin < text.size()) {
    size_t end = text.find(' ', begin);
    if (end == std::string::npos) end = text.size();
    const std::string word = text.substr(begin, end - begin);
    const std::string longer = lines.back().empty() ? word : lines.back() + " " + word;
    cairo_text_extents_t extents;
    cairo_text_extents(cr, longer.c_str(), &extents);
    if (extents.x_advance <= width || lines.back().empty()) {
      lines.back() = longer;
    } else {
      lines.push_back(word);
    }
    begin = end + 1;
  }
  return lines;
}

class Sheet {
 public:
  Sheet(const NextViews& suggestions, const RigEstimate& rig, const ViewTarget& shape)
      : suggestions_(suggestions),
        rig_(rig),
        unknowns_(MakeRigUnknowns(rig.bundle, 1)),
        predictor_(rig, unknowns_, shape),
        width_(ImageWidth(rig)),
        row_height_(PanelHeight(rig) + kWords + kGap) {}

  [[nodiscard]] double Width() const {
    const auto cameras = static_cast<double>(rig_.bundle.cameras.size());
    return 2 * kMargin + cameras * width_ + (cameras - 1) * kGap;
  }
  [[nodiscard]] double Height() const {
    return 2 * kMargin + static_cast<double>(suggestions_.views.size()) * row_height_;
  }

  void Draw(cairo_t* cr) {
    SetFont(cr, kFont);
    for (size_t i = 0; i < suggestions_.views.size(); ++i) DrawRow(cr, i);
  }

 private:
  void DrawRow(cairo_t* cr, size_t i) {
    const NextView& view = suggestions_.views[i];
    const double top = kMargin + static_cast<double>(i) * row_height_;
    for (size_t c = 0; c < rig_.bundle.cameras.size(); ++c) {
      const BundleCamera& camera = rig_.bundle.cameras[c];
      const Panel panel{
          kMargin + static_cast<double>(c) * (width_ + kGap), top, width_ / camera.image_size[0]};
      DrawImage(cr, panel, c, view);
    }
    cairo_set_source_rgb(cr, 0.1, 0.1, 0.1);
    const std::string words =
        fmt::format("{}. {}", i + 1, NextViewText(view, rig_, suggestions_.lowered));
    double y = top + PanelHeight(rig_) + kLine;
    for (const std::string& line : Wrapped(cr, words, Width() - 2 * kMargin)) {
      cairo_move_to(cr, kMargin, y);
      cairo_show_text(cr, line.c_str());
      y += kLine;
    }
  }

  void DrawImage(cairo_t* cr, const Panel& panel, size_t c, const NextView& view) {
    const BundleCamera& camera = rig_.bundle.cameras[c];
    cairo_save(cr);
    cairo_rectangle(cr,
                    panel.left,
                    panel.top,
                    panel.scale * camera.image_size[0],
                    panel.scale * camera.image_size[1]);
    cairo_set_source_rgb(cr, 0.90, 0.91, 0.93);
    cairo_fill_preserve(cr);
    cairo_clip(cr);
    DrawPointsSoFar(cr, panel, c);
    const auto outlines = view.outlines.find(c);
    if (outlines != view.outlines.end()) {
      for (const auto& outline : outlines->second) DrawOutline(cr, panel, outline);
      constexpr size_t kAll = 400;
      cairo_set_source_rgb(cr, 0.12, 0.38, 0.66);
      for (const Eigen::Vector2d& u :
           predictor_.PredictVisibility(c, view.T_rig_target, kAll).u_px) {
        AddDot(cr, panel.At(u));
      }
      StrokeDots(cr, 4);
    }
    cairo_restore(cr);
    cairo_set_source_rgb(cr, 0.3, 0.3, 0.3);
    if (rig_.bundle.cameras.size() > 1) {
      cairo_move_to(cr, panel.left + 4, panel.top + kFont + 2);
      cairo_show_text(cr, camera.name.c_str());
    }
  }

  void DrawPointsSoFar(cairo_t* cr, const Panel& panel, size_t c) const {
    cairo_set_source_rgba(cr, 0.45, 0.48, 0.52, 0.5);
    constexpr size_t kMost = 3000;
    const size_t step = rig_.bundle.observations.size() / kMost + 1;
    for (size_t i = 0; i < rig_.bundle.observations.size(); i += step) {
      const BundleObservation& each = rig_.bundle.observations[i];
      if (each.camera != static_cast<int>(c) || !each.used) continue;
      AddDot(cr, panel.At({each.seen.values[0], each.seen.values[1]}));
    }
    StrokeDots(cr, 2);
  }

  static void DrawOutline(cairo_t* cr,
                          const Panel& panel,
                          const std::vector<Eigen::Vector2d>& outline) {
    for (const Eigen::Vector2d& u : outline) {
      const Eigen::Vector2d at = panel.At(u);
      cairo_line_to(cr, at.x(), at.y());
    }
    cairo_close_path(cr);
    cairo_set_source_rgba(cr, 1, 1, 1, 0.85);
    cairo_fill_preserve(cr);
    cairo_set_source_rgb(cr, 0.12, 0.38, 0.66);
    cairo_set_line_width(cr, 1.5);
    cairo_stroke(cr);
  }

  // Dots are lines without length: one path in place of a circle each.
  static void AddDot(cairo_t* cr, const Eigen::Vector2d& at) {
    cairo_move_to(cr, at.x(), at.y());
    cairo_line_to(cr, at.x(), at.y());
  }
  static void StrokeDots(cairo_t* cr, double diameter) {
    cairo_set_line_cap(cr, CAIRO_LINE_CAP_ROUND);
    cairo_set_line_width(cr, diameter);
    cairo_stroke(cr);
  }

  const NextViews& suggestions_;
  const RigEstimate& rig_;
  RigUnknowns unknowns_;
  ViewPredictor predictor_;
  double width_, row_height_;
};

}  // namespace

std::string DrawViewSheet(const NextViews& suggestions,
                          const RigEstimate& rig,
                          const ViewTarget& shape,
                          PictureFormat format) {
  Sheet sheet(suggestions, rig, shape);
  const double scale = format == PictureFormat::kPng ? kPngScale : 1;
  const PictureSize size{.width = std::ceil(scale * sheet.Width()) / scale,
                         .height = std::ceil(scale * sheet.Height()) / scale,
                         .png_scale = kPngScale};
  return DrawPicture(size, format, [&](cairo_t* cr) { sheet.Draw(cr); });
}

}  // namespace plenocal
