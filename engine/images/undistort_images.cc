// SPDX-License-Identifier: Apache-2.0
#include "engine/images/undistort_images.h"

#include <fmt/format.h>

#include <array>
#include <optional>

#include "assess/central_view.h"
#include "calib/base/format_error.h"
#include "calib/files/calibration_file.h"
#include "calib/io/input_file.h"
#include "engine/recording/stores/image_lister.h"
#include "engine/resample/map_files.h"
#include "engine/resample/virtual_image.h"
#include "engine/resample/virtual_view_images.h"
#include "engine/session/calibration_folder.h"

namespace plenocal {
namespace {

/// The camera and its images, as ordinary and plenoptic cameras both need them.
struct UndistortJob {
  const UndistortRequest& request;
  const Run& run;
  const CalibrationRecord& calibration;
  const CalibratedCamera& camera;
  std::vector<FrameImage> images;
};

UndistortedImages Finish(const UndistortJob& job,
                         const CalibratedCamera& view,
                         const PixelMap& map,
                         size_t count,
                         const Provenance& provenance,
                         OutputFolder* out) {
  if (job.request.settings.mask) out->Write("mask.png", MapFiles(map, {}, "").at("mask.png"));
  out->Write("calibration.yaml", GivenCamerasYaml(std::array{view}, provenance));
  out->Commit();
  return {view, count};
}

Provenance ProvenanceOf(const UndistortJob& job) {
  return {{"plenocal_version", PLENOCAL_VERSION},
          {"undistorted_from", job.calibration.path.string()}};
}

UndistortedImages UndistortOrdinary(const UndistortJob& job) {
  if (!job.request.cloud.empty()) {
    throw InputError("--cloud: camera '{}' has no depth; only a plenoptic camera has",
                     job.camera.name);
  }
  const CentralView central(job.calibration, job.camera, job.request.view.distance);
  central.Report(job.run);
  const CalibratedCamera view = UndistortedView(central.camera(), job.request.view);
  CheckImageSizes(job.images, job.camera.image_size);
  OutputFolder out(job.request.out);
  out.RefuseInputs({"calibration.yaml"});
  const PixelMap map =
      MapPixels(view, central.camera(), Eigen::Matrix3d::Identity(), job.run.threads);
  const size_t count =
      ResampleToFolder(job.images,
                       {job.calibration, job.camera, map, job.request.settings, /*prefix=*/""},
                       job.run,
                       &out);
  return Finish(job, view, map, count, central.WithDistance(ProvenanceOf(job)), &out);
}

constexpr double kScale = 2;  // raw px per pixel of the virtual image, as for `plenocal focus`

void CheckPlenopticJob(const UndistortJob& job) {
  const ResampleSettings& settings = job.request.settings;
  if (!settings.photometric.empty() || settings.keep_vignetting) {
    throw InputError("{}: goes with ordinary cameras; '{}' is plenoptic",
                     settings.keep_vignetting ? "--keep-vignetting" : "--photometric",
                     job.camera.name);
  }
  if (job.camera.micro_lenses.empty()) {
    throw InputError(
        "{}: camera '{}' has no 'micro_lenses'; name there the micro_lenses_<camera>.csv that 'plenocal white' writes",
        job.calibration.path.string(),
        job.camera.name);
  }
  if (!job.request.cloud.empty() && job.images.size() > 1) {
    throw InputError("--cloud: holds one image, but there are {}", job.images.size());
  }
}

CalibratedCamera ChooseView(const UndistortJob& job, const VirtualImage& virtual_image) {
  const std::array seen{virtual_image.Seen(kScale)};
  CalibratedCamera view = ChoosePinhole(seen, job.request.view);
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
      job.run.threads);
}

/// The point cloud's folder, where it is not that of the other results: a folder takes the results
/// of one run at a time.
std::optional<OutputFolder> OwnCloudFolder(const UndistortRequest& request) {
  if (request.cloud.empty()) return std::nullopt;
  const std::filesystem::path parent = request.cloud.parent_path();
  const std::filesystem::path folder = parent.empty() ? "." : parent;
  if (std::filesystem::weakly_canonical(folder) == std::filesystem::weakly_canonical(request.out))
    return std::nullopt;
  return std::optional<OutputFolder>(std::in_place, folder);
}

UndistortedImages UndistortPlenoptic(const UndistortJob& job) {
  const CalibratedCamera& camera = job.camera;
  const VirtualImage virtual_image(camera);
  const CalibratedCamera view = ChooseView(job, virtual_image);
  CheckPlenopticJob(job);
  OutputFolder out(job.request.out);
  out.RefuseInputs({"calibration.yaml"});
  std::optional<OutputFolder> cloud_out = OwnCloudFolder(job.request);
  const PixelMap map = MapVirtualImage(view, job, virtual_image);

  VirtualViewRequest views;
  views.images = job.images;
  views.virtual_image = &virtual_image;
  views.scale = kScale;
  views.map = &map;
  views.raw_size = camera.image_size;
  views.grid = FileBeside(job.calibration, camera.micro_lenses);
  if (!camera.vignetting.empty()) {
    views.vignetting = FileBeside(job.calibration, camera.vignetting);
  }
  views.bayer = job.request.settings.bayer;
  views.interpolation = job.request.settings.interpolation;
  views.cloud = !job.request.cloud.empty();
  views.threads = job.run.threads;
  views.message = [&](const std::string& line) { job.run.Message(line); };
  std::string place;  // "2 of 7"
  views.progress = [&](size_t done) {
    place = fmt::format("{} of {}", done + 1, job.images.size());
    return job.run.Progress(
        fmt::format("{}: image {}, {}", camera.name, place, job.images[done].frame));
  };
  views.result = [&](const std::string& frame, const auto& files, const std::string& summary) {
    for (const auto& [suffix, content] : files) {
      if (suffix == ".ply") {
        (cloud_out ? *cloud_out : out).Write(job.request.cloud.filename().string(), content);
      } else {
        out.Write(frame + suffix, content);
      }
    }
    job.run.Message(fmt::format("image {}, {}: {}", place, frame, summary));
  };
  const size_t count = MakeVirtualViews(views);
  if (cloud_out) cloud_out->Commit();
  return Finish(job, view, map, count, ProvenanceOf(job), &out);
}

}  // namespace

UndistortedImages UndistortImages(const UndistortRequest& request, const Run& run) {
  const RunScope inputs;
  return UndistortImages(OpenForViews(request.calibration), request, run);
}

UndistortedImages UndistortImages(const CalibrationRecord& calibration,
                                  const UndistortRequest& request,
                                  const Run& run) {
  const RunScope inputs;
  UseAsInput(calibration.path);
  const CalibratedCamera& camera = FindCamera(calibration, request.camera);
  const UndistortJob job{
      request, run, calibration, camera, FindImageInputs(request.images, "images")};
  CheckImageNames(job.images, ".png", job.request.settings.mask);
  return camera.model->plenoptic ? UndistortPlenoptic(job) : UndistortOrdinary(job);
}

}  // namespace plenocal
