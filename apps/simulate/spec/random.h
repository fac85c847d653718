// SPDX-License-Identifier: Apache-2.0
//
// Random numbers of the simulator, a stream for each purpose.
#pragma once

#include <cstdint>
#include <initializer_list>
#include <random>
#include <string_view>

namespace plenocal::simulate {

/// Random numbers of one purpose. Each purpose ("noise" of an image, "pose" of a frame) has its own
/// stream, so that neither the order of the work nor the number of threads changes any of them.
class Random {
 public:
  Random(int seed, std::string_view purpose, std::initializer_list<std::size_t> indices = {}) {
    std::uint64_t state = 14695981039346656037U;  // FNV-1a
    const auto mix = [&](std::uint64_t value) { state = (state ^ value) * 1099511628211U; };
    mix(static_cast<std::uint64_t>(seed));
    for (const char c : purpose) mix(static_cast<unsigned char>(c));
    for (const std::size_t index : indices) mix(index + 1);
    engine_.seed(state);
  }

  /// In [low, high).
  double Uniform(double low, double high) {
    return low + (high - low) * std::generate_canonical<double, 53>(engine_);
  }
  double Gaussian(double sigma) { return sigma * normal_(engine_); }

 private:
  std::mt19937_64 engine_;
  std::normal_distribution<double> normal_;
};

}  // namespace plenocal::simulate
