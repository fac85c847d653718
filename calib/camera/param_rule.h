// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <limits>
#include <optional>

namespace plenocal {

/// A parameter of one of several cameras.
struct ParamPlace {
  size_t camera = 0, param = 0;

  friend bool operator==(const ParamPlace&, const ParamPlace&) = default;
};

/// What is known of a parameter beside the images, other than that it is held.
struct ParamRule {
  /// Gaussian: it counts like one more observation.
  struct Prior {
    double value = 0, sigma = 0;
  };
  std::optional<Prior> prior = std::nullopt;
  /// The estimate is within them, or at one of them.
  double lower = -std::numeric_limits<double>::infinity();
  double upper = std::numeric_limits<double>::infinity();
  /// The parameter that this one is one with: it has no value of its own. Never one that is itself
  /// one with another.
  std::optional<ParamPlace> same_as = std::nullopt;
};

}  // namespace plenocal
