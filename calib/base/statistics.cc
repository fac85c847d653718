// SPDX-License-Identifier: Apache-2.0
#include "calib/base/statistics.h"

#include <algorithm>
#include <boost/math/distributions/chi_squared.hpp>
#include <boost/math/distributions/fisher_f.hpp>
#include <boost/math/distributions/students_t.hpp>
#include <cmath>

namespace plenocal {
namespace {

namespace policies = boost::math::policies;
// NaN and infinity in place of exceptions.
using NoThrow = policies::policy<policies::domain_error<policies::ignore_error>,
                                 policies::pole_error<policies::ignore_error>,
                                 policies::overflow_error<policies::ignore_error>,
                                 policies::evaluation_error<policies::ignore_error>,
                                 policies::promote_double<false>>;
using ChiSquareDistribution = boost::math::chi_squared_distribution<double, NoThrow>;
using FDistribution = boost::math::fisher_f_distribution<double, NoThrow>;
using StudentDistribution = boost::math::students_t_distribution<double, NoThrow>;

// Boost has no tails beyond negative squares (rounding) and infinite ones.
double AsSquare(double x) { return std::clamp(x, 0.0, 1e300); }

}  // namespace

double Quantile(std::vector<double> values, double part) {
  if (values.empty()) return 0;
  const auto at = values.begin() + std::lround(part * static_cast<double>(values.size() - 1));
  std::nth_element(values.begin(), at, values.end());
  return *at;
}

double ChiSquareTail(double k, double x) {
  return cdf(complement(ChiSquareDistribution(k), AsSquare(x)));
}
double ChiSquareQuantile(double k, double p) {
  return quantile(complement(ChiSquareDistribution(k), p));
}
double FTail(double x, double m, double n) {
  return cdf(complement(FDistribution(m, n), AsSquare(x)));
}
double StudentTail(double x, double n) { return cdf(complement(StudentDistribution(n), x)); }

double TailOfWeightedSquares(double x, double sum, double sum_of_squares) {
  const double degrees = sum * sum / sum_of_squares;
  return ChiSquareTail(degrees, degrees * x / sum);
}

}  // namespace plenocal
