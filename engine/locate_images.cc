// SPDX-License-Identifier: Apache-2.0
#include "engine/locate_images.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>

#include "calib/base/format_error.h"
#include "calib/base/names.h"
#include "calib/base/number_text.h"
#include "calib/base/quoted_text.h"
#include "calib/files/detections.h"
#include "calib/io/input_file.h"
#include "calib/io/output_folder.h"
#include "detectors/detect.h"
#include "detectors/images/image.h"
#include "engine/observe/left_out.h"
#include "engine/recording/stores/image_lister.h"
#include "engine/session/calibration_folder.h"
#include "targets/target.h"

namespace plenocal {
namespace {

/// A view and the image that it comes from.
struct NamedView {
  std::string name;
  View view;
};

/// Observations in images, and the positions of the points.
struct ObservedImages {
  std::vector<NamedView> views;
  std::map<int, Eigen::Vector3d> points;
  Numbering numbering = Numbering::kByMarker;
};

bool IsTable(const std::filesystem::path& path) { return path.extension() == ".csv"; }

void CheckSize(const CalibratedCamera& camera, ImageSize size, const std::string& image) {
  if (size == camera.image_size) return;
  throw InputError("{}: {} px, but the calibration of '{}' is for {}",
                   image,
                   fmt::join(size, " x "),
                   camera.name,
                   fmt::join(camera.image_size, " x "));
}

std::vector<FrameImage> ImagesOf(const LocateRequest& request) {
  return request.given.empty() ? FindImageInputs(request.images, "images") : request.given;
}

std::string NameOf(const LocateRequest& request, const FrameImage& image) {
  return request.given.empty() ? image.path.string() : image.frame;
}

std::string MapName(const LocateRequest& request) {
  return request.target ? "the target" : request.map.string();
}

/// The target's markers in the images.
void DetectMarkers(const LocateRequest& request,
                   const Target& target,
                   const CalibratedCamera& camera,
                   const Run& run,
                   ObservedImages* seen) {
  const std::vector<FrameImage> images = ImagesOf(request);
  const DetectOptions options{
      .white_images = request.white.empty() ? std::vector<FrameImage>()
                                            : FindImageInputs(request.white, "white images"),
      .bayer = request.bayer,
      .threads = run.threads,
      .progress = [&](size_t done) { return run.Progress("images", done, images.size()); }};
  ImageDetections found =
      DetectImages(images,
                   target,
                   camera.model->plenoptic ? CameraOptics::kPlenoptic : CameraOptics::kOrdinary,
                   options);
  CheckSize(camera,
            found.image_size,
            request.given.empty() ? request.images[0] : images[0].path.string());
  if (camera.model->assign_lens_types != nullptr) camera.model->assign_lens_types(&found.views);
  for (const FrameImage& image : images) {
    const auto same = [&](const View& view) { return view.frame == image.frame; };
    const auto view = std::ranges::find_if(found.views, same);
    seen->views.push_back({NameOf(request, image), view == found.views.end() ? View{} : *view});
  }
}

/// Micro lenses and attenuation from the white images.
PlenopticCamera OpticsOf(const LocateRequest& request,
                         const CalibratedCamera& camera,
                         const Run& run) {
  if (request.white.empty()) {
    throw InputError("camera '{}' is plenoptic: give its white images with --white", camera.name);
  }
  std::vector<LeftOut> left_out;
  PlenopticCamera optics = MeasurePlenopticCamera(
      FindImageInputs(request.white, "white images"), request.bayer, run.threads, &left_out);
  ReportLeftOut(left_out, run);
  return optics;
}

/// Points of a map in the images, by their descriptors.
void MatchPoints(const LocateRequest& request,
                 const CalibratedCamera& camera,
                 const LandmarkMap& map,
                 const Run& run,
                 ObservedImages* seen) {
  if (map.descriptors.empty()) {
    throw InputError(
        "{}: no descriptors.png beside it, by which points are recognised in "
        "images; give detections (CSV) in their place",
        request.map.string());
  }
  std::optional<PlenopticCamera> optics;
  if (camera.model->plenoptic) optics = OpticsOf(request, camera, run);
  const std::vector<FrameImage> images = ImagesOf(request);
  for (const FrameImage& image : images) {
    if (!run.Progress("images", seen->views.size(), images.size())) throw Stopped();
    const cv::Mat pixels = optics ? ReadImage(image) : ReadGray(image);
    CheckSize(camera, {pixels.cols, pixels.rows}, image.path.string());
    seen->views.push_back({NameOf(request, image),
                           optics ? MatchLandmarks(pixels, camera, *optics, map, run.threads)
                                  : MatchLandmarks(pixels, map)});
  }
  seen->numbering = Numbering::kByAppearance;
}

ObservedImages FindObservations(const LocateRequest& request,
                                const CalibratedCamera& camera,
                                const Run& run) {
  ObservedImages seen;
  LandmarkMap map;
  std::optional<Target> target = request.target;
  if (!target && IsTable(request.map)) {
    map = ReadLandmarkMap(request.map);
  } else if (!target) {
    target = ReadTarget(request.map);
  }
  seen.points = target ? target->markers : map.points;
  if (request.given.empty() && IsTable(request.images[0])) {
    for (const std::string& input : request.images) {
      for (View& view : ReadDetections(input, *camera.model)) {
        seen.views.push_back({view.frame, std::move(view)});
      }
    }
  } else if (target) {
    DetectMarkers(request, *target, camera, run, &seen);
  } else {
    MatchPoints(request, camera, map, run, &seen);
  }
  return seen;
}

std::string HeaderText() {
  std::string text = "image,points,used,rms,x,y,z,qx,qy,qz,qw";
  for (size_t i = 0; i < kExtrinsicsNames.size(); ++i) {
    for (size_t j = i; j < kExtrinsicsNames.size(); ++j) {
      text += fmt::format(",cov_{}_{}", kExtrinsicsNames[i], kExtrinsicsNames[j]);
    }
  }
  return text + "\n";
}

std::string RowText(const std::string& name, const LocatedView& located) {
  const Eigen::Quaterniond q(located.T_map_camera.R);
  const Eigen::Vector3d& t = located.T_map_camera.t;
  std::string text =
      fmt::format("{},{},{},{:.6g},{:.12g},{:.12g},{:.12g},{:.12g},{:.12g},{:.12g},{:.12g}",
                  CsvCell(name),
                  located.points,
                  located.used,
                  located.rms,
                  t.x(),
                  t.y(),
                  t.z(),
                  q.x(),
                  q.y(),
                  q.z(),
                  q.w());
  for (Eigen::Index i = 0; i < 6; ++i) {
    for (Eigen::Index j = i; j < 6; ++j) text += fmt::format(",{:.9g}", located.covariance(i, j));
  }
  return text + "\n";
}

}  // namespace

std::vector<LocatedImage> LocateImages(const LocateRequest& request, const Run& run) {
  const RunScope inputs;
  return LocateImages(OpenCalibration(request.calibration), request, run);
}

std::vector<LocatedImage> LocateImages(const CalibrationRecord& calibration,
                                       const LocateRequest& request,
                                       const Run& run) {
  const RunScope inputs;
  UseAsInput(calibration.path);
  if (request.images.empty() && request.given.empty()) {
    throw InputError("locate: give images, or detections (CSV)");
  }
  const CalibratedCamera& camera = FindCamera(calibration, request.camera);
  const ObservedImages seen = FindObservations(request, camera, run);
  std::vector<LocatedImage> images;
  std::string csv = HeaderText();
  for (const NamedView& each : seen.views) {
    const std::optional<LocatedView> located =
        LocateView(camera, each.view, seen.points, seen.numbering);
    if (!located) {
      run.Message(fmt::format(
          "  left out {}: shows too few points of {} for a pose", each.name, MapName(request)));
      continue;
    }
    if (located->alternative && located->alternative->IsAmbiguous()) {
      run.Message(fmt::format(
          "  left out {}: fits in two ways: {}", each.name, located->alternative->Text()));
      continue;
    }
    csv += RowText(each.name, *located);
    images.push_back({each.name, *located});
  }
  if (images.empty()) {
    throw JobError(
        "none of {} has a pose before {}", Counted(seen.views.size(), "image"), MapName(request));
  }
  if (!request.out.empty()) WriteOutput(request.out, csv);
  return images;
}

}  // namespace plenocal
