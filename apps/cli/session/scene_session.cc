// SPDX-License-Identifier: Apache-2.0
#include "apps/cli/session/scene_session.h"

#include <fmt/format.h>

#include <optional>
#include <utility>

#include "calib/base/error.h"
#include "calib/files/calibration_file.h"
#include "calib/files/calibration_tables.h"
#include "models/registry.h"

namespace plenocal {
namespace {

CalibrationRecord ReadEarlierCalibration(const std::filesystem::path& path) {
  CalibrationRecord earlier = ReadCalibration(path, CameraModels());
  const std::filesystem::path correlations = path.parent_path() / "correlations.csv";
  if (std::filesystem::exists(correlations)) {
    earlier.correlations = ReadCorrelations(correlations);
  }
  return earlier;
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
  std::optional<CalibrationRecord> earlier;
  if (!session.from.empty()) earlier = ReadEarlierCalibration(session.from);
  std::vector<EarlierParams> keys;
  for (const SessionCamera& camera : session.cameras) keys.push_back(camera.earlier);
  return {.cameras = MakeSceneCameras(std::move(cameras), keys, earlier ? &*earlier : nullptr),
          .distances = session.scene->distances,
          .loss = session.loss};
}

}  // namespace plenocal
