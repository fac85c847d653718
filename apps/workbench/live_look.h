// SPDX-License-Identifier: Apache-2.0
//
// Weighs pictures of live cameras before they are kept.
#pragma once

#include <filesystem>
#include <map>
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
  /// What was weighed last is kept as images of the frame, and the calibration goes on with it.
  /// Returns `SuggestionsJson` with `seconds`, `detection_seconds`, and by camera `coverage` (part
  /// of the image's cells with points) and `parameters` (name, value, sigma); null where nothing
  /// was weighed. Throws `Error` of kind kInput for a frame that the calibration has.
  nlohmann::json Keep(const std::string& frame);
  /// Both for images of one frame that have arrived.
  nlohmann::json Renew(const std::filesystem::path& run_folder,
                       const std::map<std::string, FrameImage>& images);
  /// Reads the run where it was made again since, so that the next picture does not wait for it.
  void Prepare(const std::filesystem::path& run_folder);

 private:
  void Open(const std::filesystem::path& run_folder);
  PictureGain Evaluate(const std::map<std::string, FrameImage>& images);
  nlohmann::json Add(const std::string& frame);

  std::mutex mutex_;
  std::filesystem::path folder_;
  std::filesystem::file_time_type time_;  // of its calibration: a run may be made again
  std::optional<PictureGainEvaluator> scale_;
  double detection_seconds_ = 0;  // of what was weighed last
};

}  // namespace plenocal::workbench
