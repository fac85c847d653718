// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>

#include <memory>

#include "apps/cli/command.h"
#include "apps/cli/options.h"
#include "apps/cli/session/open_session.h"
#include "apps/cli/session_observations.h"
#include "calib/base/number_text.h"
#include "calib/base/output_folder.h"
#include "calib/files/exclusion.h"

namespace plenocal {
namespace {

void RunDetect(const SessionOptions& options, const ConsoleOptions& shared) {
  Session session = OpenSession(options.session);
  AddExcludeRules(options.exclude, &session);
  const Target target = ReadTarget(session.target);
  OutputFolder out(options.out);
  Console console(shared);
  DetectionCache cache =
      OpenDetectionCache(options.cache.empty() ? options.out : options.cache,
                         session,
                         options.fresh ? EarlierDetections::kIgnore : EarlierDetections::kReuse);
  const SessionObservations observations = CollectObservations(
      session, target, shared, {&cache, options.keep ? &out : nullptr}, &console);
  WriteDetections(session, observations, options.out, &out);
  out.Commit();
  // Other runs may need what is in a cache of its own.
  if (options.cache.empty()) cache.RemoveUnused();
  for (const CameraInput& camera : observations.cameras) {
    console.Print(fmt::format("{}: {}, {} -> {}\n",
                              camera.name,
                              Counted(camera.views.size(), "frame"),
                              Counted(CountObservations(camera.views), "point"),
                              (options.out / DetectionsName(camera.name)).string()));
  }
}

RunCommand DeclareDetect(CLI::App* app, ConsoleOptions* shared) {
  const auto options = std::make_shared<SessionOptions>();
  AddSessionOptions(app, options.get(), shared);
  return [options, shared] { RunDetect(*options, *shared); };
}

}  // namespace

Command DetectCommand() {
  return {"detect", "Only find the markers: writes OUT/detections_<camera>.csv.", DeclareDetect};
}

}  // namespace plenocal
