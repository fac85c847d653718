// SPDX-License-Identifier: Apache-2.0
//
// Identity of a marker in sessions with several targets, and its single number in files.
#pragma once

#include <cstddef>

namespace plenocal {

/// A marker as its target and its number in that target's own description.
struct MarkerId {
  /// With several targets, the numbers in each are smaller than this.
  static constexpr int kPerTarget = 100'000;

  size_t target = 0;
  int id = 0;

  /// `number`: the marker's number in observations, tables and results.
  static constexpr MarkerId FromNumber(int number) {
    return {static_cast<size_t>(number / kPerTarget), number % kPerTarget};
  }
  [[nodiscard]] constexpr int Number() const { return static_cast<int>(target) * kPerTarget + id; }
};

}  // namespace plenocal
