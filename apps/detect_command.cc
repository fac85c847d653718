// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>

#include "apps/commands.h"
#include "apps/observations.h"
#include "calib/output_folder.h"
#include "models/registry.h"

namespace plenocal {

void RunDetect(const SessionCommand& command, const ConsoleOptions& options) {
  const Session session = ReadSession(command.session, CameraModels());
  const Target target = ReadTarget(session.target);
  RefuseToReplaceInputs(session, command.out, {});
  OutputFolder out(command.out);
  Console console(options.quiet);
  StageStore store = OpenStageStore(command.out, session, command.fresh);
  const SessionObservations observations = CollectObservations(
      session, target, options, {&store, command.keep ? &out : nullptr}, &console);
  WriteDetections(session, observations, command.out, &out);
  out.Commit();
  store.RemoveUnused();
  for (const CameraInput& camera : observations.cameras) {
    size_t points = 0;
    for (const View& view : camera.views) points += view.observations.size();
    fmt::print("{}: {} frames, {} points -> {}\n",
               camera.name,
               camera.views.size(),
               points,
               (command.out / fmt::format("detections_{}.csv", camera.name)).string());
  }
}

}  // namespace plenocal
