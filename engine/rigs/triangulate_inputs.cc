// SPDX-License-Identifier: Apache-2.0
//
// Where points are seen: tables, the images of a session, places in images.
#include <fmt/format.h>

#include <algorithm>
#include <opencv2/core/mat.hpp>

#include "calib/base/format_error.h"
#include "calib/files/detections.h"
#include "calib/io/input_file.h"
#include "detectors/images/image.h"
#include "engine/observe/session_observations.h"
#include "engine/rigs/triangulate_points.h"
#include "engine/scene/track/epipolar_search.h"
#include "engine/scene/track/track_patch.h"
#include "engine/session/calibration_folder.h"
#include "engine/session/run_folders.h"
#include "engine/session/session_targets.h"

namespace plenocal {
namespace {

CalibrationRecord Open(const std::filesystem::path& path) {
  return std::filesystem::is_directory(path) ? OpenCalibrationFolder(path)
                                             : OpenWithCorrelations(path);
}

std::vector<SeenPoints> ReadTables(const CalibrationRecord& calibration,
                                   const TriangulateRequest& request) {
  std::vector<SeenPoints> seen;
  for (const auto& [camera, path] : request.files) {
    seen.push_back({.camera = camera,
                    .source = path.string(),
                    .views = ReadDetections(path, *FindCamera(calibration, camera).model)});
  }
  return seen;
}

// Finds points of one image in those of the other cameras.
class ImageMatches {
 public:
  ImageMatches(const CalibrationRecord& calibration, const TriangulateRequest& request)
      : request_(request) {
    std::vector<std::string> names;
    for (const auto& [name, path] : request.files) {
      const CalibratedCamera& camera = FindCamera(calibration, name);
      if (camera.model->plenoptic) {
        throw InputError(
            "{}: --at takes images of ordinary cameras, '{}' is plenoptic", path.string(), name);
      }
      const cv::Mat& image = images_.emplace_back(ReadGray(path));
      if (image.cols != camera.image_size[0] || image.rows != camera.image_size[1]) {
        throw InputError("{}: has {} x {} pixels, the calibration of '{}' {} x {}",
                         path.string(),
                         image.cols,
                         image.rows,
                         name,
                         camera.image_size[0],
                         camera.image_size[1]);
      }
      names.push_back(name);
    }
    cameras_ = MakeSpaceRig(calibration, names).cameras;
  }

  std::vector<SeenPoints> Find(const Run& run) const {
    std::vector<SeenPoints> seen;
    const std::string frame = request_.files[0].second.stem().string();
    for (const auto& [name, path] : request_.files) {
      seen.push_back({.camera = name,
                      .source = path.string(),
                      .views = {{.frame = frame, .observations = {}}},
                      .is_noise = true});
    }
    for (size_t i = 0; i < request_.at.size(); ++i) {
      const auto& [name, x, y] = request_.at[i];
      const auto from = std::ranges::find(seen, name, &SeenPoints::camera);
      if (from == seen.end()) {
        throw InputError("--at {}:{},{}: there is no image of that camera", name, x, y);
      }
      const auto c = static_cast<size_t>(from - seen.begin());
      const cv::Point2f point(static_cast<float>(x), static_cast<float>(y));
      for (size_t k = 0; k < seen.size(); ++k) {
        // The picked place defines the point.
        constexpr double kExact = 1e-3;  // px
        PatchPlace place{.point = point, .sigma = kExact};
        if (k != c && !Match(c, point, k, &place)) {
          run.Warning(fmt::format("point {}: no place in {} is clearly like that of {}",
                                  i,
                                  seen[k].source,
                                  seen[c].source));
          continue;
        }
        seen[k].views[0].observations.push_back(
            {.marker = static_cast<int>(i),
             .values = {k == c ? x : place.point.x, k == c ? y : place.point.y},
             .detector_sigma = std::max(place.sigma, kExact)});
      }
    }
    return seen;
  }

 private:
  bool Match(size_t from, const cv::Point2f& point, size_t to, PatchPlace* place) const {
    constexpr double kNearest = 2;  // baselines
    const std::optional<cv::Point2f> start = SearchEpipolarCurve(
        {&cameras_[from], &images_[from]}, point, {&cameras_[to], &images_[to]}, kNearest);
    if (!start) return false;
    const std::optional<PatchPlace> found =
        FitPatch(images_[from], point, images_[to], {.point = *start});
    if (found) *place = *found;
    return found.has_value();
  }

  const TriangulateRequest& request_;
  std::vector<cv::Mat> images_;
  std::vector<BundleCamera> cameras_;
};

}  // namespace

Triangulation TriangulatePoints(const TriangulateRequest& request, const Run& run) {
  const RunScope inputs;
  const CalibrationRecord calibration = Open(request.calibration);
  const std::vector<SeenPoints> seen = request.at.empty()
                                           ? ReadTables(calibration, request)
                                           : ImageMatches(calibration, request).Find(run);
  return TriangulatePoints(calibration, seen, request, run);
}

Triangulation TriangulatePoints(const Session& session,
                                const TriangulateRequest& request,
                                const Run& run) {
  const RunScope inputs;
  const CalibrationRecord calibration = Open(request.calibration);
  for (const SessionCamera& camera : session.cameras) {
    if (FindCamera(calibration, camera.name).model->plenoptic == camera.model->plenoptic) continue;
    throw InputError("{}: camera '{}' is {}plenoptic, but not so in {}",
                     session.path.string(),
                     camera.name,
                     camera.model->plenoptic ? "" : "not ",
                     calibration.path.string());
  }
  if (session.scene) {
    throw InputError("{}: has a scene in place of a target; give a target whose markers are found",
                     session.path.string());
  }
  const SessionTargets targets = ReadSessionTargets(session);
  for (const auto* sets : {&request.lengths, &request.angles, &request.planes}) {
    for (const std::vector<ScenePosition>& ends : *sets) {
      for (const ScenePosition& end : ends) {
        if (targets.several.empty() && !HasPosition(targets.all, end)) {
          throw InputError("{}: the target has no {}", session.path.string(), end.name);
        }
      }
    }
  }
  SessionOptions places;
  places.out = request.out;
  RunFolders folders(places, session, {"points.csv"});
  std::vector<SeenPoints> seen;
  for (CameraInput& camera :
       CollectObservations(session, targets, run, {folders.cache(), nullptr}).cameras) {
    seen.push_back(
        {.camera = camera.name, .source = session.path.string(), .views = std::move(camera.views)});
  }
  TriangulateRequest without_folder = request;
  without_folder.out.clear();
  Triangulation made = TriangulatePoints(calibration, seen, without_folder, run);
  if (OutputFolder* const out = folders.out()) WriteTriangulation(made, out);
  folders.Commit();
  return made;
}

}  // namespace plenocal
