// SPDX-License-Identifier: Apache-2.0
//
// Runs of the engine on sessions and calibrations.
#include <nanobind/stl/array.h>
#include <nanobind/stl/filesystem.h>
#include <nanobind/stl/map.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/pair.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/tuple.h>
#include <nanobind/stl/vector.h>

#include <filesystem>

#include "apps/cli/result_pictures.h"
#include "apps/report/report.h"
#include "apps/report/trial_page.h"
#include "apps/simulate/simulate.h"
#include "apps/suggest/suggestions_json.h"
#include "apps/suggest/view_sheet.h"
#include "assess/text/compare_text.h"
#include "assess/verdict.h"
#include "calib/base/format_error.h"
#include "calib/base/json_text.h"
#include "calib/base/names.h"
#include "calib/estimate/summary.h"
#include "calib/io/output_folder.h"
#include "engine/calibrate_session.h"
#include "engine/check_session.h"
#include "engine/detect_session.h"
#include "engine/json/calibration_json.h"
#include "engine/locate_images.h"
#include "engine/session/calibration_input.h"
#include "engine/session/memory_session.h"
#include "engine/suggest_views.h"
#include "engine/try_session.h"
#include "models/registry.h"
#include "python/src/record.h"
#include "python/src/run.h"

namespace plenocal::python {
namespace {

nb::tuple Calibrate(const CalibrateRequest& request, bool report, const Caller& caller) {
  auto [record, summary] = RunEngine(caller, [&](const Run& run) {
    SessionCalibration found = CalibrateSession(request, run);
    if (report && found.folders->out() != nullptr) AddReport(request.out, run, &found);
    found.folders->Commit();
    std::string text = Summary(found.calibration) + "\n" + VerdictText(*found.record.verdict);
    if (found.target) AddTarget(*found.target, &found.record);
    Record result{std::move(found.record), {request.out, {}}, std::move(found.target)};
    for (CameraFile& file : found.files) {
      result.files.contents[file.name] = std::move(file.content);
    }
    return std::pair(std::move(result), std::move(text));
  });
  return nb::make_tuple(std::move(record), summary);
}

/// The points of a camera as columns.
nb::dict PointsOf(const CameraInput& camera) {
  std::vector<std::string> frames;
  std::vector<Observation> points;
  for (const View& view : camera.views) {
    frames.insert(frames.end(), view.observations.size(), view.frame);
    points.insert(points.end(), view.observations.begin(), view.observations.end());
  }
  nb::dict columns;
  columns["frame"] = frames;
  columns["marker"] = ToColumn(points, [](const Observation& seen) { return seen.marker; });
  const std::vector<std::string> names = ValueNames(*camera.model);
  for (size_t k = 0; k < names.size(); ++k) {
    columns[names[k].c_str()] = ToColumn(points, [&](const auto& seen) { return seen.values[k]; });
  }
  columns["sigma"] = ToColumn(points, [](const auto& seen) { return seen.detector_sigma; });
  return columns;
}

/// By camera.
nb::dict Detect(const Session& session, const SessionOptions& options, const Caller& caller) {
  const std::vector<CameraInput> cameras = RunEngine(caller, [&](const Run& run) {
    DetectedSession found = DetectSession(session, options, run);
    found.folders->Commit();
    return std::move(found.observations.cameras);
  });
  nb::dict points;
  for (const CameraInput& camera : cameras) points[camera.name.c_str()] = PointsOf(camera);
  return points;
}

/// Content of try.csv.
std::string Try(const Session& session, const TryRequest& request, const Caller& caller) {
  return RunEngine(caller, [&](const Run& run) {
    const SessionTrial trial = TrySession(session, request, run);
    if (OutputFolder* const out = trial.folders->out()) out->Write("try.html", TrialPage(trial));
    trial.folders->Commit();
    return TrialCsv(trial.rows);
  });
}

/// Content of check.json.
std::string Check(const Record& calibration,
                  const Session& session,
                  const CheckRequest& request,
                  const Caller& caller) {
  return RunEngine(caller, [&](const Run& run) {
    const SessionCheck result = CheckSession(session, calibration.record, request, run);
    std::string json = JsonText(CheckJson(result.check)) + "\n";
    if (OutputFolder* const out = result.folders->out()) {
      out->Write("check.json", json);
      out->Write("difference.png", DifferencePicture(*result.comparison));
    }
    result.folders->Commit();
    return json;
  });
}

/// Content of compare.csv.
std::string Compare(const Record& a,
                    const Record& b,
                    const std::vector<std::string>& map,
                    const std::vector<double>& distances,
                    const std::filesystem::path& folder) {
  return Call([&] {
    CalibrationRecord other = b.record;
    RenameCameras(map, NamesOf(a.record.cameras), &other);
    const CalibrationComparison comparison = CompareCalibrations(a.record, other, distances);
    std::string csv = ComparisonCsv(comparison);
    if (const auto out = OpenOutput(folder)) {
      out->Write("compare.csv", csv);
      out->Write("difference.png", DifferencePicture(comparison));
      out->Commit();
    }
    return csv;
  });
}

SuggestedViews SuggestFor(const SuggestRequest& request, const Run& run, const Record& record) {
  if (!record.target) {
    throw InputError(
        "the calibration has no target; views are suggested for one of 'calibrate' before a target");
  }
  return SuggestViews(record.record, *record.target, request, run);
}
SuggestedViews SuggestFor(const SuggestRequest& request, const Run& run, const Session& session) {
  return SuggestViews(session, request, run);
}
SuggestedViews SuggestFor(const SuggestRequest& request, const Run& run) {
  return SuggestViews(request, run);
}

/// JSON of docs/suggest.md. `source`: in place of `SuggestRequest::input`.
template <typename... Source>
std::string Suggest(const SuggestRequest& request,
                    const std::filesystem::path& picture,
                    const Caller& caller,
                    const Source&... source) {
  return RunEngine(caller, [&](const Run& run) {
    std::optional<PictureFormat> format;
    if (!picture.empty()) format = PictureFormatOf(picture);
    const SuggestedViews suggested = SuggestFor(request, run, source...);
    if (format) {
      WriteOutput(picture, DrawViewSheet(suggested.views, suggested.rig, suggested.shape, *format));
    }
    return JsonText(SuggestionsJson(suggested));
  });
}

/// JSON of `plenocal suggest --image`.
std::string Weigh(const std::filesystem::path& calibration,
                  const std::map<std::string, std::filesystem::path>& pictures,
                  const Caller& caller) {
  std::map<std::string, FrameImage> images;
  for (const auto& [camera, path] : pictures) {
    images[camera] = {.frame = path.stem().string(), .path = path};
  }
  return RunEngine(caller, [&](const Run& run) {
    return JsonText(PictureGainJson(EvaluatePictures(calibration, images, run)));
  });
}

nb::list Locate(const Record& calibration,
                const LocateRequest& request,
                const std::vector<FramePixels>& images,
                const Caller& caller) {
  const std::vector<LocatedImage> found = RunEngine(caller, [&](const Run& run) {
    LocateRequest of_arrays = request;
    if (!images.empty()) of_arrays.given = ImagesInMemory("images", ViewsOf(images));
    return LocateImages(calibration.record, of_arrays, run);
  });
  nb::list poses;
  for (const auto& [name, located] : found) {
    const Eigen::Quaterniond q(located.T_map_camera.R);
    nb::dict pose;
    pose["image"] = name;
    pose["points"] = located.points;
    pose["used"] = located.used;
    pose["rms"] = located.rms;
    pose["translation"] =
        ToArray(std::vector(located.T_map_camera.t.begin(), located.T_map_camera.t.end()));
    pose["quaternion"] = ToArray(std::vector{q.x(), q.y(), q.z(), q.w()});
    pose["T_map_camera"] = ToArray(located.T_map_camera);
    pose["covariance"] = ToArray(Eigen::MatrixXd(located.covariance));
    poses.append(pose);
  }
  return poses;
}

std::string SimulateSession(const std::filesystem::path& specification,
                            const std::filesystem::path& out,
                            bool points,
                            const Caller& caller) {
  return RunEngine(caller, [&](const Run& run) {
    return Simulate({.spec = specification, .out = out, .points = points},
                    {.models = CameraModels(),
                     .threads = run.threads,
                     .progress = [&](const std::string& stage, size_t done, size_t total) {
                       return run.Progress(stage, done, total);
                     }});
  });
}

/// The requests as classes with the same members.
void BindRequests(nb::module_& module) {
  nb::class_<SessionOptions>(module, "SessionOptions")
      .def(nb::init<>())
      .def_rw("out", &SessionOptions::out)
      .def_rw("keep", &SessionOptions::keep)
      .def_rw("exclude", &SessionOptions::exclude)
      .def_rw("frames", &SessionOptions::frames)
      .def_rw("all", &SessionOptions::all)
      .def_rw("fresh", &SessionOptions::fresh);
  nb::class_<ImageArguments>(module, "ImageArguments")
      .def_rw("images", &ImageArguments::images)
      .def_rw("cameras", &ImageArguments::cameras)
      .def_rw("target", &ImageArguments::target);
  nb::class_<CalibrateRequest, SessionOptions>(module, "CalibrateRequest")
      .def(nb::init<>())
      .def_rw("session", &CalibrateRequest::session)
      .def_rw("images", &CalibrateRequest::images)
      .def_rw("model", &CalibrateRequest::model)
      .def_rw("jackknife", &CalibrateRequest::jackknife);
  nb::class_<TryRequest, SessionOptions>(module, "TryRequest")
      .def(nb::init<>())
      .def_rw("models", &TryRequest::models)
      .def_rw("camera", &TryRequest::camera)
      .def_rw("folds", &TryRequest::folds)
      .def_rw("stress", &TryRequest::stress);
  nb::class_<CheckRequest, SessionOptions>(module, "CheckRequest")
      .def(nb::init<>())
      .def_rw("map", &CheckRequest::map)
      .def_rw("distances", &CheckRequest::distances);
  nb::class_<SuggestRequest, SessionOptions>(module, "SuggestRequest")
      .def(nb::init<>())
      .def_rw("input", &SuggestRequest::input)
      .def_rw("model", &SuggestRequest::model)
      .def_rw("target", &SuggestRequest::target)
      .def_rw("size", &SuggestRequest::size)
      .def_rw("angle", &SuggestRequest::angle)
      .def_rw("count", &SuggestRequest::count)
      .def_rw("near", &SuggestRequest::nearest)
      .def_rw("far", &SuggestRequest::farthest)
      .def_rw("tilt", &SuggestRequest::tilt)
      .def_rw("goal", &SuggestRequest::goal)
      .def_rw("depth_at", &SuggestRequest::depth_at);
  nb::class_<LocateRequest>(module, "LocateRequest")
      .def(nb::init<>())
      .def_rw("map", &LocateRequest::map)
      .def_rw("target", &LocateRequest::target)
      .def_rw("images", &LocateRequest::images)
      .def_rw("camera", &LocateRequest::camera)
      .def_rw("white", &LocateRequest::white)
      .def_rw("out", &LocateRequest::out);
}

}  // namespace

void BindEngine(nb::module_& module) {
  BindRequests(module);
  module.def("calibrate", &Calibrate);
  module.def("detect_session", &Detect);
  module.def("try_models", &Try);
  module.def("check", &Check);
  module.def("compare", &Compare);
  module.def("suggest", &Suggest<>);
  module.def("suggest", &Suggest<Session>);
  module.def("suggest", &Suggest<Record>);
  module.def("weigh", &Weigh);
  module.def("locate", &Locate);
  module.def("simulate", &SimulateSession);
}

}  // namespace plenocal::python
