// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "calib/camera/observation.h"
#include "calib/files/frame_images.h"

namespace plenocal {

/// The images of command-line arguments: each a file, a glob or a folder with images. `what`
/// ("white images") is used in messages. Throws `Error` of kind kInput when an argument matches
/// nothing.
std::vector<FrameImage> FindImageInputs(const std::vector<std::string>& inputs,
                                        const std::string& what);

/// The value of `--size`, "640x480"; nothing for an empty text. Throws `Error` of kind kInput.
std::optional<ImageSize> ParseImageSize(const std::string& text);

}  // namespace plenocal
