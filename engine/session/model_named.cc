// SPDX-License-Identifier: Apache-2.0
#include "engine/session/model_named.h"

#include <fmt/format.h>

#include "calib/base/error.h"
#include "calib/base/names.h"
#include "models/registry.h"

namespace plenocal {

const CameraModel* ModelNamed(const std::string& option, const std::string& name) {
  if (const CameraModel* model = FindModel(CameraModels(), name)) return model;
  throw Error(ErrorKind::kInput,
              fmt::format("{} {}: unknown camera model{}",
                          option,
                          name,
                          SuggestName(name, NamesOf(CameraModels()))));
}

}  // namespace plenocal
