// SPDX-License-Identifier: Apache-2.0
#include "engine/session/session_options.h"

#include "calib/files/exclusion.h"
#include "calib/files/session.h"

namespace plenocal {

void UseOptions(const SessionOptions& options, Session* session) {
  AddExcludeRules(options.exclude, session);
  if (options.frames > 0) session->frames = static_cast<size_t>(options.frames);
  if (options.all) session->all_frames = true;
}

}  // namespace plenocal
