// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>

#include <array>
#include <memory>
#include <optional>

#include "apps/cli/command.h"
#include "apps/cli/image_inputs.h"
#include "apps/cli/options.h"
#include "apps/cli/resample_to_folder.h"
#include "apps/cli/view_options.h"
#include "calib/base/error.h"
#include "calib/base/number_text.h"
#include "calib/files/calibration_file.h"
#include "engine/resample/resample_images.h"
#include "engine/resample/virtual_image.h"
#include "engine/resample/virtual_view_images.h"
#include "models/registry.h"

namespace plenocal {
namespace {

/// Images of a camera that become those of a pinhole camera.
struct UndistortArguments {
  std::filesystem::path calibration;
  std::string camera;               ///< empty: the only one
  std::vector<std::string> images;  ///< folders, globs and files
  ViewArguments view;
  ResampleArguments resample;
  std::filesystem::path cloud;  ///< PLY of one plenoptic image; empty: none
  std::filesystem::path out;
};

namespace fs = std::filesystem;

/// The camera and its images, as ordinary and plenoptic cameras both need them.
struct UndistortJob {
  const UndistortArguments& arguments;
  const ConsoleOptions& shared;
  const CalibrationRecord& calibration;
  const CalibratedCamera& camera;
  std::vector<FrameImage> images;
};

/// The pinhole camera that the results are images of, and where it finds their pixels.
struct NewCamera {
  CalibratedCamera view;
  PixelMap map;
};

void Finish(const UndistortJob& job, const NewCamera& made, size_t count, OutputFolder* out) {
  if (job.arguments.resample.mask) {
    out->Write("mask.png", MapFiles(made.map, {}, "").at("mask.png"));
  }
  out->Write("calibration.yaml",
             GivenCamerasYaml(std::array{made.view},
                              {{"plenocal_version", PLENOCAL_VERSION},
                               {"undistorted_from", job.arguments.calibration.string()}}));
  out->Commit();
  Console(job.shared)
      .Print(fmt::format("{}: {}; {}\nwritten to {}\n",
                         made.view.name,
                         Counted(count, "image"),
                         ViewText(made.view),
                         job.arguments.out.string()));
}

void UndistortOrdinary(const UndistortJob& job) {
  if (!job.arguments.cloud.empty()) {
    throw Error(ErrorKind::kInput,
                fmt::format("--cloud: camera '{}' has no depth; only a plenoptic camera has",
                            job.camera.name));
  }
  const Eigen::Matrix3d no_rotation = Eigen::Matrix3d::Identity();
  const std::array seen{ImageOf(job.camera, no_rotation)};
  NewCamera made{ChoosePinhole(seen, ToViewOptions(job.arguments.view)), {}};
  made.view.name = job.camera.name;
  made.view.T_camera_rig = job.camera.T_camera_rig;
  OutputFolder out(job.arguments.out);
  out.RefuseInputs({"calibration.yaml"});
  made.map = MapPixels(made.view, job.camera, no_rotation, job.shared.threads);
  const size_t count = ResampleToFolder(
      job.images,
      {job.calibration, job.camera, made.map, job.arguments.resample, /*prefix=*/""},
      job.shared,
      &out);
  Finish(job, made, count, &out);
}

constexpr double kScale = 2;  // raw px per pixel of the virtual image, as for `plenocal focus`

void CheckPlenopticJob(const UndistortJob& job) {
  if (!job.arguments.resample.photometric.empty()) {
    throw Error(ErrorKind::kInput,
                fmt::format("--photometric: goes with ordinary cameras; '{}' is plenoptic",
                            job.camera.name));
  }
  if (job.camera.micro_lenses.empty()) {
    throw Error(
        ErrorKind::kInput,
        fmt::format(
            "{}: camera '{}' has no 'micro_lenses'; name there the micro_lenses_<camera>.csv that 'plenocal white' writes",
            job.calibration.path.string(),
            job.camera.name));
  }
  if (!job.arguments.cloud.empty() && job.images.size() > 1) {
    throw Error(ErrorKind::kInput,
                fmt::format("--cloud: holds one image, but there are {}", job.images.size()));
  }
}

CalibratedCamera ChooseView(const UndistortJob& job, const VirtualImage& virtual_image) {
  const std::array seen{virtual_image.Seen(kScale)};
  CalibratedCamera view = ChoosePinhole(seen, ToViewOptions(job.arguments.view));
  view.name = job.camera.name;
  view.T_camera_rig = virtual_image.ViewFromCamera() * job.camera.T_camera_rig;
  return view;
}

PixelMap MapVirtualImage(const CalibratedCamera& view,
                         const UndistortJob& job,
                         const VirtualImage& virtual_image) {
  return MapPixels(
      view,
      VirtualImage::SizeAt(job.camera.image_size, kScale),
      [&](const Eigen::Vector3d& direction) -> std::optional<Eigen::Vector2d> {
        const auto place = virtual_image.Place(direction);
        if (!place) return std::nullopt;
        return *place / kScale;
      },
      job.shared.threads);
}

/// The point cloud's folder, where it is not that of the other results: a folder takes the results
/// of one run at a time.
std::optional<OutputFolder> OwnCloudFolder(const UndistortArguments& arguments) {
  if (arguments.cloud.empty()) return std::nullopt;
  const fs::path parent = arguments.cloud.parent_path();
  const fs::path folder = parent.empty() ? "." : parent;
  if (fs::weakly_canonical(folder) == fs::weakly_canonical(arguments.out)) return std::nullopt;
  return std::optional<OutputFolder>(std::in_place, folder);
}

void UndistortPlenoptic(const UndistortJob& job) {
  const CalibratedCamera& camera = job.camera;
  const VirtualImage virtual_image(camera);
  NewCamera made{ChooseView(job, virtual_image), {}};
  CheckPlenopticJob(job);
  OutputFolder out(job.arguments.out);
  out.RefuseInputs({"calibration.yaml"});
  std::optional<OutputFolder> cloud_out = OwnCloudFolder(job.arguments);
  made.map = MapVirtualImage(made.view, job, virtual_image);

  Console console(job.shared);
  VirtualViewRequest request;
  request.images = job.images;
  request.virtual_image = &virtual_image;
  request.scale = kScale;
  request.map = &made.map;
  request.raw_size = camera.image_size;
  const fs::path folder = job.calibration.path.parent_path();
  request.grid = folder / camera.micro_lenses;
  if (!camera.vignetting.empty()) request.vignetting = folder / camera.vignetting;
  request.bayer = job.arguments.resample.bayer;
  request.interpolation = job.arguments.resample.interpolation;
  request.cloud = !job.arguments.cloud.empty();
  request.threads = job.shared.threads;
  request.message = [&](const std::string& line) { console.Message(line); };
  std::string place;  // "2 of 7"
  request.progress = [&](size_t done) {
    place = fmt::format("{} of {}", done + 1, job.images.size());
    return console.Progress(
        fmt::format("{}: image {}, {}", camera.name, place, job.images[done].frame));
  };
  request.result = [&](const std::string& frame, const auto& files, const std::string& summary) {
    for (const auto& [suffix, content] : files) {
      if (suffix == ".ply") {
        (cloud_out ? *cloud_out : out).Write(job.arguments.cloud.filename().string(), content);
      } else {
        out.Write(frame + suffix, content);
      }
    }
    console.Message(fmt::format("image {}, {}: {}", place, frame, summary));
  };
  const size_t count = MakeVirtualViews(request);
  if (cloud_out) cloud_out->Commit();
  Finish(job, made, count, &out);
}

void RunUndistort(const UndistortArguments& arguments, const ConsoleOptions& shared) {
  const CalibrationRecord calibration = ReadCalibration(arguments.calibration, CameraModels());
  const CalibratedCamera& camera = FindCamera(calibration, arguments.camera);
  const UndistortJob job{
      arguments, shared, calibration, camera, FindImageInputs(arguments.images, "images")};
  CheckImageNames(job.images);
  if (camera.model->central) {
    UndistortOrdinary(job);
  } else {
    UndistortPlenoptic(job);
  }
}

constexpr const char* kUndistortHelp =
    "Images without distortion, as a pinhole camera takes them.\n"
    "\n"
    "  plenocal undistort calibration.yaml --camera NAME IMAGES... -o DIR\n"
    "\n"
    "writes DIR/<image>.png (depth and colours of the image; black without source) and DIR/calibration.yaml, the new camera; of raw plenoptic images the totally focused image, DIR/<image>_depth.tiff and _depth_sigma.tiff (z and its sigma in metres, NaN unknown).";

RunCommand DeclareUndistort(CLI::App* app, ConsoleOptions* shared) {
  const auto arguments = std::make_shared<UndistortArguments>();
  app->add_option("calibration", arguments->calibration, "calibration.yaml")->required();
  app->add_option("images", arguments->images, "images: files, globs or folders")->required();
  app->add_option("--camera", arguments->camera, "camera of the images (default: the only)")
      ->expected(1);
  app->add_option(
      "--cloud", arguments->cloud, "FILE.ply: point cloud of one raw plenoptic image, m");
  app->add_option("-o,--out", arguments->out, "folder for the results")->required();
  AddViewOptions(app, &arguments->view);
  AddResampleOptions(app, &arguments->resample);
  AddThreads(app, shared);
  AddQuiet(app, shared);
  return [arguments, shared] { RunUndistort(*arguments, *shared); };
}

}  // namespace

Command UndistortCommand() { return {"undistort", kUndistortHelp, DeclareUndistort}; }

}  // namespace plenocal
