// SPDX-License-Identifier: Apache-2.0
#include "apps/resample/rectify.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <memory>

#include "apps/cli/command.h"
#include "apps/cli/image_inputs.h"
#include "apps/cli/options.h"
#include "apps/cli/resample_to_folder.h"
#include "apps/cli/session/open_session.h"
#include "apps/cli/view_options.h"
#include "apps/formats/opencv_storage.h"
#include "apps/formats/poses.h"
#include "apps/resample/resample_images.h"
#include "calib/base/error.h"
#include "calib/files/calibration_file.h"
#include "calib/files/detections.h"
#include "calib/files/session.h"
#include "models/registry.h"

namespace plenocal {
namespace {

/// A stereo pair and its images.
struct RectifyArguments {
  std::filesystem::path calibration;
  std::string left, right;           ///< images, each a folder, glob or file; empty: none
  std::filesystem::path session;     ///< session.yaml that lists the images; empty: none
  std::vector<std::string> cameras;  ///< two names; empty: the calibration's two
  std::filesystem::path
      detections;  ///< folder of detections_<camera>.csv; empty: that of the calibration
  ViewArguments view;
  ResampleArguments resample;
  bool maps = false;  ///< write remap tables
  std::filesystem::path out;
};

namespace fs = std::filesystem;

using Cameras = std::array<const CalibratedCamera*, 2>;
using PairImages = std::array<std::vector<FrameImage>, 2>;

Cameras ChooseCameras(const CalibrationRecord& calibration, const std::vector<std::string>& names) {
  if (!names.empty()) {
    return {&FindCamera(calibration, names[0]), &FindCamera(calibration, names[1])};
  }
  if (calibration.cameras.size() == 2) return {&calibration.cameras[0], &calibration.cameras[1]};
  throw Error(
      ErrorKind::kInput,
      fmt::format("{}: holds {} camera{}; a pair is needed{}",
                  calibration.path.string(),
                  calibration.cameras.size(),
                  calibration.cameras.size() == 1 ? "" : "s",
                  calibration.cameras.size() > 2 ? ", say which by --cameras LEFT RIGHT" : ""));
}

PairImages FindImages(const RectifyArguments& arguments, const Cameras& cameras) {
  if (!arguments.session.empty()) {
    const Session session = OpenSession(arguments.session);
    PairImages images;
    for (size_t c = 0; c < 2; ++c) {
      const auto found =
          std::find_if(session.cameras.begin(), session.cameras.end(), [&](const auto& camera) {
            return camera.name == cameras[c]->name;
          });
      if (found == session.cameras.end() || found->images.empty()) {
        throw Error(
            ErrorKind::kInput,
            fmt::format(
                "{}: has no images of camera '{}'", arguments.session.string(), cameras[c]->name));
      }
      images[c] = ExpandImages(found->images, cameras[c]->name + ": images");
    }
    return images;
  }
  if (arguments.left.empty()) return {};
  if (arguments.right.empty()) {
    throw Error(ErrorKind::kInput, "the images of the second camera are missing; give LEFT RIGHT");
  }
  return {FindImageInputs({arguments.left}, "images"),
          FindImageInputs({arguments.right}, "images")};
}

/// Leaves only frames that both have; one file each is a pair whatever the names are.
void KeepPairs(Console* console, PairImages* images) {
  if ((*images)[0].size() == 1 && (*images)[1].size() == 1) return;
  const PairImages all = *images;
  for (size_t c = 0; c < 2; ++c) {
    const auto single = [&](const FrameImage& image) {
      const auto& others = all[1 - c];
      return std::none_of(others.begin(), others.end(), [&](const FrameImage& other) {
        return other.frame == image.frame;
      });
    };
    for (const FrameImage& image : all[c]) {
      if (!single(image)) continue;
      console->Message(fmt::format("  left out {}: the other camera has no image of frame '{}'",
                                   image.path.string(),
                                   image.frame));
    }
    std::erase_if((*images)[c], single);
  }
  if ((*images)[0].empty() && !all[0].empty()) {
    throw Error(ErrorKind::kInput,
                fmt::format("no image of one camera belongs to one of the other ({} is frame "
                            "'{}', {} is '{}'); images of a pair have equal names, or globs whose "
                            "last * stands for the same",
                            all[0][0].path.string(),
                            all[0][0].frame,
                            all[1][0].path.string(),
                            all[1][0].frame));
  }
}

/// R1 R2 P1 P2 Q as cv::stereoRectify returns them.
std::string RectificationText(const RectifiedPair& pair) {
  const std::vector<double>& p = pair.views[0].params;
  const double b = pair.baseline;
  std::string text = kOpenCvHead;
  for (size_t c = 0; c < 2; ++c) {
    text += OpenCvMatrix(fmt::format("R{}", c + 1), 3, 3, 'd', RowMajor(pair.R_view_camera[c]));
  }
  for (size_t c = 0; c < 2; ++c) {
    text += OpenCvMatrix(fmt::format("P{}", c + 1), 3, 4, 'd', pair.ProjectionMatrix(c));
  }
  const std::array Q{
      1.0, 0.0, 0.0, -p[2], 0.0, 1.0, 0.0, -p[3], 0.0, 0.0, 0.0, p[0], 0.0, 0.0, 1 / b, 0.0};
  return text + OpenCvMatrix("Q", 4, 4, 'd', Q);
}

/// The errors of the calibration's own detections, where they are.
void PrintErrors(const RectifyArguments& arguments,
                 const RectifiedPair& pair,
                 const Cameras& cameras) {
  const fs::path folder =
      arguments.detections.empty() ? arguments.calibration.parent_path() : arguments.detections;
  std::array<std::vector<View>, 2> views;
  for (size_t c = 0; c < 2; ++c) {
    const fs::path file = folder / fmt::format("detections_{}.csv", cameras[c]->name);
    if (!fs::exists(file) && arguments.detections.empty()) {
      fmt::print("epipolar error: no {}; give the folder of the detections with --detections\n",
                 file.string());
      return;
    }
    views[c] = ReadDetections(file, *cameras[c]->model);
  }
  const EpipolarErrors errors = MeasureEpipolarErrors(pair, cameras, views);
  if (errors.points == 0) {
    fmt::print("epipolar error: no marker was seen by both cameras in one frame\n");
    return;
  }
  fmt::print(
      "epipolar error over {} points: mean |dy| {:.4f} px, RMS {:.4f} px, largest {:.3f} px\n",
      errors.points,
      errors.mean_absolute,
      errors.rms,
      errors.largest);
}

void RunRectify(const RectifyArguments& arguments, const ConsoleOptions& shared) {
  const CalibrationRecord calibration = ReadCalibration(arguments.calibration, CameraModels());
  const Cameras cameras = ChooseCameras(calibration, arguments.cameras);
  const RectifiedPair pair = Rectify(*cameras[0], *cameras[1], ToViewOptions(arguments.view));
  PairImages images = FindImages(arguments, cameras);
  Console console(shared);
  KeepPairs(&console, &images);

  std::array<size_t, 2> counts{};
  for (size_t c = 0; c < 2; ++c) CheckImageNames(images[c], arguments.out / cameras[c]->name);
  OutputFolder out(arguments.out);
  for (size_t c = 0; c < 2; ++c) {
    const PixelMap map =
        MapPixels(pair.views[c], *cameras[c], pair.R_view_camera[c].transpose(), shared.threads);
    const std::string folder = cameras[c]->name + "/";
    if (!images[c].empty()) {
      counts[c] = ResampleToFolder(
          images[c], {calibration, *cameras[c], map, arguments.resample, folder}, shared, &out);
    }
    if (!arguments.maps && !arguments.resample.mask) continue;
    for (const auto& [name, content] : MapFiles(map, {}, "")) {
      if (name == "mask.png" ? arguments.resample.mask : arguments.maps) {
        out.Write(folder + name, content);
      }
    }
  }
  out.Write("calibration.yaml",
            GivenCamerasYaml(pair.views,
                             {{"plenocal_version", PLENOCAL_VERSION},
                              {"rectified_from", arguments.calibration.string()}}));
  out.Write("rectification.yaml", RectificationText(pair));
  out.Commit();
  fmt::print("{} and {}: {} and {} images; {}\nbaseline {:.6g} m{}\n",
             cameras[0]->name,
             cameras[1]->name,
             counts[0],
             counts[1],
             ViewText(pair.views[0]),
             pair.baseline,
             pair.turned ? "; the cameras stand above each other: images turned by 90 degrees"
             : pair.baseline < 0
                 ? "; the second camera stands on the left: disparities are negative"
                 : "");
  PrintErrors(arguments, pair, cameras);
  fmt::print("written to {}\n", arguments.out.string());
}

constexpr const char* kHelp =
    "Stereo pairs whose points lie in equal rows.\n"
    "\n"
    "  plenocal rectify calibration.yaml 'left/*.png' 'right/*.png' -o DIR\n"
    "  plenocal rectify OUT/calibration.yaml --session session.yaml -o DIR\n"
    "\n"
    "writes DIR/<camera>/<frame>.png, DIR/calibration.yaml (two pinhole cameras of equal parameters, baseline along x) and rectification.yaml (R1 R2 P1 P2 Q of OpenCV); prints the epipolar error of the calibration's detections.";

RunCommand Declare(CLI::App* app, ConsoleOptions* shared) {
  const auto arguments = std::make_shared<RectifyArguments>();
  app->add_option("calibration", arguments->calibration, "calibration.yaml")->required();
  app->add_option("left", arguments->left, "images of the first camera: glob, folder, file");
  app->add_option("right", arguments->right, "images of the second camera, likewise");
  app->add_option("--session", arguments->session, "session.yaml that names the images")
      ->excludes("left");
  app->add_option("--cameras", arguments->cameras, "first and second camera (default: the two)")
      ->expected(2);
  app->add_option("--detections",
                  arguments->detections,
                  "folder of detections_<camera>.csv (default: that of the calibration)");
  app->add_option("-o,--out", arguments->out, "folder for the results")->required();
  app->add_flag("--maps", arguments->maps, "write <camera>/map_x.tiff and map_y.tiff");
  AddViewOptions(app, &arguments->view);
  AddResampleOptions(app, &arguments->resample);
  AddThreads(app, shared);
  AddQuiet(app, shared);
  return [arguments, shared] { RunRectify(*arguments, *shared); };
}

}  // namespace

Command RectifyCommand() { return {"rectify", kHelp, Declare}; }

}  // namespace plenocal
