// SPDX-License-Identifier: Apache-2.0
//
// What the project's files say alike about a camera. All functions throw `Error` with file, line
// and key.
#pragma once

#include <span>

#include "calib/camera_model.h"
#include "calib/yaml.h"

namespace plenocal {

/// The model in `models` whose name `node` holds.
const CameraModel* ReadModel(const YamlNode& node, std::span<const CameraModel> models);

/// `[width, height]`, positive numbers of pixels.
ImageSize ReadImageSize(const YamlNode& node);

/// A value of `param`, within its limits.
double ReadWithin(const YamlNode& node, const Param& param);

}  // namespace plenocal
