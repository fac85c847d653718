// SPDX-License-Identifier: Apache-2.0
#include "engine/observe/scene_session.h"

#include <utility>

#include "calib/base/format_error.h"
#include "engine/session/earlier_session.h"

namespace plenocal {

void CheckSceneSession(const Session& session, bool jackknife) {
  if (jackknife) {
    throw InputError(
        "{}: --jackknife needs a target: scene points are seen in few frames "
        "each; leave the option out",
        session.path.string());
  }
}

SceneCalibrationInput MakeSceneInput(const Session& session, std::vector<CameraInput> cameras) {
  return {.cameras = ReadEarlierCameras(session, std::move(cameras), OpenParams::kFixed),
          .distances = session.scene->distances,
          .tags = session.scene->tags,
          .loss = session.loss};
}

}  // namespace plenocal
