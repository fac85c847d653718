// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <string>

#include "apps/commands.h"
#include "apps/image_module.h"
#include "apps/model_option.h"
#include "calib/calibration_file.h"
#include "calib/convert.h"
#include "calib/output_folder.h"
#include "models/registry.h"

namespace plenocal {
namespace {

// The errors over the image.
std::string Picture(const CalibratedCamera& camera,
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
  return DrawFieldMapsByModule({map}, conversion.largest);
}

}  // namespace

void RunConvert(const ConvertCommand& command) {
  const CalibrationFile calibration = ReadCalibration(command.calibration, CameraModels());
  const CalibratedCamera& camera = FindCamera(calibration, command.camera);
  const CameraModel* model = ModelOfOption("--to", command.model);
  const Conversion conversion = Convert(camera, *model);

  std::string errors = "x,y,dx,dy\n";
  for (const ConversionError& error : conversion.errors) {
    errors += fmt::format("{:.3f},{:.3f}", error.u_px.x(), error.u_px.y());
    errors +=
        error.difference_px
            ? fmt::format(",{:.9g},{:.9g}\n", error.difference_px->x(), error.difference_px->y())
            : ",,\n";
  }
  const CalibratedCamera converted{.name = camera.name,
                                   .model = model,
                                   .image_size = camera.image_size,
                                   .config = {},
                                   .params = conversion.params,
                                   .covariance = {},
                                   .T_camera_rig = camera.T_camera_rig};
  OutputFolder out(command.out);
  out.Write("calibration.yaml",
            CalibrationText(std::array{converted},
                            {{"plenocal_version", PLENOCAL_VERSION},
                             {"converted_from", command.calibration.string()},
                             {"model", std::string(camera.model->name)}}));
  out.Write("conversion_errors.csv", errors);
  out.Write("conversion_errors.png", Picture(camera, *model, conversion));
  out.Commit();
  fmt::print("{}: {} to {}, {} pixels over the image\n",
             camera.name,
             camera.model->name,
             model->name,
             conversion.errors.size());
  for (size_t i = 0; i < model->params.size(); ++i) {
    if (model->params[i].prior_sigma > 0) continue;  // too many to read
    fmt::print("    {:<6} {:.9g}{}\n",
               model->params[i].name,
               conversion.params[i],
               model->params[i].unit == "1" ? "" : fmt::format(" {}", model->params[i].unit));
  }
  fmt::print("  error {:.3g} px RMS, at most {:.3g} px at ({:.0f}, {:.0f})\n",
             conversion.rms,
             conversion.largest,
             conversion.largest_at.x(),
             conversion.largest_at.y());
  if (conversion.unseen > 0) {
    fmt::print("  {} of the pixels look where {} images nothing\n", conversion.unseen, model->name);
  }
  fmt::print("\nwritten to {}\n", command.out.string());
}

}  // namespace plenocal
