// SPDX-License-Identifier: Apache-2.0
//
// Names of markers where a session has several targets, and the one number that files give them.
#pragma once

#include <cstddef>

namespace plenocal {

/// A marker by its target and its number in that target's own description.
struct MarkerId {
  /// Each of several targets has numbers below this.
  static constexpr int kPerTarget = 100'000;

  size_t target = 0;
  int id = 0;

  /// `number`: as observations, tables and results have it.
  static constexpr MarkerId FromNumber(int number) {
    return {static_cast<size_t>(number / kPerTarget), number % kPerTarget};
  }
  [[nodiscard]] constexpr int Number() const { return static_cast<int>(target) * kPerTarget + id; }
};

}  // namespace plenocal
