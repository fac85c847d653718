// SPDX-License-Identifier: Apache-2.0
//
// Evaluation of the nodes of a formula for many points.
#pragma once

#include <cstddef>
#include <span>
#include <vector>

#include "models/formula/graph.h"

namespace plenocal::formula {

/// Points that are evaluated together: with some 40 registers they fit into the first cache.
inline constexpr size_t kBlock = 64;

/// The operations on which some outputs depend, in order, over registers of one number a point.
class Tape {
 public:
  /// Inputs below `varying` differ between points, the others are the parameters.
  Tape() = default;
  Tape(const Graph& graph, std::span<const int> outputs, size_t varying);

  /// Evaluates up to `kBlock` points; input v of point i is `inputs[v * kBlock + i]`. The outputs
  /// are valid until the next call in this thread.
  class Values;
  Values Evaluate(const double* inputs, const double* params, size_t count) const;

 private:
  struct Instruction {
    Op op = Op::kAdd;
    int to = 0, a = 0, b = 0, c = 0;  // registers
  };
  struct Filled {
    int to = 0, input = -1;  // constants have no input
    double value = 0;
  };

  std::vector<Instruction> instructions_;
  std::vector<Filled> filled_;  // registers of constants and parameters
  std::vector<Filled> loaded_;  // of inputs that vary
  std::vector<int> outputs_;    // registers
  size_t registers_ = 0;
};

/// Outputs of a tape.
class Tape::Values {
 public:
  Values(const double* registers, const int* outputs, size_t stride)
      : registers_(registers), outputs_(outputs), stride_(stride) {}
  /// Output k of all points.
  [[nodiscard]] const double* operator[](size_t k) const {
    return registers_ + static_cast<size_t>(outputs_[k]) * stride_;
  }

 private:
  const double* registers_;
  const int* outputs_;
  size_t stride_;
};

}  // namespace plenocal::formula
