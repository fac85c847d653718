// SPDX-License-Identifier: Apache-2.0
#include "engine/session/open_session.h"

#include "calib/base/format_error.h"
#include "calib/base/names.h"
#include "calib/files/frame_images.h"
#include "calib/io/output_folder.h"
#include "engine/recording/stores/image_lister.h"
#include "models/formula/model.h"
#include "models/registry.h"

namespace plenocal {

namespace {

// Completes the results of earlier runs that a session takes its cameras' data from.
void CompleteNamedResults(const Session& session) {
  std::vector<std::filesystem::path> named{session.target.file, session.from.path};
  for (const SessionTarget& target : session.targets) named.push_back(target.source.file);
  for (const SessionCamera& camera : session.cameras) {
    named.insert(named.end(), {camera.detections, camera.times, camera.from.path});
    named.insert(named.end(), camera.images.begin(), camera.images.end());
    named.insert(named.end(), camera.white_images.begin(), camera.white_images.end());
  }
  for (const std::filesystem::path& file : named) {
    if (!file.empty()) CompleteResults(file);
  }
}

}  // namespace

Session OpenSession(const std::filesystem::path& path) {
  CompleteResults(path);
  for (const std::filesystem::path& plugin : ReadSessionPlugins(path)) AddCameraModels(plugin);
  AddFormulaModels(path);
  Session session = ReadSession(path, CameraModels());
  CompleteNamedResults(session);
  return session;
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

const CameraModel& UsualModel() { return *FindModel(CameraModels(), kUsualModel); }

void UseModel(const CameraModel& model, SessionCamera* camera) {
  camera->model = &model;
  camera->auto_model = false;
  camera->initial.assign(model.params.size(), std::nullopt);
  camera->fixed.assign(model.params.size(), false);
}

}  // namespace plenocal
