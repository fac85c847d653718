// SPDX-License-Identifier: Apache-2.0
#include "apps/charts/picture.h"

#include <cairo/cairo-svg.h>

#include <cmath>

#include "apps/charts/cairo_handles.h"
#include "calib/base/format_error.h"

namespace plenocal {

PictureFormat PictureFormatOf(const std::filesystem::path& picture) {
  if (picture.extension() == ".svg") return PictureFormat::kSvg;
  if (picture.extension() == ".png") return PictureFormat::kPng;
  throw InputError("{}: a picture's name ends in .svg or .png", picture.string());
}

std::string DrawPicture(const PictureSize& size,
                        PictureFormat format,
                        const std::function<void(cairo_t*)>& draw) {
  const bool is_svg = format == PictureFormat::kSvg;
  const double scale = is_svg ? 1 : size.png_scale;
  std::string content;
  const print::Surface surface(
      is_svg ? cairo_svg_surface_create_for_stream(print::Append, &content, size.width, size.height)
             : cairo_image_surface_create(CAIRO_FORMAT_RGB24,
                                          static_cast<int>(std::ceil(scale * size.width)),
                                          static_cast<int>(std::ceil(scale * size.height))));
  print::Check(cairo_surface_status(surface.get()));
  {
    const print::Context cr(cairo_create(surface.get()));
    cairo_scale(cr.get(), scale, scale);
    cairo_set_source_rgb(cr.get(), 1, 1, 1);
    cairo_paint(cr.get());
    draw(cr.get());
    print::Check(cairo_status(cr.get()));
  }
  if (!is_svg) {
    print::Check(cairo_surface_write_to_png_stream(surface.get(), print::Append, &content));
  }
  cairo_surface_finish(surface.get());
  print::Check(cairo_surface_status(surface.get()));
  return content;
}

void SetFont(cairo_t* cr, double size) {
  cairo_select_font_face(cr, "sans-serif", CAIRO_FONT_SLANT_NORMAL, CAIRO_FONT_WEIGHT_NORMAL);
  cairo_set_font_size(cr, size);
}

}  // namespace plenocal
