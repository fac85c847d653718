// SPDX-License-Identifier: Apache-2.0
//
// What to record next: views of the target that lower the projection's standard error most.
#pragma once

#include <filesystem>
#include <map>
#include <optional>
#include <string>

#include "calib/base/run.h"
#include "calib/files/calibration_record.h"
#include "calib/files/session.h"
#include "engine/session/session_options.h"
#include "engine/suggest/picture_gain.h"
#include "engine/suggest/suggested_views.h"

namespace plenocal {

/// Nothing is written.
struct SuggestRequest : SessionOptions {
  /// session.yaml, or a calibration's folder or calibration.yaml; empty: there are no images yet,
  /// and target, size and angle are given.
  std::filesystem::path input;
  std::string model = "pinhole-radtan4";  ///< before the first image
  std::string target;                     ///< likewise: chessboard:9x6:25mm, or a file
  std::optional<ImageSize> size;          ///< likewise: of the images, px
  /// Horizontal field of view, degrees: before the first image, and while images do not determine
  /// it; 0: not given.
  double angle = 0;
  int count = 5;                     ///< of suggestions
  double nearest = 0, farthest = 0;  ///< of the target, m; 0: as target and lens allow
  double tilt = 50;                  ///< the largest, degrees
  double goal = 0.05;  ///< standard error of the projection that suffices, px; of z: mm
  /// Views lower the standard error of z of points at this distance, m; 0: that of the projection.
  double depth_at = 0;
};

/// Throws `Error`: of kind kJob where the images determine no calibration and no angle is given;
/// and `Stopped`.
SuggestedViews SuggestViews(const SuggestRequest& request, const Run& run);
/// The same of a session, or of a calibration with the target that it was made with, in place of
/// `input`.
SuggestedViews SuggestViews(const Session& session, const SuggestRequest& request, const Run& run);
SuggestedViews SuggestViews(const CalibrationRecord& calibration,
                            const Target& target,
                            const SuggestRequest& request,
                            const Run& run);

/// Gain of a calibration by pictures taken at once (its folder, or calibration.yaml). `pictures`:
/// by camera; empty: the only one. Throws `Error` of kind kInput as `PictureGainEvaluator`.
PictureGain EvaluatePictures(const std::filesystem::path& calibration,
                             const std::map<std::string, FrameImage>& pictures,
                             const Run& run);

}  // namespace plenocal
