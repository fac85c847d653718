// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>

#include <charconv>

#include "apps/cli/options.h"
#include "calib/base/format_error.h"
#include "calib/base/number_text.h"
#include "calib/files/detections.h"
#include "engine/detect_session.h"
#include "engine/session/calibration_input.h"

namespace plenocal {
namespace {

struct DetectArguments : SessionOptions {
  ImageArguments inputs;
  std::string shard;  ///< "1/4"; empty: all images
};

Shard ParseShard(const std::string& text) {
  Shard shard;
  const char* const end = text.data() + text.size();
  const auto number = std::from_chars(text.data(), end, shard.number);
  if (number.ec == std::errc() && number.ptr != end && *number.ptr == '/') {
    const auto count = std::from_chars(number.ptr + 1, end, shard.count);
    const bool fits = shard.number >= 1 && shard.number <= shard.count;
    if (count.ec == std::errc() && count.ptr == end && fits) return shard;
  }
  throw InputError("--shard {}: expected K/N, part K of N, such as 1/4", text);
}

void RunDetect(const DetectArguments& options, Console* console) {
  const Run run = console->NewRun();
  const Session session = OpenInputs(options.inputs, "detect", run);
  if (!options.shard.empty()) {
    DetectShard(session, options, ParseShard(options.shard), run);
    return console->PrintWritten(options.out / "shard.csv");
  }
  const DetectedSession detected = DetectSession(session, options, run);
  detected.folders->Commit();
  for (const CameraInput& camera : detected.observations.cameras) {
    console->Print(fmt::format("{}: {}, {} -> {}\n",
                               camera.name,
                               Counted(camera.views.size(), "frame"),
                               Counted(CountObservations(camera.views), "point"),
                               (options.out / DetectionsName(camera.name)).string()));
  }
}

void DeclareDetect(CLI::App* app, DetectArguments* options, ConsoleOptions* shared) {
  AddInputs(app, &options->inputs);
  AddResultOptions(app, options, shared);
  app->add_option(
         "--shard",
         options->shard,
         "K/N: only part K of N of the images, into --cache alone, from which calibrate takes them: for several machines")
      ->needs("--cache");
}

}  // namespace

Command DetectCommand() {
  return MakeCommand("detect",
                     "Only find the markers: writes OUT/detections_<camera>.csv.",
                     DeclareDetect,
                     RunDetect);
}

}  // namespace plenocal
