// SPDX-License-Identifier: Apache-2.0
#include "apps/workbench/worker/worker.h"

#include <fmt/format.h>
#include <malloc.h>

#include <filesystem>
#include <map>
#include <new>
#include <optional>
#include <stop_token>
#include <string>
#include <thread>

#include "apps/report/report.h"
#include "apps/report/trial_page.h"
#include "apps/workbench/worker/line_socket.h"
#include "calib/base/error.h"
#include "calib/base/quoted_text.h"
#include "calib/io/input_file.h"
#include "engine/calibrate_session.h"
#include "engine/detect_session.h"
#include "engine/init_session.h"
#include "engine/json/run_events.h"
#include "engine/plenoptic/focus_files.h"
#include "engine/session/open_session.h"
#include "engine/try_session.h"
#include "models/registry.h"

namespace plenocal::workbench {
namespace {

using Json = nlohmann::json;

std::string TextOf(const Json& job, const char* key) { return job.at(key).get<std::string>(); }

void Init(const Json& job, const Run& run) {
  InitSession({.place = TextOf(job, "input"), .session = TextOf(job, "out")}, run);
}

void Detect(const Json& job, const Run& run) {
  SessionOptions options;
  options.out = TextOf(job, "out");
  options.cache = TextOf(job, "cache");
  DetectSession(OpenSession(TextOf(job, "input")), options, run).folders->Commit();
}

void CalibrateImages(const Json& job, const Run& run) {
  CalibrateRequest request;
  request.out = TextOf(job, "out");
  request.cache = TextOf(job, "cache");
  request.session = OpenSession(TextOf(job, "input"));
  SessionCalibration calibration = CalibrateSession(request, run);
  AddReport(request.out, run, &calibration);
  calibration.folders->Commit();
}

void Try(const Json& job, const Run& run) {
  TryRequest request;
  request.out = TextOf(job, "out");
  const SessionTrial trial = TrySession(OpenSession(TextOf(job, "input")), request, run);
  trial.folders->out()->Write("try.html", TrialPage(trial));
  trial.folders->Commit();
}

void Focus(const Json& job, const Run& run) {
  FocusFilesRequest request;
  request.raw = {TextOf(job, "input")};
  request.camera.grid = TextOf(job, "grid");
  request.camera.vignetting = TextOf(job, "vignetting");
  if (job.contains("bayer")) request.camera.bayer = ParseBayerOrder(TextOf(job, "bayer"));
  request.out = TextOf(job, "out");
  FocusImages(request, run);
}

// Why a job failed; empty: it did not.
std::string FailureOf(const Json& job, const Run& run) {
  try {
    RunJob(job, run);
    return {};
  } catch (const Error& error) {
    return Escaped(error.what());
  } catch (const Stopped&) {
    return "stopped";
  } catch (const std::bad_alloc&) {
    return "out of memory";
  } catch (const std::filesystem::filesystem_error& error) {
    return Escaped(fmt::format("{}: {}", error.path1().string(), error.code().message()));
  } catch (const std::exception& error) {
    return Escaped(fmt::format("internal error: {}", error.what()));
  }
}

}  // namespace

void RunJob(const Json& job, const Run& run) {
  static const std::map<std::string, void (*)(const Json&, const Run&)> kJobs{
      {"init", Init},
      {"detect", Detect},
      {"calibrate", CalibrateImages},
      {"try", Try},
      {"focus", Focus}};
  const RunScope inputs;  // the session's file, too
  kJobs.at(TextOf(job, "kind"))(job, run);
}

void ServeJobs(int socket) {
  LineSocket messages(socket);
  std::jthread running;  // stopped when it is destroyed
  constexpr std::chrono::milliseconds kAnyTime{-1};
  while (const std::optional<Json> message = messages.Receive(kAnyTime)) {
    if (message->contains("stop")) {
      running.request_stop();
      continue;
    }
    if (running.joinable()) running.join();
    running = std::jthread([&messages, job = *message](const std::stop_token& stop) {
      const size_t models = CameraModels().size();
      const std::string error =
          FailureOf(job,
                    {.listener = EventListener([&](const Json& event) { messages.Send(event); }),
                     .stop = stop});
      // What a large job had is not kept from other programs.
      malloc_trim(0);
      // A plug-in that the session names may have been built again until the next job.
      const bool last = CameraModels().size() > models;
      messages.Send({{"event", "end"}, {"error", error}, {"last", last}});
    });
  }
}

}  // namespace plenocal::workbench
