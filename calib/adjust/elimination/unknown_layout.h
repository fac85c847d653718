// SPDX-License-Identifier: Apache-2.0
//
// Places of the unknowns in the normal equations that are left when poses are eliminated.
#pragma once

#include <vector>

#include "calib/adjust/bundle.h"

namespace plenocal::internal {

/// Index of each unknown in the reduced system: parameters and extrinsics of the cameras and poses
/// of targets first, then three coordinates a marker.
struct UnknownLayout {
  std::vector<std::vector<int>> params;  ///< per camera and parameter; -1 when not estimated
  std::vector<int> extrinsics;           ///< per camera; -1 for the master or a camera without data
  std::vector<int> targets;              ///< per target; -1 where its pose is not estimated
  int head = 0;                          ///< number of unknowns before the markers
  int total = 0;
  bool markers = false;

  [[nodiscard]] int Marker(int index) const { return head + 3 * index; }
};

/// `has_data` per camera: whether it has used observations.
UnknownLayout MakeLayout(const Bundle& bundle, const std::vector<bool>& has_data);

}  // namespace plenocal::internal
