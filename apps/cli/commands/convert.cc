// SPDX-License-Identifier: Apache-2.0
#include "assess/convert.h"

#include <fmt/format.h>

#include <array>
#include <string>

#include "apps/cli/options.h"
#include "apps/cli/result_pictures.h"
#include "apps/cli/view_options.h"
#include "assess/central_view.h"
#include "calib/base/number_text.h"
#include "calib/files/calibration_file.h"
#include "calib/io/output_folder.h"
#include "engine/session/calibration_folder.h"
#include "engine/session/open_session.h"

namespace plenocal {
namespace {

/// A calibrated camera and the model to fit to it.
struct ConvertArguments {
  std::filesystem::path calibration;
  std::string camera;  ///< empty: the only one
  std::string model;
  std::optional<double> distance;  ///< of `CentralView`
  std::filesystem::path out;
};

std::string SummaryOf(const CalibratedCamera& camera,
                      const CameraModel& model,
                      const Conversion& conversion) {
  std::string text = fmt::format("{}: {} to {}, {} over the image\n",
                                 camera.name,
                                 camera.model->name,
                                 model.name,
                                 Counted(conversion.errors.size(), "pixel"));
  for (size_t i = 0; i < model.params.size(); ++i) {
    if (model.params[i].prior_sigma > 0) continue;  // too many to read
    text +=
        fmt::format("    {:<6} {:.9g}{}\n",
                    model.params[i].name,
                    conversion.params[i],
                    model.params[i].unit == "1" ? "" : fmt::format(" {}", model.params[i].unit));
  }
  text += fmt::format("  error {:.3g} px RMS, at most {:.3g} px at ({:.0f}, {:.0f})\n",
                      conversion.rms,
                      conversion.largest,
                      conversion.largest_at.x(),
                      conversion.largest_at.y());
  if (conversion.unseen > 0) {
    text += fmt::format(
        "  {} of the pixels look where {} images nothing\n", conversion.unseen, model.name);
  }
  return text;
}

void RunConvert(const ConvertArguments& arguments, Console* console) {
  const CalibrationRecord calibration = OpenForViews(arguments.calibration);
  const CentralView central(
      calibration, FindCamera(calibration, arguments.camera), arguments.distance);
  const CalibratedCamera& camera = central.camera();
  const CameraModel* model = ModelNamed("--to", arguments.model);
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
  OutputFolder out(arguments.out);
  out.Write(
      "calibration.yaml",
      GivenCamerasYaml(std::array{converted},
                       central.WithDistance({{"plenocal_version", PLENOCAL_VERSION},
                                             {"converted_from", arguments.calibration.string()},
                                             {"model", std::string(camera.model->name)}})));
  out.Write("conversion_errors.csv", errors);
  out.Write("conversion_errors.png", ConversionPicture(camera, *model, conversion));
  out.Commit();
  central.Report(console->NewRun());
  console->Print(fmt::format(
      "{}\nwritten to {}\n", SummaryOf(camera, *model, conversion), arguments.out.string()));
}

constexpr const char* kConvertHelp =
    "Fits one camera model to another over the image.\n"
    "\n"
    "  plenocal convert calibration.yaml --camera NAME --to MODEL -o OUT\n"
    "\n"
    "writes OUT/calibration.yaml and the errors at pixels over the image, conversion_errors.csv and .png.";

void DeclareConvert(CLI::App* app, ConvertArguments* arguments, ConsoleOptions* shared) {
  AddCalibration(app, &arguments->calibration);
  app->add_option("--camera", arguments->camera, "its camera (default: the only one)");
  app->add_option("--to", arguments->model, "camera model")->required();
  AddDistance(app, &arguments->distance);
  AddOut(app, &arguments->out);
  AddQuiet(app, shared);
}

}  // namespace

Command ConvertCommand() {
  return MakeCommand("convert", kConvertHelp, DeclareConvert, RunConvert);
}

}  // namespace plenocal
