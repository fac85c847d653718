// SPDX-License-Identifier: Apache-2.0
//
// Runs of the engine. Each works in a thread of its own without the GIL, so that those of several
// Python threads go on side by side, while the calling thread looks for Ctrl-C.
#include <nanobind/stl/filesystem.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/pair.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/tuple.h>
#include <nanobind/stl/vector.h>

#include <atomic>
#include <chrono>
#include <filesystem>
#include <future>
#include <stop_token>
#include <tuple>

#include "apps/report/report.h"
#include "apps/report/trial_page.h"
#include "apps/simulate/simulate.h"
#include "assess/verdict.h"
#include "calib/base/error.h"
#include "calib/estimate/summary.h"
#include "calib/io/input_file.h"
#include "engine/calibrate_session.h"
#include "engine/detect_session.h"
#include "engine/session/calibration_input.h"
#include "engine/session/memory_session.h"
#include "engine/session/open_session.h"
#include "engine/try_session.h"
#include "models/registry.h"
#include "python/src/bindings.h"
#include "python/src/record.h"

namespace plenocal::python {
namespace {

/// Python functions that take what a run reports; None: it is not wanted.
struct Callbacks {
  nb::object progress, message;
};

/// Calls Python functions from the threads of a run.
Listener MakeListener(const Callbacks& callbacks) {
  const auto message = [&callbacks](const std::string& line, bool warning) {
    const nb::gil_scoped_acquire acquire;
    callbacks.message(line, warning);
  };
  Listener listener{.message = [message](const std::string& line) { message(line, false); },
                    .warning = [message](const std::string& line) { message(line, true); }};
  if (!callbacks.progress.is_none()) {
    listener.progress = [&callbacks](const std::string& stage, size_t done, size_t total) {
      const nb::gil_scoped_acquire acquire;
      const std::string text = std::to_string(done) + " of " + std::to_string(total);
      callbacks.progress(total > 0 ? stage + ": " + text : stage);
    };
  }
  return listener;
}

/// Runs `work` and gives its result, or raises what it threw: an exception of a callback or of a
/// camera model in Python, an error of the engine, KeyboardInterrupt.
template <typename Work>
auto RunEngine(const Callbacks& callbacks, int threads, const Work& work) {
  std::stop_source stop;
  const Run run{.listener = MakeListener(callbacks), .stop = stop.get_token(), .threads = threads};
  std::atomic<RunScope*> scope = nullptr;
  std::exception_ptr interrupted;
  auto result = [&] {
    const nb::gil_scoped_release release;
    return std::async(std::launch::async, [&] {
      RunScope own;
      scope = &own;
      return work(run);
    });
  }();
  const auto is_over = [&] {
    const nb::gil_scoped_release release;
    constexpr auto kPause = std::chrono::milliseconds(20);
    return result.wait_for(kPause) == std::future_status::ready;
  };
  while (!is_over()) {
    // Ceres' own threads are of no run.
    if (HasModelFailed(scope) || HasModelFailed(nullptr)) stop.request_stop();
    if (interrupted || PyErr_CheckSignals() == 0) continue;
    interrupted = std::make_exception_ptr(nb::python_error());
    stop.request_stop();
  }
  RethrowFromModel(scope);
  RethrowFromModel();
  if (interrupted) {
    result.wait();
    std::rethrow_exception(interrupted);
  }
  return result.get();
}

/// Images of a camera: frame and pixels (H, W) or (H, W, 3), rows in any distance.
using Pixels = nb::ndarray<nb::ro, nb::device::cpu>;
using FramePixels = std::pair<std::string, Pixels>;
/// Points of a frame: markers and rows of x, y, sigma.
using FramePoints = std::tuple<std::string, std::vector<int>, Rows>;
using CameraInMemory = std::tuple<std::string,
                                  std::string,
                                  std::vector<int>,
                                  std::vector<FramePixels>,
                                  std::vector<FramePoints>>;

PixelView ViewOf(const Pixels& pixels) {
  const auto bytes = static_cast<int>(pixels.itemsize());
  return {.data = pixels.data(),
          .size = {static_cast<int>(pixels.shape(1)), static_cast<int>(pixels.shape(0))},
          .stride = static_cast<size_t>(pixels.stride(0)) * pixels.itemsize(),
          .channels = pixels.ndim() == 3 ? static_cast<int>(pixels.shape(2)) : 1,
          .bytes_per_value = bytes};
}

View ViewOf(const FramePoints& points) {
  const auto& [frame, markers, rows] = points;
  View view{.frame = frame, .observations = {}};
  for (size_t i = 0; i < markers.size(); ++i) {
    Observation& seen = view.observations.emplace_back();
    seen.marker = markers[i];
    seen.values[0] = rows(i, 0);
    seen.values[1] = rows(i, 1);
    seen.detector_sigma = rows(i, 2);
  }
  return view;
}

/// The pixels are lent: the caller keeps the arrays.
Session SessionOfArrays(const std::string& target, const std::vector<CameraInMemory>& cameras) {
  std::vector<MemoryCamera> all;
  for (const auto& [name, model, size, images, points] : cameras) {
    MemoryCamera& camera = all.emplace_back();
    camera.name = name;
    camera.model = model.empty() ? nullptr : ModelNamed(name + ": model", model);
    if (size.size() == 2) camera.image_size = {size[0], size[1]};
    for (const auto& [frame, pixels] : images) camera.images.emplace_back(frame, ViewOf(pixels));
    for (const FramePoints& each : points) camera.views.push_back(ViewOf(each));
  }
  return SessionInMemory(target, all);
}

/// Options that the runs of a session share, as Python gives them.
using Options = std::tuple<std::filesystem::path, bool, bool, std::vector<std::string>>;

void SetOptions(const Options& options, SessionOptions* request) {
  std::tie(request->out, request->keep, request->fresh, request->exclude) = options;
}

nb::tuple Calibrate(const std::optional<Session>& session,
                    const std::vector<std::string>& images,
                    const std::string& target,
                    const std::string& model,
                    bool jackknife,
                    bool report,
                    const Options& options,
                    int threads,
                    const nb::object& progress,
                    const nb::object& message) {
  CalibrateRequest request;
  SetOptions(options, &request);
  request.session = session;
  request.images.images = images;
  request.images.target = target;
  request.model = model;
  request.jackknife = jackknife;
  auto [record, summary] = RunEngine({progress, message}, threads, [&](const Run& run) {
    SessionCalibration found = CalibrateSession(request, run);
    if (report && found.folders->out() != nullptr) AddReport(request.out, run, &found);
    found.folders->Commit();
    std::string text = Summary(found.calibration) + "\n" + VerdictText(*found.record.verdict);
    if (found.target) AddTarget(*found.target, &found.record);
    CameraFiles files{request.out, {}};
    for (CameraFile& file : found.files) files.contents[file.name] = std::move(file.content);
    return std::pair(Record{std::move(found.record), std::move(files)}, std::move(text));
  });
  return nb::make_tuple(std::move(record), summary);
}

std::vector<std::pair<std::string, size_t>> Detect(const Session& session,
                                                   const Options& options,
                                                   int threads,
                                                   const nb::object& progress,
                                                   const nb::object& message) {
  SessionOptions request;
  SetOptions(options, &request);
  return RunEngine({progress, message}, threads, [&](const Run& run) {
    const DetectedSession found = DetectSession(session, request, run);
    found.folders->Commit();
    std::vector<std::pair<std::string, size_t>> counts;
    for (const CameraInput& camera : found.observations.cameras) {
      counts.emplace_back(camera.name, CountObservations(camera.views));
    }
    return counts;
  });
}

/// Content of try.csv.
std::string Try(const Session& session,
                const std::vector<std::string>& models,
                const std::string& camera,
                int folds,
                const Options& options,
                int threads,
                const nb::object& progress,
                const nb::object& message) {
  TryRequest request;
  SetOptions(options, &request);
  request.models = models;
  request.camera = camera;
  request.folds = folds;
  return RunEngine({progress, message}, threads, [&](const Run& run) {
    const SessionTrial trial = TrySession(session, request, run);
    if (OutputFolder* const out = trial.folders->out()) out->Write("try.html", TrialPage(trial));
    trial.folders->Commit();
    return TrialCsv(trial.rows);
  });
}

std::string SimulateSession(const std::filesystem::path& specification,
                            const std::filesystem::path& out,
                            bool points,
                            int threads,
                            const nb::object& progress,
                            const nb::object& message) {
  return RunEngine({progress, message}, threads, [&](const Run& run) {
    return Simulate({.spec = specification, .out = out, .points = points},
                    {.models = CameraModels(),
                     .threads = run.threads,
                     .progress = [&](const std::string& stage, size_t done, size_t total) {
                       return run.Progress(stage, done, total);
                     }});
  });
}

}  // namespace

void BindEngine(nb::module_& module) {
  module.def("session_of_arrays", &SessionOfArrays, nb::arg("target"), nb::arg("cameras"));
  module.def("calibrate",
             &Calibrate,
             nb::arg("session").none(),
             nb::arg("images"),
             nb::arg("target"),
             nb::arg("model"),
             nb::arg("jackknife"),
             nb::arg("report"),
             nb::arg("options"),
             nb::arg("threads"),
             nb::arg("progress").none(),
             nb::arg("message"));
  module.def("detect_session",
             &Detect,
             nb::arg("session"),
             nb::arg("options"),
             nb::arg("threads"),
             nb::arg("progress").none(),
             nb::arg("message"));
  module.def("try_models",
             &Try,
             nb::arg("session"),
             nb::arg("models"),
             nb::arg("camera"),
             nb::arg("folds"),
             nb::arg("options"),
             nb::arg("threads"),
             nb::arg("progress").none(),
             nb::arg("message"));
  module.def("simulate",
             &SimulateSession,
             nb::arg("specification"),
             nb::arg("out"),
             nb::arg("points"),
             nb::arg("threads"),
             nb::arg("progress").none(),
             nb::arg("message"));
}

}  // namespace plenocal::python
