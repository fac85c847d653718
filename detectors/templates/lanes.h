// SPDX-License-Identifier: Apache-2.0
//
// Eight values that are computed together: GCC's and Clang's vectors, which every processor has
// instructions for (more of them where PLENOCAL_FOR_EACH_PROCESSOR lets it).
#pragma once

#include <cmath>
#include <cstdint>

namespace plenocal::internal {

inline constexpr int kLanes = 8;
// Aligned alike for all processors. As an argument of a template they would lose that: put them
// into a struct there.
using Lanes = float __attribute__((vector_size(4 * kLanes), aligned(4 * kLanes)));
using IntLanes = int __attribute__((vector_size(4 * kLanes), aligned(4 * kLanes)));

/// As many values in double precision as take the same room.
inline constexpr int kDoubleLanes = 4;
using DoubleLanes =
    double __attribute__((vector_size(8 * kDoubleLanes), aligned(8 * kDoubleLanes)));

// Everything here is inlined, so that it is compiled for the processor that its caller is for.
#define PLENOCAL_LANES [[gnu::always_inline]] inline

/// Eight values from any address on.
PLENOCAL_LANES void Load(const float* from, Lanes* lanes) {
  __builtin_memcpy(lanes, from, sizeof *lanes);
}
PLENOCAL_LANES void Store(const Lanes& lanes, float* to) {
  __builtin_memcpy(to, &lanes, sizeof lanes);
}

PLENOCAL_LANES bool IsZero(const IntLanes& lanes) {
  std::uint64_t parts[kLanes / 2];
  __builtin_memcpy(parts, &lanes, sizeof parts);
  return (parts[0] | parts[1] | parts[2] | parts[3]) == 0;
}

PLENOCAL_LANES float Sum(const Lanes& lanes) {
  const Lanes halves = lanes + __builtin_shufflevector(lanes, lanes, 4, 5, 6, 7, 0, 1, 2, 3);
  const Lanes quarters = halves + __builtin_shufflevector(halves, halves, 2, 3, 0, 1, 6, 7, 4, 5);
  return quarters[0] + quarters[1];
}

PLENOCAL_LANES double Sum(const DoubleLanes& lanes) {
  return (lanes[0] + lanes[2]) + (lanes[1] + lanes[3]);
}

PLENOCAL_LANES void Sqrt(Lanes* lanes) {
  float values[kLanes];
  for (int l = 0; l < kLanes; ++l) values[l] = (*lanes)[l];
  for (float& value : values) value = std::sqrt(value);
  for (int l = 0; l < kLanes; ++l) (*lanes)[l] = values[l];
}

/// The standard normal distribution and its density at z; beyond `kNormalReach`, 0 or 1 and 0.
/// M. Abramowitz, I. Stegun, "Handbook of Mathematical Functions", 26.2.17; the error is below
/// 1e-6.
inline constexpr float kNormalReach = 4;
PLENOCAL_LANES void Normal(const Lanes& z, Lanes* distribution, Lanes* density) {
  const Lanes size = z < 0 ? -z : z;
  const auto near = size <= kNormalReach;
  // exp(-z^2 / 2) = exp(-a)^8; a lies within 0 and 1, and the series is about 1/2.
  const Lanes square = near ? z * z : Lanes{};
  const Lanes d = 0.5f - square * (1 / 16.f);
  Lanes power = 1 + d * (1.f / 7);
  power = 1 + d * (1.f / 6) * power;
  power = 1 + d * (1.f / 5) * power;
  power = 1 + d * (1.f / 4) * power;
  power = 1 + d * (1.f / 3) * power;
  power = 1 + d * (1.f / 2) * power;
  power = 0.60653066f * (1 + d * power);
  power *= power;
  power *= power;
  power *= power;
  const Lanes t = 1 / (1 + 0.23164190f * size);
  Lanes tail =
      0.31938153f + t * (-0.35656378f + t * (1.78147794f + t * (-1.82125598f + t * 1.33027443f)));
  tail *= 0.39894228f * t * power;
  tail = near ? tail : Lanes{};
  *distribution = z < 0 ? tail : 1 - tail;
  *density = near ? 0.39894228f * power : Lanes{};
}

/// Half the distance of the two Gaussians of a `StepBlur` that stands for a Gaussian and a square
/// pixel, across an edge with the direction (x, y) of its normal: the fourth cumulants are equal,
/// -2 split^4 and that of the square seen along the edge, -(x^4 + y^4) side^4 / 120.
PLENOCAL_LANES void PixelSplit(const Lanes& x, const Lanes& y, float side, Lanes* split) {
  constexpr float kSquare = 0.2540664f;  // (1 / 240)^(1 / 4)
  const Lanes xx = x * x, yy = y * y, length = xx + yy;
  Lanes fourth = xx * xx + yy * yy;
  Sqrt(&fourth);
  fourth = fourth / length;
  Sqrt(&fourth);
  *split = kSquare * side * fourth;
}

/// The blur of a step from 0 to 1, of standard deviation `blur`: a Gaussian, or the mean of two
/// narrower ones, each `split` beside the middle.
class StepBlur {
 public:
  PLENOCAL_LANES explicit StepBlur(const Lanes& blur) : inverse_(1 / blur) {}
  PLENOCAL_LANES StepBlur(const Lanes& blur, const Lanes& split) : two_(true), split_(split) {
    constexpr float kMost = 0.8f;  // of the variance
    const Lanes variance = blur * blur;
    Lanes apart = split * split;
    const auto much = apart > kMost * variance;
    apart = much ? kMost * variance : apart;
    Lanes most = apart, rest = variance - apart;
    Sqrt(&most);
    Sqrt(&rest);
    split_ = much ? most : split;
    inverse_ = 1 / rest;
    ratio_ = blur * inverse_;
  }
  /// At a distance from the step: its value, and its first two derivatives by distance / blur.
  PLENOCAL_LANES void At(const Lanes& distance, Lanes* value, Lanes* slope, Lanes* bend) const {
    if (!two_) {
      const Lanes z = distance * inverse_;
      Normal(z, value, slope);
      *bend = -z * *slope;
      return;
    }
    const Lanes left = (distance + split_) * inverse_, right = (distance - split_) * inverse_;
    Lanes left_value, left_slope, right_value, right_slope;
    Normal(left, &left_value, &left_slope);
    Normal(right, &right_value, &right_slope);
    *value = 0.5f * (left_value + right_value);
    *slope = 0.5f * ratio_ * (left_slope + right_slope);
    *bend = -0.5f * ratio_ * ratio_ * (left * left_slope + right * right_slope);
  }

 private:
  bool two_ = false;
  Lanes split_{}, inverse_{}, ratio_{};
};

}  // namespace plenocal::internal
