// SPDX-License-Identifier: Apache-2.0
#include "apps/cli/session/scene_session.h"

#include <fmt/format.h>

#include <algorithm>
#include <iterator>
#include <set>
#include <utility>

#include "apps/cli/session/earlier_session.h"
#include "calib/base/error.h"

namespace plenocal {
namespace {

std::set<int> NumbersOf(const std::vector<CameraInput>& cameras) {
  std::set<int> numbers;
  for (const CameraInput& camera : cameras) {
    for (const View& view : camera.views) {
      for (const Observation& seen : view.observations) numbers.insert(seen.marker);
    }
  }
  return numbers;
}

}  // namespace

void CheckSceneSession(const Session& session, bool jackknife) {
  if (jackknife) {
    throw Error(ErrorKind::kInput,
                fmt::format("{}: --jackknife needs a target: scene points are seen in few frames "
                            "each; leave the option out",
                            session.path.string()));
  }
}

SceneCalibrationInput MakeSceneInput(const Session& session, std::vector<CameraInput> cameras) {
  std::vector<SceneDistance> distances = session.scene->distances;
  if (const auto& tags = session.scene->tags; tags && tags->size > 0) {
    const std::set<int> tracked = NumbersOf(cameras);
    for (const int id : tags->ids) {
      if (!tracked.contains(TagPoint(id, 0))) continue;
      std::ranges::move(SizesOfTag(*tags, id), std::back_inserter(distances));
    }
  }
  return {.cameras = ReadEarlierCameras(session, std::move(cameras), OpenParams::kFixed),
          .distances = std::move(distances),
          .loss = session.loss};
}

}  // namespace plenocal
