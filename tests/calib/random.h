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
  // Vectors are drawn coordinate by coordinate, the last one first. As arguments of one call the
  // numbers would come in an order that depends on the compiler.
  template <int kSize>
  Eigen::Matrix<double, kSize, 1> Uniforms(double low, double high) {
    return Drawn<kSize>([&] { return Uniform(low, high); });
  }
  template <int kSize>
  Eigen::Matrix<double, kSize, 1> Gaussians(double sigma) {
    return Drawn<kSize>([&] { return Gaussian(sigma); });
  }
  Eigen::Vector3d Direction() { return Gaussians<3>(1).normalized(); }

 private:
  template <int kSize, typename Draw>
  static Eigen::Matrix<double, kSize, 1> Drawn(const Draw& draw) {
    Eigen::Matrix<double, kSize, 1> numbers;
    for (int i = kSize; i-- > 0;) numbers[i] = draw();
    return numbers;
  }

  std::mt19937 engine_;
  std::normal_distribution<double> normal_;
};

}  // namespace plenocal::testing
