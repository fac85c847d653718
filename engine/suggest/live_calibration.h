// SPDX-License-Identifier: Apache-2.0
//
// A calibration that goes on with each frame that arrives: parameters, standard errors and next
// views are renewed at once.
#pragma once

#include <string>
#include <vector>

#include "calib/files/calibration_record.h"
#include "calib/start/input.h"
#include "engine/suggest/suggested_views.h"
#include "targets/target.h"

namespace plenocal {

/// Ordinary cameras before one target. Each renewal is a whole calibration that starts from the
/// last one, without verdict and findings. Ties and priors of a session are not in the files of its
/// calibration, so they end here.
class LiveCalibration {
 public:
  /// `calibration` so far, `rig`: its estimate (`MakeRigEstimate`). Throws as `ChooseNextViews`.
  LiveCalibration(CalibrationRecord calibration,
                  const Target& target,
                  RigEstimate rig,
                  const NextViewOptions& options);

  /// A frame: per camera what it shows, maybe nothing. After an error all is as before. Throws
  /// `Error` of kind kInput for a rig with a plenoptic camera and for a frame that there is
  /// already, and as `Calibrate`.
  void Add(const std::string& frame, const std::vector<View>& views);

  [[nodiscard]] const CalibrationRecord& Record() const { return record_; }
  [[nodiscard]] const SuggestedViews& Suggested() const { return suggested_; }

 private:
  CalibrationRecord record_;
  NextViewOptions options_;
  NextViewChooser chooser_;
  SuggestedViews suggested_;
  CalibrationInput input_;
};

}  // namespace plenocal
