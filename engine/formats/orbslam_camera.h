// SPDX-License-Identifier: Apache-2.0
//
// Cameras in the settings of ORB-SLAM2 and ORB-SLAM3.
#pragma once

#include <string>

#include "calib/io/yaml.h"
#include "engine/formats/camera_format.h"
#include "engine/formats/lens_form.h"

namespace plenocal {

/// The pinhole models.
const LensTable& OrbSlam2Lenses();
/// The same and the fisheye model.
const LensTable& OrbSlam3Lenses();

/// Lines `<prefix>.fx: ...` of a camera.
std::string OrbSlamCamera(const std::string& prefix, const Lens& lens);
/// Lines `Camera.width: ...` of its images.
std::string OrbSlamImages(const CalibratedCamera& camera);

/// The size of its images; throws `Error` of kind kInput where neither file nor user state it.
ImageSize ReadOrbSlamSize(const YamlNode& root, const CameraSource& source);

}  // namespace plenocal
