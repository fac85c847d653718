// SPDX-License-Identifier: Apache-2.0
//
// Tails of the distributions that the tests of this project need.
#pragma once

namespace plenocal {

/// P(chi-square with k degrees of freedom > x), k >= 1: Q(k/2, x/2) by its recurrence in k.
double ChiSquareTail(int k, double x);

/// x with ChiSquareTail(k, x) = p.
double ChiSquareQuantile(int k, double p);

/// P(F > x) with m and n degrees of freedom, by Paulson's normal approximation of F^(1/3) (Annals
/// of Mathematical Statistics 13, 1942).
double FTail(double x, double m, double n);

/// P(t > x) of Student's t with n degrees of freedom; t^2 is F with 1 and n. To some 1e-3.
double StudentTail(double x, double n);

}  // namespace plenocal
