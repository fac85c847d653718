// SPDX-License-Identifier: Apache-2.0
#include "engine/api/plenocal/engine.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <limits>
#include <utility>

#include "assess/verdict.h"
#include "calib/base/format_error.h"
#include "calib/estimate/summary.h"
#include "calib/files/calibration_file.h"
#include "engine/api/data.h"
#include "engine/calibrate_session.h"
#include "engine/check_session.h"
#include "engine/detect_session.h"
#include "engine/locate_images.h"
#include "engine/session/calibration_folder.h"
#include "engine/session/memory_session.h"
#include "engine/session/open_session.h"
#include "engine/session/session_targets.h"
#include "engine/suggest_views.h"
#include "engine/try_session.h"
#include "models/registry.h"

namespace plenocal::api {
namespace {

constexpr double kNan = std::numeric_limits<double>::quiet_NaN();

View ViewOf(const FramePoints& frame) {
  View view{.frame = frame.frame, .observations = {}};
  for (const Point& point : frame.points) {
    Observation& seen = view.observations.emplace_back();
    seen.marker = point.marker;
    seen.values[0] = point.x;
    seen.values[1] = point.y;
    seen.detector_sigma = point.sigma;
  }
  return view;
}

FramePoints PointsOf(const View& view) {
  FramePoints frame{.frame = view.frame, .points = {}};
  for (const Observation& seen : view.observations) {
    frame.points.push_back({seen.marker, seen.values[0], seen.values[1], seen.detector_sigma});
  }
  return frame;
}

MemoryImages ViewsOf(const std::vector<Image>& images) {
  MemoryImages views;
  for (const Image& image : images) {
    views.emplace_back(image.frame,
                       PixelView{.data = image.data,
                                 .size = {image.width, image.height},
                                 .stride = image.stride,
                                 .channels = image.channels,
                                 .bytes_per_value = image.bytes_per_value});
  }
  return views;
}

MemoryCamera CameraOf(const Source& source) {
  MemoryCamera camera{
      .name = source.name,
      .model = source.model.empty() ? nullptr : ModelNamed(source.name + ": model", source.model),
      .images = ViewsOf(source.images),
      .image_size = {source.width, source.height}};
  for (const FramePoints& frame : source.points) camera.views.push_back(ViewOf(frame));
  return camera;
}

std::vector<Finding> FindingsOf(const Verdict& verdict) {
  std::vector<Finding> findings;
  for (const plenocal::Finding& finding : verdict.findings) {
    findings.push_back({finding.code, finding.what, finding.remedy});
  }
  return findings;
}

Calibration CalibrationOf(Calibration::Data data) {
  const CalibrationRecord& record = data.record;
  Calibration calibration;
  for (const CalibratedCamera& camera : record.cameras) {
    if (camera.model->plenoptic) continue;
    calibration.cameras.emplace_back(std::make_shared<const Camera::Data>(Camera::Data{camera}));
  }
  if (record.verdict) {
    calibration.grade = static_cast<Grade>(record.verdict->grade);
    calibration.findings = FindingsOf(*record.verdict);
  }
  calibration.yaml = record.adjustment ? CalibrationYaml(record)
                                       : GivenCamerasYaml(record.cameras, record.provenance);
  calibration.data = std::make_shared<const Calibration::Data>(std::move(data));
  return calibration;
}

const Calibration::Data& DataOf(const Calibration& calibration) {
  if (calibration.data) return *calibration.data;
  throw InputError("this calibration is empty; use one of Calibration::Read or CalibrateSession");
}

}  // namespace

Session Session::Open(const std::string& path) {
  return Session(std::make_shared<const Data>(Data{OpenSession(path)}));
}

Session Session::InMemory(const std::string& target, const std::vector<Source>& cameras) {
  std::vector<MemoryCamera> all;
  for (const Source& source : cameras) all.push_back(CameraOf(source));
  return Session(std::make_shared<const Data>(Data{SessionInMemory(target, all)}));
}

Calibration Calibration::Read(const std::string& path) {
  if (std::filesystem::is_directory(path)) {
    return CalibrationOf({OpenCalibrationFolder(path)});
  }
  return CalibrationOf({OpenWithCorrelations(path)});
}

const Camera& Calibration::operator[](const std::string& name) const {
  for (const Camera& camera : cameras) {
    if (camera.name() == name) return camera;
  }
  throw Error(ErrorKind::kInput, fmt::format("the calibration has no ordinary camera '{}'", name));
}

Calibration CalibrateSession(const Session& session, const Options& options, const Run& run) {
  CalibrateRequest request;
  request.out = options.out;
  request.jackknife = options.jackknife;
  request.session = session.data().session;
  SessionCalibration found = plenocal::CalibrateSession(request, run);
  found.folders->Commit();
  if (found.target) AddTarget(*found.target, &found.record);
  std::string summary = Summary(found.calibration) + "\n" + VerdictText(*found.record.verdict);
  Calibration calibration = CalibrationOf({std::move(found.record), std::move(found.target)});
  calibration.summary = std::move(summary);
  return calibration;
}

std::vector<Source> DetectSession(const Session& session, const Run& run) {
  const DetectedSession found = plenocal::DetectSession(session.data().session, {}, run);
  std::vector<Source> sources;
  for (const CameraInput& camera : found.observations.cameras) {
    if (camera.model->plenoptic) continue;
    Source& source =
        sources.emplace_back(Source{.name = camera.name, .model = std::string(camera.model->name)});
    for (const View& view : camera.views) source.points.push_back(PointsOf(view));
    source.width = camera.image_size[0];
    source.height = camera.image_size[1];
  }
  return sources;
}

std::vector<TriedModel> TrySession(const Session& session,
                                   const std::vector<std::string>& models,
                                   const Run& run) {
  TryRequest request;
  request.models = models;
  const SessionTrial trial = plenocal::TrySession(session.data().session, request, run);
  std::vector<TriedModel> tried;
  for (const TrialRow& row : trial.rows) {
    tried.push_back({.model = std::string(row.trial->model->name),
                     .recommended = row.recommended,
                     .held_out_rms = row.trial->comparable ? row.trial->rms : kNan,
                     .judgement = row.why_not.empty() ? row.judgement : row.why_not});
  }
  return tried;
}

Check CheckSession(const Calibration& calibration, const Session& session, const Run& run) {
  const CalibrationCheck found =
      plenocal::CheckSession(
          session.data().session, DataOf(calibration).record, CheckRequest(), run)
          .check;
  Check check{.valid = found.valid, .cameras = {}, .findings = FindingsOf(JudgeCheck(found))};
  for (const CameraCheck& camera : found.cameras) {
    check.cameras.push_back({.name = camera.name,
                             .valid = camera.valid,
                             .points = camera.points,
                             .rms = camera.rms_held,
                             .expected = camera.expected,
                             .rotation = camera.rotation,
                             .translation = camera.translation});
  }
  return check;
}

std::vector<Difference> CompareCalibrations(const Calibration& a,
                                            const Calibration& b,
                                            const std::vector<double>& distances) {
  const CalibrationComparison comparison =
      plenocal::CompareCalibrations(DataOf(a).record, DataOf(b).record, distances);
  std::vector<Difference> differences;
  for (size_t c = 0; c < comparison.differences.size(); ++c) {
    const CameraDifference& camera = comparison.differences[c];
    for (const DistanceDifference& at : camera.distances) {
      differences.push_back({.camera = comparison.a[c].name,
                             .distance = at.distance,
                             .rms = at.all.rms,
                             .largest = at.all.largest,
                             .predicted = camera.has_prediction ? at.all.predicted : kNan,
                             .differs = at.all.differs});
    }
  }
  return differences;
}

std::vector<SuggestedView> SuggestViews(const Calibration& calibration,
                                        const SuggestOptions& options,
                                        const Run& run) {
  const auto& [record, target] = DataOf(calibration);
  SuggestRequest request;
  request.count = options.count;
  request.nearest = options.nearest;
  request.farthest = options.farthest;
  request.tilt = options.tilt;
  request.goal = options.goal;
  request.input = record.path;
  const SuggestedViews found = target ? plenocal::SuggestViews(record, *target, request, run)
                                      : plenocal::SuggestViews(request, run);
  std::vector<SuggestedView> views;
  for (const NextView& view : found.views.views) {
    const BundleCamera& camera = found.rig.bundle.cameras[view.pose.camera];
    const bool known = view.criterion == ViewCriterion::kSigma;
    views.push_back({.words = NextViewText(view, found.rig, found.views.lowered),
                     .camera = camera.name,
                     .T_camera_target = MatrixOf(camera.T_camera_rig * view.T_rig_target),
                     .sigma_before = known ? view.sigma_before : INFINITY,
                     .sigma_after = known ? view.sigma_after : INFINITY});
  }
  return views;
}

std::vector<Location> LocateImages(const Calibration& calibration,
                                   const std::string& camera,
                                   const std::string& target,
                                   const std::vector<Image>& images,
                                   const Run& run) {
  LocateRequest request;
  request.target = ReadTarget(TargetNamed(target));
  request.camera = camera;
  request.given = ImagesInMemory(camera.empty() ? "image" : camera, ViewsOf(images));
  std::vector<Location> locations;
  for (const auto& [frame, located] :
       plenocal::LocateImages(DataOf(calibration).record, request, run)) {
    Location& location =
        locations.emplace_back(Location{.frame = frame,
                                        .T_target_camera = MatrixOf(located.T_map_camera),
                                        .points = located.points,
                                        .used = located.used,
                                        .rms = located.rms});
    using RowMajor = Eigen::Matrix<double, 6, 6, Eigen::RowMajor>;
    Eigen::Map<RowMajor>(location.covariance.data()) = located.covariance;
  }
  return locations;
}

}  // namespace plenocal::api
