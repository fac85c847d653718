// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Cholesky>
#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <optional>
#include <span>
#include <vector>

namespace plenocal::internal {

/// A pixel of a patch: where it is and its gray value.
struct Pixel {
  double x = 0, y = 0, gray = 0;
};

/// What a fit of a model with N parameters to a patch of pixels found.
template <int N>
struct PatchFit {
  Eigen::Matrix<double, N, 1> params;
  /// Of the parameters, from the residuals (see FitPatch).
  Eigen::Matrix<double, N, N> covariance;
  /// Root mean square of the residuals, gray levels.
  double rms = 0;
  /// Share of the patch's variance that the model explains, at most 1.
  double explained = 0;
};

/// Standard deviation of a gray value that was rounded to an integer.
inline constexpr double kRoundingVariance = 1.0 / 12;

/// Levenberg-Marquardt on sum (model - gray)^2. `Model` has
///   double operator()(const Params& params, const Pixel&, Params* gradient) const
///   bool Plausible(const Params& params) const   (false stops the fit: it has left the patch)
/// and its parameters 0 and 1 are x, y of the point sought; the fit is done when these rest.
///
/// The covariance is the "sandwich" H^-1 (sum r^2 J^T J) H^-1 with H = sum J^T J: the noise is
/// measured where the parameters feel it. Where black or white is clipped the residuals vanish
/// though the edges are noisy, and shot noise grows with brightness; a single variance for the
/// whole patch would be too small there (MacKinnon and White 1985, "HC2"). Noise that is correlated
/// from pixel to pixel (demosaicking, JPEG) makes the true scatter larger than this.
template <int N, typename Model>
std::optional<PatchFit<N>> FitPatch(const Model& model,
                                    std::span<const Pixel> pixels,
                                    const Eigen::Matrix<double, N, 1>& start) {
  using Params = Eigen::Matrix<double, N, 1>;
  using Square = Eigen::Matrix<double, N, N>;
  if (pixels.size() <= static_cast<std::size_t>(N)) return std::nullopt;
  constexpr int kMaxSteps = 50;
  constexpr double kRest = 1e-4;        // px, a hundredth of the best corner's sigma
  constexpr double kSmallGain = 1e-3;   // of the cost, far below its own uncertainty
  constexpr double kMaxLeverage = 0.9;  // a pixel that fixes a parameter alone tells no error
  constexpr double kMinDamping = 1e-9, kMaxDamping = 1e8;

  const auto normal_equations = [&](const Params& params, Square* H, Params* b) {
    H->setZero();
    b->setZero();
    double cost = 0;
    Params J;
    for (const Pixel& pixel : pixels) {
      const double r = model(params, pixel, &J) - pixel.gray;
      H->template selfadjointView<Eigen::Lower>().rankUpdate(J);
      b->noalias() += r * J;
      cost += r * r;
    }
    return cost;
  };

  PatchFit<N> fit;
  Square H, H_new;
  Params b, b_new;
  double cost = normal_equations(start, &H, &b);
  fit.params = start;
  double damping = 1e-3;
  bool rests = false;
  for (int step = 0; step < kMaxSteps && !rests; ++step) {
    Square damped = H;
    damped.diagonal() += damping * H.diagonal();
    damped.diagonal().array() += 1e-12 * H.diagonal().maxCoeff();
    const Params delta = damped.template selfadjointView<Eigen::Lower>().ldlt().solve(-b);
    if (!delta.allFinite()) return std::nullopt;
    const Params candidate = fit.params + delta;
    const double new_cost =
        model.Plausible(candidate) ? normal_equations(candidate, &H_new, &b_new) : 2 * cost + 1;
    // How much of the promised descent there was. The residuals of sharpened images are large, and
    // undamped steps would swing to and fro.
    const double promised =
        -2 * b.dot(delta) - delta.dot(H.template selfadjointView<Eigen::Lower>() * delta);
    const double gain = promised > 0 ? (cost - new_cost) / promised : 0;
    rests = std::hypot(delta[0], delta[1]) < kRest && std::abs(promised) < kSmallGain * cost;
    if (new_cost < cost) {
      fit.params = candidate;
      cost = new_cost;
      H = H_new;
      b = b_new;
    }
    if (gain > 0.7) damping = std::max(kMinDamping, damping * 0.1);
    if (gain < 0.3) damping *= gain > 0 ? 3 : 10;
    if (damping > kMaxDamping) break;
  }
  if (!rests) return std::nullopt;

  Square ridge = H;
  ridge.diagonal().array() += 1e-12 * H.diagonal().maxCoeff();
  const Square H_inverse =
      ridge.template selfadjointView<Eigen::Lower>().ldlt().solve(Square::Identity());
  Square meat = Square::Zero();
  Params J;
  double sum = 0, sum_squares = 0;
  for (const Pixel& pixel : pixels) {
    const double r = model(fit.params, pixel, &J) - pixel.gray;
    // The fit has drawn the model towards pixels that matter much; their errors are larger than
    // their residuals by 1 / sqrt(1 - leverage).
    const double leverage = std::clamp(J.dot(H_inverse * J), 0.0, kMaxLeverage);
    meat.template selfadjointView<Eigen::Lower>().rankUpdate(
        J, std::max(r * r, kRoundingVariance) / (1 - leverage));
    sum += pixel.gray;
    sum_squares += pixel.gray * pixel.gray;
  }
  const auto n = static_cast<double>(pixels.size());
  const Square full_meat = meat.template selfadjointView<Eigen::Lower>();
  fit.covariance = H_inverse * full_meat * H_inverse;
  fit.rms = std::sqrt(cost / n);
  const double variance = sum_squares - sum * sum / n;
  fit.explained = variance > 0 ? 1 - cost / variance : 0;
  if (!fit.covariance.allFinite()) return std::nullopt;
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
