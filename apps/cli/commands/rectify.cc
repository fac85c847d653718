// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>

#include <algorithm>
#include <array>

#include "apps/commands.h"
#include "apps/formats/camera_format.h"
#include "apps/image_inputs.h"
#include "apps/image_module.h"
#include "apps/resample.h"
#include "apps/undistort/rectify.h"
#include "calib/detections.h"
#include "calib/error.h"
#include "models/registry.h"

namespace plenocal {
namespace {

namespace fs = std::filesystem;

using Cameras = std::array<const CalibratedCamera*, 2>;
using PairImages = std::array<std::vector<FrameImage>, 2>;

Cameras ChooseCameras(const CalibrationFile& calibration, const std::vector<std::string>& names) {
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

PairImages FindImages(const RectifyCommand& command, const Cameras& cameras) {
  if (!command.session.empty()) {
    const Session session = ReadSession(command.session, CameraModels());
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
                "{}: has no images of camera '{}'", command.session.string(), cameras[c]->name));
      }
      images[c] = ExpandImages(found->images, cameras[c]->name + ": images");
    }
    return images;
  }
  if (command.left.empty()) return {};
  if (command.right.empty()) {
    throw Error(ErrorKind::kInput, "the images of the second camera are missing; give LEFT RIGHT");
  }
  return {FindImageInputs({command.left}, "images"), FindImageInputs({command.right}, "images")};
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
                fmt::format("no image of one camera belongs to one of the other ({} is frame '{}', "
                            "{} is '{}'); images of a pair have equal names, or globs whose last * "
                            "stands for the same",
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
void PrintErrors(const RectifyCommand& command, const RectifiedPair& pair, const Cameras& cameras) {
  const fs::path folder =
      command.detections.empty() ? command.calibration.parent_path() : command.detections;
  std::array<std::vector<View>, 2> views;
  for (size_t c = 0; c < 2; ++c) {
    const fs::path file = folder / fmt::format("detections_{}.csv", cameras[c]->name);
    if (!fs::exists(file) && command.detections.empty()) {
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

}  // namespace

void RunRectify(const RectifyCommand& command, const ConsoleOptions& options) {
  const CalibrationFile calibration = ReadCalibration(command.calibration, CameraModels());
  const Cameras cameras = ChooseCameras(calibration, command.cameras);
  const RectifiedPair pair = Rectify(*cameras[0], *cameras[1], ToViewOptions(command.view));
  PairImages images = FindImages(command, cameras);
  Console console(options.quiet);
  KeepPairs(&console, &images);

  std::array<size_t, 2> counts{};
  for (size_t c = 0; c < 2; ++c) CheckImageNames(images[c], command.out / cameras[c]->name);
  OutputFolder out(command.out);
  for (size_t c = 0; c < 2; ++c) {
    const PixelMap map =
        MapPixels(pair.views[c], *cameras[c], pair.R_view_camera[c].transpose(), options.threads);
    const std::string folder = cameras[c]->name + "/";
    if (!images[c].empty()) {
      counts[c] = ResampleInto(
          images[c], calibration, *cameras[c], map, command.resample, options, folder, &out);
    }
    if (!command.maps && !command.resample.mask) continue;
    for (const auto& [name, content] : MapFilesByModule(map, {}, "")) {
      if (name == "mask.png" ? command.resample.mask : command.maps) {
        out.Write(folder + name, content);
      }
    }
  }
  out.Write("calibration.yaml",
            CalibrationText(pair.views,
                            {{"plenocal_version", PLENOCAL_VERSION},
                             {"rectified_from", command.calibration.string()}}));
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
  PrintErrors(command, pair, cameras);
  fmt::print("written to {}\n", command.out.string());
}

}  // namespace plenocal
