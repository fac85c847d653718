// SPDX-License-Identifier: Apache-2.0
//
// Tracks of scene points from the images of a session without a target.
#pragma once

#include <utility>
#include <vector>

#include "calib/base/run.h"
#include "calib/files/session.h"
#include "engine/observe/session_observations.h"

namespace plenocal {

struct SceneObservations {
  SessionObservations session;
  /// A track and an earlier camera's that looks like the same point, to about a pixel.
  std::vector<std::pair<int, int>> alike;
};

/// True when the session's cameras have images, not tracks. Throws `Error` of kind kInput when some
/// have the one and some the other.
bool FollowsImages(const Session& session);

/// Follows scene points through the images of all cameras and prints one line per camera. Where the
/// parameters and extrinsics of all ordinary cameras are given (`initial`, `from`), points are
/// searched along epipolar curves, else recognised by their descriptors. Throws `Error` for a
/// camera without usable images, and `Stopped` after Ctrl-C.
SceneObservations FollowSceneImages(const Session& session, const Run& run);

}  // namespace plenocal
