// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <string_view>

#include "calib/camera_model.h"

namespace plenocal {

/// What all models of ordinary cameras share: a point (x, y) in the image is seen along a ray
/// through the camera frame's origin.
struct CentralModel {
  static constexpr std::array<std::string_view, 2> kMeasured{"x", "y"};
  static constexpr std::array<std::string_view, 0> kContext{};
  static constexpr std::array<Param, 0> kConfig{};
  static constexpr std::array<double, 0> kExampleConfig{};
  static constexpr bool kCentral = true;
};

}  // namespace plenocal
