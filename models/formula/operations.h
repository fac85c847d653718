// SPDX-License-Identifier: Apache-2.0
//
// Operations of a formula and their arithmetic.
#pragma once

#include <cmath>
#include <cstdint>
#include <type_traits>

namespace plenocal::formula {

enum class Op : uint8_t {
  kConstant,
  kInput,
  kAdd,
  kSubtract,
  kMultiply,
  kDivide,
  kNegate,
  kSqrt,
  kExp,
  kLog,
  kLog1p,  ///< log(1 + a)
  kSin,
  kCos,
  kTan,
  kAsin,
  kAcos,
  kAtan,
  kSinh,
  kCosh,
  kTanh,
  kAbs,
  kAtan2,
  kPow,
  kLess,
  kLessEqual,
  kIf,
  kSinc,
  kSincSlope,
  kAngleOverRadius,       ///< atan2(sqrt(a), b) / sqrt(a)
  kAngleOverRadiusSlope,  ///< its derivative by a
};

// Not inlined: the code for wide registers would round them otherwise.

/// sin(x) / x and its derivative, smooth at 0.
[[gnu::noinline]] inline double Sinc(double x) { return x == 0 ? 1 : std::sin(x) / x; }
[[gnu::noinline]] inline double SincSlope(double x) {
  constexpr double kSeries = 0.05;  // the next term is below rounding
  if (std::abs(x) >= kSeries) return (std::cos(x) - std::sin(x) / x) / x;
  const double q = x * x;
  return x * (-1.0 / 3 + q * (1.0 / 30 + q * (-1.0 / 840 + q * (1.0 / 45360 - q / 3991680))));
}

/// atan2(r, z) / r for r^2 = r2 and its derivative by r2, smooth on the axis.
[[gnu::noinline]] inline double AngleByRadius(double r2, double z) {
  constexpr double kSeries = 1e-5;  // of z^2: the next term is below rounding
  if (z > 0 && r2 < kSeries * z * z) {
    const double q = r2 / (z * z);
    return (1 - q * (1.0 / 3 - q * (1.0 / 5 - q / 7))) / z;
  }
  const double r = std::sqrt(r2);
  return std::atan2(r, z) / r;
}
[[gnu::noinline]] inline double AngleByRadiusSlope(double r2, double z) {
  constexpr double kSeries = 1e-3;
  if (z > 0 && r2 < kSeries * z * z) {
    const double q = r2 / (z * z);
    return -(1.0 / 3 -
             q * (2.0 / 5 - q * (3.0 / 7 - q * (4.0 / 9 - q * (5.0 / 11 - q * 6 / 13))))) /
           (z * z * z);
  }
  return (z / (r2 + z * z) - AngleByRadius(r2, z)) / (2 * r2);
}

/// The value of a node by those of its operands.
template <Op op>
inline double Apply(double a, [[maybe_unused]] double b, [[maybe_unused]] double c) {
  if constexpr (op == Op::kAdd) return a + b;
  if constexpr (op == Op::kSubtract) return a - b;
  if constexpr (op == Op::kMultiply) return a * b;
  if constexpr (op == Op::kDivide) return a / b;
  if constexpr (op == Op::kNegate) return -a;
  if constexpr (op == Op::kSqrt) return std::sqrt(a);
  if constexpr (op == Op::kExp) return std::exp(a);
  if constexpr (op == Op::kLog) return std::log(a);
  if constexpr (op == Op::kLog1p) return std::log1p(a);
  if constexpr (op == Op::kSin) return std::sin(a);
  if constexpr (op == Op::kCos) return std::cos(a);
  if constexpr (op == Op::kTan) return std::tan(a);
  if constexpr (op == Op::kAsin) return std::asin(a);
  if constexpr (op == Op::kAcos) return std::acos(a);
  if constexpr (op == Op::kAtan) return std::atan(a);
  if constexpr (op == Op::kSinh) return std::sinh(a);
  if constexpr (op == Op::kCosh) return std::cosh(a);
  if constexpr (op == Op::kTanh) return std::tanh(a);
  if constexpr (op == Op::kAbs) return std::abs(a);
  if constexpr (op == Op::kAtan2) return std::atan2(a, b);
  if constexpr (op == Op::kPow) return std::pow(a, b);
  if constexpr (op == Op::kLess) return a < b ? 1 : 0;
  if constexpr (op == Op::kLessEqual) return a <= b ? 1 : 0;
  if constexpr (op == Op::kIf) return a != 0 ? b : c;
  if constexpr (op == Op::kSinc) return Sinc(a);
  if constexpr (op == Op::kSincSlope) return SincSlope(a);
  if constexpr (op == Op::kAngleOverRadius) return AngleByRadius(a, b);
  if constexpr (op == Op::kAngleOverRadiusSlope) return AngleByRadiusSlope(a, b);
  return a;
}

/// Calls `work` with the operation as a type.
template <typename Work>
inline void WithOperation(Op op, const Work& work) {
#define PLENOCAL_CASE(name) \
  case Op::name:            \
    return work(std::integral_constant<Op, Op::name>())
  switch (op) {
    case Op::kConstant:
    case Op::kInput:
      return;
      PLENOCAL_CASE(kAdd);
      PLENOCAL_CASE(kSubtract);
      PLENOCAL_CASE(kMultiply);
      PLENOCAL_CASE(kDivide);
      PLENOCAL_CASE(kNegate);
      PLENOCAL_CASE(kSqrt);
      PLENOCAL_CASE(kExp);
      PLENOCAL_CASE(kLog);
      PLENOCAL_CASE(kLog1p);
      PLENOCAL_CASE(kSin);
      PLENOCAL_CASE(kCos);
      PLENOCAL_CASE(kTan);
      PLENOCAL_CASE(kAsin);
      PLENOCAL_CASE(kAcos);
      PLENOCAL_CASE(kAtan);
      PLENOCAL_CASE(kSinh);
      PLENOCAL_CASE(kCosh);
      PLENOCAL_CASE(kTanh);
      PLENOCAL_CASE(kAbs);
      PLENOCAL_CASE(kAtan2);
      PLENOCAL_CASE(kPow);
      PLENOCAL_CASE(kLess);
      PLENOCAL_CASE(kLessEqual);
      PLENOCAL_CASE(kIf);
      PLENOCAL_CASE(kSinc);
      PLENOCAL_CASE(kSincSlope);
      PLENOCAL_CASE(kAngleOverRadius);
      PLENOCAL_CASE(kAngleOverRadiusSlope);
  }
#undef PLENOCAL_CASE
}

}  // namespace plenocal::formula
