// SPDX-License-Identifier: Apache-2.0
//
// Results of `plenocal try` for the page.
#pragma once

#include <filesystem>
#include <nlohmann/json.hpp>

namespace plenocal::workbench {

/// `cameras` whose model was varied, `frames`, `folds`, `recommended`, `why`, `target` (how it is
/// judged, a sentence) and `models`, best first: `name`, `parameters`, `held_out_rms` and
/// `held_out_sigma`, px, `image_sigma`, px, `judgement`, or `failure`; null for what try.yaml has
/// not or has as infinite. `folder` lies beneath `root`.
nlohmann::json TryJson(const std::filesystem::path& root, const std::filesystem::path& folder);

}  // namespace plenocal::workbench
