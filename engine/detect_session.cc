// SPDX-License-Identifier: Apache-2.0
#include "engine/detect_session.h"

#include "calib/io/input_file.h"
#include "engine/session/session_targets.h"

namespace plenocal {

DetectedSession DetectSession(const Session& session,
                              const SessionOptions& options,
                              const Run& run) {
  const RunScope inputs;
  DetectedSession detected;
  detected.session = session;
  UseOptions(options, &detected.session);
  const SessionTargets targets = ReadSessionTargets(detected.session);
  detected.folders =
      std::make_unique<RunFolders>(options, detected.session, std::vector<std::string>());
  OutputFolder* const out = detected.folders->out();
  detected.observations = CollectObservations(
      detected.session, targets, run, {detected.folders->cache(), options.keep ? out : nullptr});
  if (out != nullptr) WriteDetections(detected.session, detected.observations, options.out, out);
  return detected;
}

}  // namespace plenocal
