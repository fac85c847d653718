// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <vector>

#include "calib/session.h"

namespace plenocal {

/// The images that arguments of the command line name: each a file, a glob or a folder with images.
/// `what` ("white images") goes into messages. Throws `Error` of kind kInput when one names
/// nothing.
std::vector<FrameImage> FindImageInputs(const std::vector<std::string>& inputs,
                                        const std::string& what);

}  // namespace plenocal
