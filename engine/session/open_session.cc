// SPDX-License-Identifier: Apache-2.0
#include "engine/session/open_session.h"

#include "models/registry.h"

namespace plenocal {

Session OpenSession(const std::filesystem::path& path) {
  for (const std::filesystem::path& plugin : ReadSessionPlugins(path)) AddCameraModels(plugin);
  return ReadSession(path, CameraModels());
}

}  // namespace plenocal
