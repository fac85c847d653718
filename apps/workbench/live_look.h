// SPDX-License-Identifier: Apache-2.0
//
// Weighs pictures of live cameras before they are kept.
#pragma once

#include <filesystem>
#include <mutex>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>

#include "engine/suggest/picture_gain.h"

namespace plenocal::workbench {

/// What a live camera shows, weighed against a run. May be called from several threads.
class LiveLook {
 public:
  /// `sizes`: "left:1234,right:567", the cameras and the bytes of their image files, which follow
  /// one another in `pictures`. Returns `PictureGainJson`. Throws `Error` as
  /// `PictureGainEvaluator`, and of kind kInput where the sizes are not those of `pictures`.
  nlohmann::json Weigh(const std::filesystem::path& run_folder,
                       const std::string& sizes,
                       const std::string& pictures);
  /// What was weighed last is kept as images, and the calibration goes on with it. Returns
  /// `SuggestionsJson` with `seconds`, and by camera `coverage` (part of the image's cells with
  /// points) and `parameters` (name, value, sigma); null where nothing was weighed.
  nlohmann::json Keep();

 private:
  std::mutex mutex_;
  std::filesystem::path folder_;
  std::filesystem::file_time_type time_;  // of its calibration: a run may be made again
  std::optional<PictureGainEvaluator> scale_;
};

}  // namespace plenocal::workbench
