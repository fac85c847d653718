// SPDX-License-Identifier: Apache-2.0
#include "engine/session/open_session.h"

#include "calib/base/format_error.h"
#include "calib/base/names.h"
#include "calib/files/frame_images.h"
#include "engine/recording/stores/image_lister.h"
#include "models/registry.h"

namespace plenocal {

Session OpenSession(const std::filesystem::path& path) {
  for (const std::filesystem::path& plugin : ReadSessionPlugins(path)) AddCameraModels(plugin);
  return ReadSession(path, CameraModels());
}

bool NamesSession(const std::vector<std::string>& inputs) {
  if (inputs.size() != 1) return false;
  const std::string& file = inputs[0];
  if (file.ends_with(".yaml") || file.ends_with(".yml")) return true;
  return std::filesystem::exists(file) && !std::filesystem::is_directory(file) &&
         !HasImageName(file) && SplitStorePattern(file).file.empty();
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
