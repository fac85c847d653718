// SPDX-License-Identifier: Apache-2.0
#include "engine/session/open_session.h"

#include "calib/base/format_error.h"
#include "calib/base/names.h"
#include "models/registry.h"

namespace plenocal {

Session OpenSession(const std::filesystem::path& path) {
  for (const std::filesystem::path& plugin : ReadSessionPlugins(path)) AddCameraModels(plugin);
  return ReadSession(path, CameraModels());
}

const CameraModel* ModelNamed(const std::string& option, const std::string& name) {
  if (const CameraModel* model = FindModel(CameraModels(), name)) return model;
  throw InputError(
      "{} {}: unknown camera model{}", option, name, SuggestName(name, NamesOf(CameraModels())));
}

void UseModel(const CameraModel& model, SessionCamera* camera) {
  camera->model = &model;
  camera->initial.assign(model.params.size(), std::nullopt);
  camera->fixed.assign(model.params.size(), false);
}

}  // namespace plenocal
