// SPDX-License-Identifier: Apache-2.0
#include "apps/cli/result_pictures.h"

#include <fmt/format.h>

#include <algorithm>
#include <limits>

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

std::string EvaluationPicture(const Evaluation& evaluation, PictureFormat format) {
  const auto& runs = evaluation.runs;
  BarChart chart;
  for (const EvaluatedRun& run : runs) chart.runs.push_back(run.name);
  const auto panel = [&](const std::string& title, double base, bool needs_scale, auto&& value) {
    BarPanel& added = chart.panels.emplace_back(BarPanel{title, base, {}});
    for (const EvaluatedRun& run : runs) {
      if (needs_scale && run.monocular) {
        added.values.emplace_back();
      } else if (!run.failure.empty()) {
        added.values.emplace_back(std::numeric_limits<double>::infinity());
      } else {
        added.values.emplace_back(value(run));
      }
    }
  };
  if (evaluation.has_loop) {
    panel("absolute scale error d_s'", 1, true, [](const EvaluatedRun& run) {
      return Folded(run.loop->absolute_scale);
    });
    panel("scale drift e_s'", 1, false, [](const EvaluatedRun& run) {
      return Folded(run.loop->ScaleDrift());
    });
    panel("alignment error e_align, % of path", 0, false, [](const EvaluatedRun& run) {
      return 100 * run.loop->alignment_error / run.loop->path_length;
    });
  } else {
    panel("ATE, m", 0, true, [](const EvaluatedRun& run) { return run.errors->ate_se3.rmse; });
    panel("ATE with scale, m", 0, false, [](const EvaluatedRun& run) {
      return run.errors->ate_sim3.rmse;
    });
    panel("RPE with scale, m", 0, false, [](const EvaluatedRun& run) {
      return run.errors->rpe_sim3.rmse;
    });
  }
  return DrawBarChart(chart, format);
}

}  // namespace plenocal
