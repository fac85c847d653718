// SPDX-License-Identifier: Apache-2.0
//
// Cairo's objects, owned, and its errors and output.
#pragma once

#include <cairo/cairo.h>

#include <memory>
#include <string>

#include "calib/base/error.h"

namespace plenocal::print {

struct CairoDeleter {
  void operator()(cairo_t* context) const { cairo_destroy(context); }
  void operator()(cairo_surface_t* surface) const { cairo_surface_destroy(surface); }
};
using Context = std::unique_ptr<cairo_t, CairoDeleter>;
using Surface = std::unique_ptr<cairo_surface_t, CairoDeleter>;

/// A write function for surfaces: appends to the std::string that `text` points to.
inline cairo_status_t Append(void* text, const unsigned char* data, unsigned int length) {
  static_cast<std::string*>(text)->append(reinterpret_cast<const char*>(data), length);
  return CAIRO_STATUS_SUCCESS;
}

/// Throws `Error` of kind kJob unless `status` is success.
inline void Check(cairo_status_t status) {
  if (status == CAIRO_STATUS_SUCCESS) return;
  throw Error(ErrorKind::kJob, std::string("cannot draw: ") + cairo_status_to_string(status));
}

}  // namespace plenocal::print
