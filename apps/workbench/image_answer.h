// SPDX-License-Identifier: Apache-2.0
//
// Makes images of the session and of `plenocal focus` ready for the page.
#pragma once

#include <array>
#include <filesystem>
#include <nlohmann/json.hpp>

#include "apps/workbench/http/guard.h"
#include "calib/files/calibration_record.h"
#include "calib/files/frame_images.h"

namespace plenocal::workbench {

/// An image as JPEG, at most `width` pixels wide (0: as it is). Throws `Error` of kind kInput for a
/// file that does not lie beneath `root`, is no image, or has more than 200 megapixels.
Answer ImageAnswer(const std::filesystem::path& root, const FrameImage& image, int width);

/// The same of an ordinary camera, as a pinhole camera takes it (`plenocal undistort`).
Answer UndistortedAnswer(const std::filesystem::path& root,
                         const FrameImage& image,
                         const CalibratedCamera& camera);
/// Images of two cameras side by side, points of space in equal rows (`plenocal rectify`).
Answer RectifiedAnswer(const std::filesystem::path& root,
                       const std::array<FrameImage, 2>& images,
                       const std::array<const CalibratedCamera*, 2>& cameras);

/// A virtual depth image's `size`, and its values at every `step`-th pixel by rows, null where it
/// is unknown. `file` lies beneath `root`.
nlohmann::json DepthJson(const std::filesystem::path& root, const std::filesystem::path& file);

}  // namespace plenocal::workbench
