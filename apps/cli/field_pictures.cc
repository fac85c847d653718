// SPDX-License-Identifier: Apache-2.0
#include "apps/cli/field_pictures.h"

#include <fmt/format.h>

#include <algorithm>

#include "apps/charts/field_map.h"
#include "assess/text/compare_text.h"

namespace plenocal {

std::string DifferencePicture(const CalibrationComparison& comparison) {
  std::vector<FieldMap> maps;
  double largest = 0;
  for (size_t i = 0; i < comparison.a.size(); ++i) {
    for (const DistanceDifference& at : comparison.differences[i].distances) {
      FieldMap map{
          fmt::format(
              "{}, {}: RMS {:.3g} px", comparison.a[i].name, DistanceText(at.distance), at.all.rms),
          comparison.a[i].image_size,
          kComparedColumns,
          kComparedRows,
          {}};
      for (const PixelDifference& pixel : at.pixels) {
        map.Put(pixel.u_px.x(), pixel.u_px.y(), {pixel.difference_px.x(), pixel.difference_px.y()});
      }
      largest = std::max(largest, at.all.largest);
      maps.push_back(std::move(map));
    }
  }
  return DrawFieldMaps(maps, largest);
}

std::string ConversionPicture(const CalibratedCamera& camera,
                              const CameraModel& model,
                              const Conversion& conversion) {
  FieldMap map{fmt::format("{}, {} to {}: RMS {:.3g} px",
                           camera.name,
                           camera.model->name,
                           model.name,
                           conversion.rms),
               camera.image_size,
               kConvertedColumns,
               kConvertedRows,
               {}};
  for (const ConversionError& error : conversion.errors) {
    if (!error.difference_px) continue;
    map.Put(error.u_px.x(), error.u_px.y(), {error.difference_px->x(), error.difference_px->y()});
  }
  return DrawFieldMaps({map}, conversion.largest);
}

}  // namespace plenocal
