// SPDX-License-Identifier: Apache-2.0
//
// The micro-lens grid of Raytrix' RayCalibData XML.

#include "calib/base/format_error.h"
#include "calib/camera/micro_lens_array.h"
#include "calib/files/raytrix_grid.h"
#include "engine/formats/import_format.h"

namespace plenocal {
namespace {

ImportedFile ReadRaytrix(const ImportSource& source) {
  if (!source.image_size) {
    throw InputError("{}: holds no image size; give --size WIDTHxHEIGHT", source.path.string());
  }
  return {.content = FormatMicroLenses(ReadRayCalibData(source.path, *source.image_size)),
          .message = UnusedRayCalibData(source.path)};
}

}  // namespace

ImportFormat RaytrixFormat() {
  return {.name = "raytrix",
          .source = "RayCalibData XML",
          .result = "micro_lenses_<file>.csv",
          .read = ReadRaytrix};
}

}  // namespace plenocal
