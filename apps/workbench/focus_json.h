// SPDX-License-Identifier: Apache-2.0
//
// Results of `plenocal focus` for the page.
#pragma once

#include <filesystem>
#include <nlohmann/json.hpp>

namespace plenocal::workbench {

/// `offset`, `scale` and `size` of the totally focused image, and its virtual depth at every
/// `step`-th pixel by rows, null where it is unknown. `folder` lies beneath `root`.
nlohmann::json FocusJson(const std::filesystem::path& root, const std::filesystem::path& folder);

}  // namespace plenocal::workbench
