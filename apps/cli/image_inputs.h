// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "calib/session.h"

namespace plenocal {

/// The images that arguments of the command line name: each a file, a glob or a folder with images.
/// `what` ("white images") goes into messages. Throws `Error` of kind kInput when one names
/// nothing.
std::vector<FrameImage> FindImageInputs(const std::vector<std::string>& inputs,
                                        const std::string& what);

/// What `--size` says, "640x480"; nothing for an empty text. Throws `Error` of kind kInput.
std::optional<ImageSize> ParseImageSize(const std::string& text);

}  // namespace plenocal
