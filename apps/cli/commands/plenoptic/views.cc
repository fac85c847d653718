// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>

#include <array>
#include <cmath>
#include <memory>
#include <optional>

#include "apps/cli/command.h"
#include "apps/cli/options.h"
#include "calib/base/error.h"
#include "calib/files/calibration_file.h"
#include "calib/io/output_folder.h"
#include "detectors/plenoptic/views/view_images.h"
#include "models/registry.h"

namespace plenocal {
namespace {

namespace fs = std::filesystem;

struct ViewsArguments {
  fs::path raw;
  PlenopticInputs lenses;
  fs::path calibration;                   ///< calibration.yaml; empty: none
  std::string camera;                     ///< of it; empty: the only plenoptic one
  std::vector<double> distances, depths;  ///< m; virtual depths
  int views = 5;
  double radius = 0.3, scale = 2;
  fs::path out;
};

const CalibratedCamera& PlenopticCameraOf(const CalibrationRecord& calibration,
                                          const std::string& name) {
  const CalibratedCamera* found = nullptr;
  for (const CalibratedCamera& camera : calibration.cameras) {
    if (!camera.model->plenoptic || (!name.empty() && camera.name != name)) continue;
    if (found != nullptr) {
      throw Error(ErrorKind::kInput,
                  fmt::format("{}: has several plenoptic cameras; name one with --camera",
                              calibration.path.string()));
    }
    found = &camera;
  }
  if (found != nullptr) return *found;
  throw Error(ErrorKind::kInput,
              fmt::format("{}: has no plenoptic camera{}",
                          calibration.path.string(),
                          name.empty() ? "" : fmt::format(" '{}'", name)));
}

/// Virtual depth, by micro-image centres, of a point before the middle of the camera: images of a
/// point change with the centre by 1 - 1 / v.
double VirtualDepthAt(const CalibratedCamera& camera, double distance) {
  const double step = 10;  // px; the relation is linear but for distortion
  const double x = (camera.image_size[0] - 1) / 2.0, y = (camera.image_size[1] - 1) / 2.0;
  std::array<double, 2> seen{};
  for (const int side : {0, 1}) {
    const double values[kMaxObservationSize] = {0, 0, x + (side == 0 ? -step : step), y};
    std::array<double, 2> at{};
    if (!camera.model->project(camera.params.data(),
                               camera.config.data(),
                               values,
                               Eigen::Vector3d(0, 0, distance),
                               at.data())) {
      throw Error(
          ErrorKind::kInput,
          fmt::format("--distance {}: camera '{}' images nothing there", distance, camera.name));
    }
    seen[static_cast<size_t>(side)] = at[0];
  }
  const double inverse = 1 - (seen[1] - seen[0]) / (2 * step);
  return 1 / inverse;
}

std::vector<RefocusPlane> PlanesOf(const ViewsArguments& arguments) {
  std::vector<RefocusPlane> planes;
  for (const double depth : arguments.depths) planes.push_back({depth});
  if (arguments.distances.empty()) return planes;
  if (arguments.calibration.empty()) {
    throw Error(ErrorKind::kInput,
                "--distance: needs the calibration of the camera; give it with --calibration, or "
                "virtual depths with --depth");
  }
  const CalibrationRecord calibration = ReadCalibration(arguments.calibration, CameraModels());
  const CalibratedCamera& camera = PlenopticCameraOf(calibration, arguments.camera);
  for (const double distance : arguments.distances) {
    planes.push_back({VirtualDepthAt(camera, distance), distance});
  }
  return planes;
}

void RunViews(const ViewsArguments& arguments, const ConsoleOptions& shared) {
  Console console(shared);
  ViewsRequest request{.raw_image = arguments.raw,
                       .camera = FindPlenopticSource(arguments.lenses),
                       .views = arguments.views,
                       .radius = arguments.radius,
                       .step = arguments.scale,
                       .planes = PlanesOf(arguments),
                       .threads = shared.threads,
                       .message = [&](const std::string& line) { console.Message(line); }};
  OutputFolder out(arguments.out);
  const ViewsResult result = MakeViews(request);
  for (const auto& [name, content] : result.files) out.Write(name, content);
  out.Commit();
  console.Print(fmt::format("{}\nwritten to {}\n", result.summary, arguments.out.string()));
}

constexpr const char* kViewsHelp =
    "Sub-aperture images and refocused images of a raw plenoptic image, of focused and of\n"
    "unfocused cameras.\n"
    "\n"
    "  plenocal views RAW --white WHITE... -o OUT\n"
    "  plenocal views RAW --white WHITE... --calibration calibration.yaml --distance 0.5 0.8 -o "
    "OUT\n"
    "\n"
    "writes OUT/view_<row>_<column>.png, views.png (all of them), refocused_<k>.png and views.yaml.";

RunCommand DeclareViews(CLI::App* app, ConsoleOptions* shared) {
  const auto arguments = std::make_shared<ViewsArguments>();
  app->add_option("raw", arguments->raw, "raw image")->required();
  app->add_option("-o,--out", arguments->out, "folder for the results")->required();
  AddPlenopticInputs(app, &arguments->lenses);
  app->add_option("--distance",
                  arguments->distances,
                  "distances at which refocused images are sharp, m; needs --calibration")
      ->check(CLI::PositiveNumber);
  app->add_option("--depth",
                  arguments->depths,
                  "virtual depths of refocused images (default: three of the image)")
      ->check(CLI::Range(-1000.0, 1000.0));
  app->add_option("--calibration", arguments->calibration, "calibration.yaml of the camera");
  app->add_option("--camera", arguments->camera, "its name there, where several are plenoptic");
  app->add_option("--views", arguments->views, "sub-aperture images along either axis")
      ->check(CLI::Range(1, 31))
      ->capture_default_str();
  app->add_option("--radius",
                  arguments->radius,
                  "of the outermost sub-aperture images from the middle of the micro images, "
                  "pitches")
      ->check(CLI::Range(0.0, 0.5))
      ->capture_default_str();
  app->add_option("--scale", arguments->scale, "raw pixels per pixel of the results")
      ->check(CLI::Range(0.5, 64.0))
      ->capture_default_str();
  AddThreads(app, shared);
  AddQuiet(app, shared);
  return [arguments, shared] { RunViews(*arguments, *shared); };
}

}  // namespace

Command ViewsCommand() { return {"views", kViewsHelp, DeclareViews}; }

}  // namespace plenocal
