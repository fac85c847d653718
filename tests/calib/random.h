// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <random>

namespace plenocal::testing {

/// Numbers that follow from a seed.
class Random {
 public:
  explicit Random(unsigned seed) : engine_(seed) {}
  double Uniform(double low, double high) {
    return low + (high - low) * std::generate_canonical<double, 53>(engine_);
  }
  double Gaussian(double sigma) { return sigma * normal_(engine_); }
  Eigen::Vector3d Direction() {
    return Eigen::Vector3d(Gaussian(1), Gaussian(1), Gaussian(1)).normalized();
  }

 private:
  std::mt19937 engine_;
  std::normal_distribution<double> normal_;
};

}  // namespace plenocal::testing
