// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>

#include "apps/workbench/http/guard.h"

namespace plenocal::workbench {

/// An image file beneath `root` as JPEG, at most `width` pixels wide (0: as it is). Throws `Error`
/// of kind kInput for one that lies elsewhere, is no image, or has more than 200 megapixels.
Answer ImageAnswer(const std::filesystem::path& root, const std::filesystem::path& file, int width);

}  // namespace plenocal::workbench
