// SPDX-License-Identifier: Apache-2.0
//
// What `map`, `undistort` and `rectify` do alike.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "apps/commands.h"
#include "apps/undistort/pinhole_view.h"
#include "calib/output_folder.h"
#include "calib/pixel_map.h"
#include "calib/session.h"

namespace plenocal {

/// Throws `Error` of kind kInput for what is no size.
ViewOptions ToViewOptions(const ViewArguments& arguments);

/// One line about a pinhole camera: size, focal lengths, principal point, fields of view.
std::string ViewText(const CalibratedCamera& view);

/// Refuses images whose results in `folder` would have one name or replace an image.
void CheckImageNames(const std::vector<FrameImage>& images, const std::filesystem::path& folder);

/// Writes `<prefix><frame>.png` of each image into `out`; of `calibration` comes the vignetting
/// that is removed. Prints messages and progress. Returns the number of images written.
size_t ResampleInto(const std::vector<FrameImage>& images,
                    const CalibrationFile& calibration,
                    const CalibratedCamera& camera,
                    const PixelMap& map,
                    const ResampleArguments& arguments,
                    const ConsoleOptions& options,
                    const std::string& prefix,
                    OutputFolder* out);

}  // namespace plenocal
