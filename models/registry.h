// SPDX-License-Identifier: Apache-2.0
//
// The table of camera models. It is a state of the process, since the code of plug-ins, once
// loaded, belongs to the process; it only grows, and may be used from several threads.
#pragma once

#include <filesystem>
#include <memory>
#include <span>
#include <string>

#include "calib/camera/camera_model.h"

namespace plenocal {

/// All camera models of models/, sorted by file name, then those that were added. The build
/// makes this table from the headers.
std::span<const CameraModel> CameraModels();

/// Adds the models of a plug-in (docs/new_model.md), once however often it is named. Models keep
/// their places; a span from before lacks the new ones. Throws `Error` of kind kInput when the file
/// is no plug-in, belongs to another version, or has a model whose name is taken.
void AddCameraModels(const std::filesystem::path& plugin);

/// Adds a model that was made at run time, with the owner of all that it refers to (names,
/// parameters, `self`); both stay as long as the process. `where` begins the messages. Throws
/// likewise.
const CameraModel& AddCameraModel(const CameraModel& model,
                                  std::shared_ptr<const void> owner,
                                  const std::string& where);

}  // namespace plenocal
