// SPDX-License-Identifier: Apache-2.0
#include "engine/images/rectify_images.h"

#include <fmt/format.h>

#include <algorithm>
#include <map>

#include "assess/central_view.h"
#include "calib/base/format_error.h"
#include "calib/base/number_text.h"
#include "calib/files/calibration_file.h"
#include "calib/files/detections.h"
#include "calib/files/session.h"
#include "calib/io/input_file.h"
#include "engine/formats/opencv_storage.h"
#include "engine/formats/pose_matrices.h"
#include "engine/observe/left_out.h"
#include "engine/recording/frames/session_frames.h"
#include "engine/recording/stores/image_lister.h"
#include "engine/resample/map_files.h"
#include "engine/resample/stereo_pairs.h"
#include "engine/session/calibration_folder.h"
#include "engine/session/open_session.h"

namespace plenocal {
namespace {

namespace fs = std::filesystem;

using Cameras = std::array<const CalibratedCamera*, 2>;

Cameras ChooseCameras(const CalibrationRecord& calibration, const std::vector<std::string>& names) {
  if (!names.empty()) {
    return {&FindCamera(calibration, names[0]), &FindCamera(calibration, names[1])};
  }
  if (calibration.cameras.size() == 2) return {&calibration.cameras[0], &calibration.cameras[1]};
  throw InputError("{}: holds {}; a pair is needed{}",
                   calibration.path.string(),
                   Counted(calibration.cameras.size(), "camera"),
                   calibration.cameras.size() > 2 ? ", choose two by --cameras LEFT RIGHT" : "");
}

/// One folder with the images of both cameras: in subfolders named after them, or in files whose
/// names contain the cameras'.
StereoImages FolderOfBoth(const fs::path& folder, const Cameras& cameras) {
  StereoImages images;
  for (size_t c = 0; c < 2; ++c) {
    const fs::path own = folder / cameras[c]->name;
    if (fs::is_directory(own)) {
      images[c] = FindImageInputs({own}, "images");
      continue;
    }
    for (const FrameImage& image : FindImageInputs({folder}, "images")) {
      const size_t at = image.frame.find(cameras[c]->name);
      if (at == std::string::npos) continue;
      images[c].push_back(image);
      images[c].back().frame.erase(at, cameras[c]->name.size());
    }
    if (!images[c].empty()) continue;
    throw InputError(
        "{}: has neither a folder '{}' nor images with that camera's name; give "
        "the images of both cameras, LEFT RIGHT",
        folder.string(),
        cameras[c]->name);
  }
  return images;
}

StereoImages FindImages(const RectifyRequest& request, const Cameras& cameras) {
  if (!request.session.empty()) {
    const Session session = OpenSession(request.session);
    StereoImages images;
    std::vector<std::string> notes;
    std::vector<std::vector<FrameImage>> all = ListSessionImages(session, &notes);
    for (size_t c = 0; c < 2; ++c) {
      const auto found =
          std::find_if(session.cameras.begin(), session.cameras.end(), [&](const auto& camera) {
            return camera.name == cameras[c]->name;
          });
      if (found == session.cameras.end() || found->images.empty()) {
        throw InputError(
            "{}: has no images of camera '{}'", request.session.string(), cameras[c]->name);
      }
      images[c] = all[static_cast<size_t>(found - session.cameras.begin())];
    }
    return images;
  }
  if (request.left.empty()) return {};
  if (request.right.empty() && fs::is_directory(request.left)) {
    return FolderOfBoth(request.left, cameras);
  }
  if (request.right.empty()) {
    throw InputError("the images of the second camera are missing; give LEFT RIGHT");
  }
  return {FindImageInputs({request.left}, "images"), FindImageInputs({request.right}, "images")};
}

/// Reports the distance at which the view is exact. Refuses a camera whose rows at other distances
/// are far from those at the target's, unless the user has chosen the distance.
void CheckDistance(const CentralView& view, const RectifyRequest& request, const Run& run) {
  constexpr double kMost = 1;  // px
  if (!request.view.distance && view.LargestError() > kMost) {
    throw JobError(
        "camera '{}': rays without a common origin move its pixels by up to {:.3g} px between half "
        "and twice the target's distance, by more than {} px; choose by --distance where the pair "
        "has to be exact",
        view.camera().name,
        view.LargestError(),
        kMost);
  }
  view.Report(run);
}

/// Images that belong together, with messages about those that do not.
StereoImages KeepPairs(StereoImages images, const Run& run) {
  StereoPairs pairs = PairImages(std::move(images));
  ReportLeftOut(pairs.left_out, run);
  if (pairs.by_number) {
    run.Message(fmt::format("paired by the numbers in their names: {} with {}",
                            pairs.images[0][0].path.string(),
                            pairs.images[1][0].path.string()));
  }
  return std::move(pairs.images);
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

/// How well the rectified views fit the calibration's own detections.
EpipolarCheck CheckEpipolar(const CalibrationRecord& calibration,
                            const RectifyRequest& request,
                            const RectifiedPair& pair,
                            const Cameras& cameras) {
  const fs::path folder =
      request.detections.empty() ? calibration.path.parent_path() : request.detections;
  EpipolarCheck check;
  std::array<std::vector<View>, 2> views;
  for (size_t c = 0; c < 2; ++c) {
    check.files[c] = folder / DetectionsName(cameras[c]->name);
    const bool is_in_memory = calibration.path.empty();
    if (request.detections.empty() && (is_in_memory || !fs::exists(check.files[c]))) {
      check.missing = check.files[c];
      return check;
    }
    views[c] = ReadDetections(check.files[c], *cameras[c]->model);
  }
  check.errors = MeasureEpipolarErrors(pair, cameras, views);
  return check;
}

/// Encoded images of both cameras by frame.
using Encoded = std::array<std::map<std::string, std::string>, 2>;

/// Writes preview/<frame>.png of each pair. Pairs are in the order of `images`.
void WritePreviews(const StereoImages& images, const Encoded& encoded, OutputFolder* out) {
  for (size_t i = 0; i < images[0].size(); ++i) {
    const std::string& frame = images[0][i].frame;
    const auto first = encoded[0].find(frame), second = encoded[1].find(images[1][i].frame);
    if (first == encoded[0].end() || second == encoded[1].end()) continue;
    out->Write(fmt::format("preview/{}.png", frame), DrawPair(first->second, second->second));
  }
}

}  // namespace

RectifiedImages RectifyImages(const RectifyRequest& request, const Run& run) {
  const RunScope inputs;
  return RectifyImages(OpenForViews(request.calibration), request, run);
}

RectifiedImages RectifyImages(const CalibrationRecord& calibration,
                              const RectifyRequest& request,
                              const Run& run) {
  const RunScope inputs;
  UseAsInput(calibration.path);
  const Cameras chosen = ChooseCameras(calibration, request.cameras);
  const CentralView first(calibration, *chosen[0], request.view.distance),
      second(calibration, *chosen[1], request.view.distance);
  for (const CentralView* view : {&first, &second}) CheckDistance(*view, request, run);
  const Cameras cameras{&first.camera(), &second.camera()};
  RectifiedImages made{.pair = Rectify(*cameras[0], *cameras[1], request.view)};
  StereoImages found = FindImages(request, cameras);
  for (const std::vector<FrameImage>& of_camera : found) {
    CheckImageNames(of_camera, ".png", request.settings.mask);
  }
  const StereoImages images = KeepPairs(std::move(found), run);
  if (request.preview && images[0].empty()) {
    throw InputError("--preview: there are no images; give LEFT RIGHT or --session");
  }
  for (const CalibratedCamera* camera : cameras) {
    if (!request.preview || camera->name != "preview") continue;
    throw InputError("--preview: a camera has the name of their folder, 'preview'");
  }
  for (size_t c = 0; c < 2; ++c) CheckImageSizes(images[c], cameras[c]->image_size);
  OutputFolder out(request.out);
  out.RefuseInputs({"calibration.yaml"});
  Encoded encoded;
  for (size_t c = 0; c < 2; ++c) {
    const PixelMap map = MapPixels(
        made.pair.views[c], *cameras[c], made.pair.R_view_camera[c].transpose(), run.threads);
    const std::string folder = cameras[c]->name + "/";
    if (!images[c].empty()) {
      made.images[c] = ResampleToFolder(images[c],
                                        {calibration,
                                         *cameras[c],
                                         map,
                                         request.settings,
                                         folder,
                                         request.preview ? &encoded[c] : nullptr},
                                        run,
                                        &out);
    }
    if (!request.maps && !request.settings.mask) continue;
    for (const auto& [name, content] : MapFiles(map, {}, "")) {
      if (name == "mask.png" ? request.settings.mask : request.maps) {
        out.Write(folder + name, content);
      }
    }
  }
  out.Write("calibration.yaml",
            GivenCamerasYaml(made.pair.views,
                             second.WithDistance(first.WithDistance(
                                 {{"plenocal_version", PLENOCAL_VERSION},
                                  {"rectified_from", calibration.path.string()}}))));
  out.Write("rectification.yaml", RectificationText(made.pair));
  WritePreviews(images, encoded, &out);
  out.Commit();
  made.epipolar = CheckEpipolar(calibration, request, made.pair, cameras);
  return made;
}

}  // namespace plenocal
