// SPDX-License-Identifier: Apache-2.0
//
// Priors, bounds and ties of parameters, as sessions state them.
#pragma once

#include <cstddef>
#include <limits>
#include <optional>

namespace plenocal {

/// A parameter of one of several cameras.
struct ParamIndex {
  size_t camera = 0, param = 0;

  friend bool operator==(const ParamIndex&, const ParamIndex&) = default;
};

/// Constraints on a parameter beside the images.
struct ParamRule {
  /// Gaussian prior: it counts like one more observation.
  struct Prior {
    double value = 0, sigma = 0;
  };
  std::optional<Prior> prior = std::nullopt;
  /// Bounds of the estimate, which may lie on one of them.
  double lower = -std::numeric_limits<double>::infinity();
  double upper = std::numeric_limits<double>::infinity();
  /// The parameter that this one is tied to: both have one value. Never one that is itself tied to
  /// another.
  std::optional<ParamIndex> tied_to = std::nullopt;
};

}  // namespace plenocal
