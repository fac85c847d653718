// SPDX-License-Identifier: Apache-2.0
//
// Properties that every camera model must have; `plenocal models check` and the tests check them.
#pragma once

#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "calib/camera/camera_model.h"

namespace plenocal {

/// A property that is checked at a model's example parameters, over its example image and up to the
/// edge of its domain.
struct ModelProperty {
  std::string_view name;   ///< "FindsPixelsAgain"
  std::string_view claim;  ///< what holds, as a sentence without its full stop
  bool central_only;       ///< checked for central models only
  /// One line for each place where the model violates it; none when it holds.
  std::vector<std::string> (*violations)(const CameraModel& model);
};

/// All properties; the later ones assume that the earlier ones hold.
std::span<const ModelProperty> ModelProperties();

/// Which of the properties hold for a model, as lines; `violated` receives the number of the
/// others.
std::string CheckModel(const CameraModel& model, size_t* violated);

}  // namespace plenocal
