// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <cctype>
#include <cmath>
#include <cstdlib>
#include <string>

#include "calib/camera/rigid_transform.h"

namespace plenocal::testing {

/// A number that changes with any of the values and with their order. Tests compare it with the
/// result of the version that they were written for, on inputs near the borders of what the code
/// can do. A change that is meant to change results replaces the number, after the tests against
/// the truth and `bench/` have shown that the new results are as good.
class Digest {
 public:
  void Add(double value) { sum_ += value * std::cos(0.7 * ++count_); }
  template <typename Values>
  void AddAll(const Values& values) {
    for (const double value : values) Add(value);
  }
  void Add(const RigidTransform& T) {
    AddAll(T.t);
    AddAll(T.R.reshaped());
  }
  /// The numbers in a text, of a calibration.yaml before its provenance: each by its relative
  /// change, those below 1e-5 by the absolute one.
  void AddNumbersOf(const std::string& text) {
    const char* p = text.c_str();
    const char* const end = p + std::min(text.size(), text.find("\nprovenance:"));
    while (p < end) {
      char* next = nullptr;
      const bool begins = std::isdigit(static_cast<unsigned char>(*p)) != 0 ||
                          (*p == '-' && std::isdigit(static_cast<unsigned char>(p[1])) != 0);
      const double value = begins ? std::strtod(p, &next) : 0;
      if (begins) Add(std::asinh(1e5 * value));
      p = begins ? next : p + 1;
    }
  }
  [[nodiscard]] double Sum() const { return sum_; }

 private:
  double sum_ = 0;
  int count_ = 0;
};

}  // namespace plenocal::testing
