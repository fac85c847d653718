// SPDX-License-Identifier: Apache-2.0
//
// Least-squares fits of a model of the grey values to the pixels of a patch.
#pragma once

#include <Eigen/Cholesky>
#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <optional>
#include <span>
#include <vector>

#include "detectors/templates/square_sums.h"

namespace plenocal::internal {

/// A pixel of a patch: where it is and its gray value.
struct Pixel {
  double x = 0, y = 0, gray = 0;
};

/// The result of a fit of a model with N parameters to a patch of pixels.
template <int N>
struct PixelFit {
  Eigen::Matrix<double, N, 1> params;
  /// Of the parameters, from the residuals (see PixelFitCovariance).
  Eigen::Matrix<double, N, N> covariance;
  /// Root mean square of the residuals, gray levels.
  double rms = 0;
  /// Share of the patch's variance that the model explains, at most 1.
  double explained = 0;
};

/// Variance of a gray value that was rounded to an integer.
inline constexpr double kRoundingVariance = 1.0 / 12;

/// Share of the variance that a model of edges must explain: noise, texture and single edges stay
/// below.
inline constexpr double kMinExplained = 0.6;
/// Sigma (px) of what models of edges leave out (pixels that are squares, curved lines) and the
/// residuals of a clean image do not show.
inline constexpr double kModelError = 0.003;

/// Sums over a patch at some parameters: H = sum J^T J (its lower triangle), b = sum r J, cost =
/// sum r^2, with the residuals r and their gradients J.
template <int N>
struct PixelFitSums {
  Eigen::Matrix<double, N, N> H = Eigen::Matrix<double, N, N>::Zero();
  Eigen::Matrix<double, N, 1> b = Eigen::Matrix<double, N, 1>::Zero();
  double cost = 0;
};

template <int N, typename Model>
PixelFitSums<N> SumPixels(const Model& model,
                          std::span<const Pixel> pixels,
                          const Eigen::Matrix<double, N, 1>& params) {
  // The gradient and the residual, and zeros for AddSquares; of some pixels at a time.
  constexpr int kRows = (N + 1 + 2) / 3 * 3, kLanesPerRow = 8;
  constexpr std::size_t kPixels = kLanesPerRow * kDoubleLanes;
  struct {
    DoubleLanes lanes[kRows * kLanesPerRow] = {};
  } block;
  Eigen::Matrix<double, kRows, kRows> squares = Eigen::Matrix<double, kRows, kRows>::Zero();
  Eigen::Matrix<double, N, 1> J;
  const auto gray_of = model.At(params);
  for (std::size_t first = 0; first < pixels.size(); first += kPixels) {
    const std::size_t count = std::min(kPixels, pixels.size() - first);
    if (count < kPixels) block = {};
    for (std::size_t i = 0; i < count; ++i) {
      DoubleLanes* const column = block.lanes + i / kDoubleLanes;
      const Pixel& pixel = pixels[first + i];
      column[N * kLanesPerRow][i % kDoubleLanes] = gray_of(pixel, &J) - pixel.gray;
      for (int k = 0; k < N; ++k) column[k * kLanesPerRow][i % kDoubleLanes] = J[k];
    }
    AddSquares(block.lanes, kRows, kLanesPerRow, kLanesPerRow, squares.data());
  }
  PixelFitSums<N> sums;
  sums.H = squares.template topLeftCorner<N, N>();
  sums.b = squares.template block<1, N>(N, 0);
  sums.cost = squares(N, N);
  return sums;
}

/// Levenberg-Marquardt. Moves `params` to the minimum and returns the sums there; nothing when the
/// point (parameters 0 and 1) does not rest.
template <int N, typename Model>
std::optional<PixelFitSums<N>> DescendPixels(const Model& model,
                                             std::span<const Pixel> pixels,
                                             Eigen::Matrix<double, N, 1>* params) {
  using Params = Eigen::Matrix<double, N, 1>;
  constexpr int kMaxSteps = 50;
  constexpr double kRest = 1e-4;       // px, a hundredth of the best corner's sigma
  constexpr double kSmallGain = 1e-3;  // of the cost, far below its own uncertainty
  constexpr double kMinDamping = 1e-9, kFirstDamping = 1e-3, kMaxDamping = 1e8;
  constexpr double kRidge = 1e-12;  // of the largest diagonal element: for undetermined parameters
  // The damping follows the share of the promised descent that a step gives.
  constexpr double kGoodShare = 0.7, kPoorShare = 0.3;
  constexpr double kRelax = 0.1, kDampMore = 3, kDampAgainstAscent = 10;

  PixelFitSums<N> sums = SumPixels<N>(model, pixels, *params);
  double damping = kFirstDamping;
  for (int step = 0; step < kMaxSteps; ++step) {
    Eigen::Matrix<double, N, N> damped = sums.H;
    damped.diagonal() += damping * sums.H.diagonal();
    damped.diagonal().array() += kRidge * sums.H.diagonal().maxCoeff();
    const Params delta = damped.template selfadjointView<Eigen::Lower>().ldlt().solve(-sums.b);
    if (!delta.allFinite()) return std::nullopt;
    const Params candidate = *params + delta;
    const bool plausible = model.Plausible(candidate);
    const PixelFitSums<N> next =
        plausible ? SumPixels<N>(model, pixels, candidate) : PixelFitSums<N>{};
    const double next_cost = plausible ? next.cost : 2 * sums.cost + 1;
    // The residuals of sharpened images are large, and undamped steps would swing to and fro.
    const double promised =
        -2 * sums.b.dot(delta) - delta.dot(sums.H.template selfadjointView<Eigen::Lower>() * delta);
    const double share = promised > 0 ? (sums.cost - next_cost) / promised : 0;
    const bool rests =
        std::hypot(delta[0], delta[1]) < kRest && std::abs(promised) < kSmallGain * sums.cost;
    if (next_cost < sums.cost) {
      *params = candidate;
      sums = next;
    }
    if (rests) return sums;
    if (share > kGoodShare) damping = std::max(kMinDamping, damping * kRelax);
    if (share < kPoorShare) damping *= share > 0 ? kDampMore : kDampAgainstAscent;
    if (damping > kMaxDamping) return std::nullopt;
  }
  return std::nullopt;
}

/// Covariance of the parameters at a minimum: the "sandwich" H^-1 (sum r^2 J^T J) H^-1 measures
/// the noise where the parameters depend on it. Where black or white is clipped the residuals
/// vanish though the edges are noisy, and shot noise grows with brightness; a single variance for
/// the whole patch would be too small there (MacKinnon and White 1985, "HC2"). Noise that is
/// correlated from pixel to pixel (demosaicking, JPEG) makes the true scatter larger than this.
template <int N, typename Model>
Eigen::Matrix<double, N, N> PixelFitCovariance(const Model& model,
                                               std::span<const Pixel> pixels,
                                               const Eigen::Matrix<double, N, 1>& params,
                                               const Eigen::Matrix<double, N, N>& H) {
  using Square = Eigen::Matrix<double, N, N>;
  constexpr double kRidge = 1e-12;      // as in DescendPixels
  constexpr double kMaxLeverage = 0.9;  // a pixel that alone fixes a parameter shows no error
  Square ridge = H;
  ridge.diagonal().array() += kRidge * H.diagonal().maxCoeff();
  const Square H_inverse =
      ridge.template selfadjointView<Eigen::Lower>().ldlt().solve(Square::Identity());
  Square meat = Square::Zero();
  Eigen::Matrix<double, N, 1> J;
  const auto gray_of = model.At(params);
  for (const Pixel& pixel : pixels) {
    const double r = gray_of(pixel, &J) - pixel.gray;
    // The fit has drawn the model towards pixels of high leverage; their errors are larger than
    // their residuals by 1 / sqrt(1 - leverage).
    const double leverage = std::clamp(J.dot(H_inverse.lazyProduct(J)), 0.0, kMaxLeverage);
    meat.template selfadjointView<Eigen::Lower>().rankUpdate(
        J, std::max(r * r, kRoundingVariance) / (1 - leverage));
  }
  const Square full_meat = meat.template selfadjointView<Eigen::Lower>();
  return H_inverse * full_meat * H_inverse;
}

/// Least squares of model - gray over a patch. `Model` has
///   At(params), the gray values at these parameters: a function double(const Pixel&, Params* J),
///   which sets the gradient J, and
///   bool Plausible(params); false stops the fit: it has left the patch,
/// and its parameters 0 and 1 are x, y of the point sought; the fit is done when these rest.
template <int N, typename Model>
std::optional<PixelFit<N>> FitPixels(const Model& model,
                                     std::span<const Pixel> pixels,
                                     const Eigen::Matrix<double, N, 1>& start) {
  if (pixels.size() <= static_cast<std::size_t>(N)) return std::nullopt;
  PixelFit<N> fit;
  fit.params = start;
  const std::optional<PixelFitSums<N>> sums = DescendPixels<N>(model, pixels, &fit.params);
  if (!sums) return std::nullopt;
  fit.covariance = PixelFitCovariance<N>(model, pixels, fit.params, sums->H);
  if (!fit.covariance.allFinite()) return std::nullopt;
  double sum = 0, sum_squares = 0;
  for (const Pixel& pixel : pixels) {
    sum += pixel.gray;
    sum_squares += pixel.gray * pixel.gray;
  }
  const auto n = static_cast<double>(pixels.size());
  fit.rms = std::sqrt(sums->cost / n);
  const double variance = sum_squares - sum * sum / n;
  fit.explained = variance > 0 ? 1 - sums->cost / variance : 0;
  return fit;
}

/// Normal distribution: its integral (-1 to 1) and its density's derivative of that integral.
struct EdgeProfile {
  double value = 0, derivative = 0;
};

/// The profile of a straight edge blurred by a Gaussian of unit width, at distance d: erf(d / sqrt
/// 2).
inline EdgeProfile BlurredEdge(double d) {
  constexpr double kFlat = 5;  // 6e-7 from the limit
  if (std::abs(d) > kFlat) return {d > 0 ? 1.0 : -1.0, 0};
  constexpr double kTwoOverSqrt2Pi = 0.79788456080286536;
  return {std::erf(d * M_SQRT1_2), kTwoOverSqrt2Pi * std::exp(-0.5 * d * d)};
}

}  // namespace plenocal::internal
