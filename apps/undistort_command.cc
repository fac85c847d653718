// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>

#include <array>

#include "apps/commands.h"
#include "apps/image_inputs.h"
#include "apps/image_module.h"
#include "apps/resample.h"
#include "apps/undistort/virtual_image.h"
#include "calib/error.h"
#include "models/registry.h"

namespace plenocal {
namespace {

namespace fs = std::filesystem;

/// A command on its way: what both kinds of cameras need.
struct Job {
  const UndistortCommand& command;
  const ConsoleOptions& options;
  const CalibrationFile& calibration;
  const CalibratedCamera& camera;
  std::vector<FrameImage> images;
};

void Finish(const Job& job,
            const CalibratedCamera& view,
            const PixelMap& map,
            size_t count,
            OutputFolder* out) {
  if (job.command.resample.mask) {
    out->Write("mask.png", MapFilesByModule(map, {}, "").at("mask.png"));
  }
  out->Write("calibration.yaml",
             CalibrationText(std::array{view},
                             {{"plenocal_version", PLENOCAL_VERSION},
                              {"undistorted_from", job.command.calibration.string()}}));
  out->Commit();
  fmt::print("{}: {} images; {}\nwritten to {}\n",
             view.name,
             count,
             ViewText(view),
             job.command.out.string());
}

void UndistortOrdinary(const Job& job) {
  const std::array seen{ImageOf(job.camera, Eigen::Matrix3d::Identity())};
  CalibratedCamera view = ChoosePinhole(seen, ToViewOptions(job.command.view));
  view.name = job.camera.name;
  view.T_camera_rig = job.camera.T_camera_rig;
  if (!job.command.cloud.empty()) {
    throw Error(ErrorKind::kInput,
                fmt::format("--cloud: camera '{}' has no depth; only a plenoptic camera has",
                            job.camera.name));
  }
  OutputFolder out(job.command.out);
  const PixelMap map =
      MapPixels(view, job.camera, Eigen::Matrix3d::Identity(), job.options.threads);
  const size_t count = ResampleInto(
      job.images, job.calibration, job.camera, map, job.command.resample, job.options, "", &out);
  Finish(job, view, map, count, &out);
}

void UndistortPlenoptic(const Job& job) {
  constexpr double kScale = 2;  // as `plenocal focus`: raw px a pixel of the virtual image
  const CalibratedCamera& camera = job.camera;
  const VirtualImage virtual_image(camera);
  const std::array seen{virtual_image.Seen(kScale)};
  CalibratedCamera view = ChoosePinhole(seen, ToViewOptions(job.command.view));
  view.name = camera.name;
  view.T_camera_rig = virtual_image.ViewFromCamera() * camera.T_camera_rig;
  if (camera.micro_lenses.empty()) {
    throw Error(ErrorKind::kInput,
                fmt::format("{}: camera '{}' has no 'micro_lenses'; name there the "
                            "micro_lenses_<camera>.csv that 'plenocal white' writes",
                            job.calibration.path.string(),
                            camera.name));
  }
  if (!job.command.cloud.empty() && job.images.size() > 1) {
    throw Error(ErrorKind::kInput,
                fmt::format("--cloud: holds one image, but there are {}", job.images.size()));
  }
  OutputFolder out(job.command.out);
  std::optional<OutputFolder> cloud_out;
  if (!job.command.cloud.empty()) {
    const fs::path parent = job.command.cloud.parent_path();
    const fs::path folder = parent.empty() ? "." : parent;
    // A folder takes the results of one run at a time.
    if (fs::weakly_canonical(folder) != fs::weakly_canonical(job.command.out)) {
      cloud_out.emplace(folder);
    }
  }
  const PixelMap map = MapPixels(
      view,
      VirtualImage::SizeAt(camera.image_size, kScale),
      [&](const Eigen::Vector3d& direction) -> std::optional<Eigen::Vector2d> {
        const auto place = virtual_image.Place(direction);
        if (!place) return std::nullopt;
        return *place / kScale;
      },
      job.options.threads);
  Console console(job.options.quiet);
  VirtualViewRequest request;
  request.images = job.images;
  request.virtual_image = &virtual_image;
  request.scale = kScale;
  request.map = &map;
  request.raw_size = camera.image_size;
  const fs::path folder = job.calibration.path.parent_path();
  request.grid = folder / camera.micro_lenses;
  if (!camera.vignetting.empty()) request.vignetting = folder / camera.vignetting;
  request.bayer = job.command.resample.bayer;
  request.interpolation = job.command.resample.interpolation;
  request.cloud = !job.command.cloud.empty();
  request.threads = job.options.threads;
  request.message = [&](const std::string& line) { console.Message(line); };
  request.progress = [&](size_t done) {
    console.Progress(camera.name + ": images", done, job.images.size());
    return !Interrupted();
  };
  request.result = [&](const std::string& frame, const auto& files, const std::string& summary) {
    for (const auto& [suffix, content] : files) {
      if (suffix == ".ply") {
        (cloud_out ? *cloud_out : out).Write(job.command.cloud.filename().string(), content);
      } else {
        out.Write(frame + suffix, content);
      }
    }
    console.Message(fmt::format("{}: {}", frame, summary));
  };
  const size_t count = MakeVirtualViewsByModule(request);
  if (cloud_out) cloud_out->Commit();
  Finish(job, view, map, count, &out);
}

}  // namespace

void RunUndistort(const UndistortCommand& command, const ConsoleOptions& options) {
  const CalibrationFile calibration = ReadCalibration(command.calibration, CameraModels());
  const CalibratedCamera& camera = FindCamera(calibration, command.camera);
  const Job job{command, options, calibration, camera, FindImageInputs(command.images, "images")};
  CheckImageNames(job.images, command.out);
  if (camera.model->central) {
    UndistortOrdinary(job);
  } else {
    UndistortPlenoptic(job);
  }
}

}  // namespace plenocal
