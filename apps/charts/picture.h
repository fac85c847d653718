// SPDX-License-Identifier: Apache-2.0
//
// Picture files that are drawn with cairo on white ground.
#pragma once

#include <cairo/cairo.h>

#include <filesystem>
#include <functional>
#include <string>

namespace plenocal {

enum class PictureFormat { kSvg, kPng };

/// By the file's extension. Throws `Error` of kind kInput for another.
PictureFormat PictureFormatOf(const std::filesystem::path& picture);

struct PictureSize {
  double width = 0, height = 0;  ///< points of an SVG
  double png_scale = 1;          ///< pixels of a PNG for each of them
};

/// The content of the picture file that `draw` makes. Throws `Error` of kind kJob.
std::string DrawPicture(const PictureSize& size,
                        PictureFormat format,
                        const std::function<void(cairo_t*)>& draw);

/// Letters without serifs.
void SetFont(cairo_t* cr, double size);

}  // namespace plenocal
