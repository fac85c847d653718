// SPDX-License-Identifier: Apache-2.0
//
// Cameras in the settings of ORB-SLAM2 and ORB-SLAM3.
#pragma once

#include <span>
#include <string>

#include "calib/io/yaml.h"
#include "engine/formats/camera_format.h"
#include "engine/formats/lens_form.h"

namespace plenocal {

/// The pinhole models, then the fisheye model, which ORB-SLAM2 lacks.
std::span<const LensForm> OrbSlamLenses();
inline constexpr size_t kOrbSlam2Lenses = 4;

/// Lines `<prefix>.fx: ...` of a camera.
std::string OrbSlamCamera(const std::string& prefix, const Lens& lens);
/// Lines `Camera.width: ...` of its images.
std::string OrbSlamImages(const CalibratedCamera& camera);

/// Reads what `OrbSlamCamera` writes; `type` is the lens' name.
Lens ReadOrbSlamCamera(const YamlNode& root, const std::string& prefix, const std::string& type);
ImageSize ReadOrbSlamSize(const YamlNode& root, const CameraSource& source);

}  // namespace plenocal
