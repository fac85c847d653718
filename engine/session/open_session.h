// SPDX-License-Identifier: Apache-2.0
//
// Sessions and the camera models that they name.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "calib/files/session.h"

namespace plenocal {

/// Reads a session after the camera models of its `plugins` and `models`, and completes the results of earlier
/// runs in its folder and in those of the files that it names (calib/io/output_folder.h). Throws
/// `Error` with file, line and key.
Session OpenSession(const std::filesystem::path& path);

/// True if the inputs of a user are a session file, and not images, folders or recordings.
bool NamesSession(const std::vector<std::string>& inputs);

/// The registered model of this name. `option` begins the message. Throws `Error` of kind kInput
/// with the nearest name.
const CameraModel* ModelNamed(const std::string& option, const std::string& name);

/// The model with which images are detected, and calibrated when they are too few for a choice.
const CameraModel& UsualModel();

/// Gives a camera a model, without initial values.
void UseModel(const CameraModel& model, SessionCamera* camera);

}  // namespace plenocal
