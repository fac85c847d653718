// SPDX-License-Identifier: Apache-2.0
#include "detectors/defocus_shift.h"

#include <Eigen/Dense>
#include <cmath>
#include <optional>
#include <span>

namespace plenocal::internal {
namespace {

constexpr double kSure = 5;  // standard deviations
constexpr int kRounds = 6;   // of reweighting

/// Square root of Cauchy's weight for a residual, three typical lengths wide.
double CauchyRoot(double residual, double mean_square) {
  return 1 / std::sqrt(1 + residual * residual / (9 * mean_square));
}

/// z_t of each type from the blurs: variance = a_t + d_t z + m z^2.
std::optional<Eigen::VectorXd> FocusOfTypes(int types, std::span<const MicroView> views) {
  const int unknowns = 2 * types + 1;
  Eigen::VectorXd fit = Eigen::VectorXd::Zero(unknowns);
  Eigen::MatrixXd information;
  double mean_square = 0;
  for (int round = 0; round < kRounds; ++round) {
    information = Eigen::MatrixXd::Zero(unknowns, unknowns);
    Eigen::VectorXd right = Eigen::VectorXd::Zero(unknowns);
    double squares = 0, count = 0;
    for (const MicroView& view : views) {
      for (const MicroObservation& o : view) {
        Eigen::VectorXd row = Eigen::VectorXd::Zero(unknowns);
        row[2 * o.type] = 1;
        row[2 * o.type + 1] = o.inverse_depth;
        row[unknowns - 1] = o.inverse_depth * o.inverse_depth;
        const double rest = o.blur * o.blur - row.dot(fit);
        const double weight = round == 0 ? 1 : CauchyRoot(rest, mean_square);
        information += weight * weight * row * row.transpose();
        right += weight * weight * o.blur * o.blur * row;
        squares += weight * weight * rest * rest;
        count += 1;
      }
    }
    const auto solver = information.ldlt();
    fit = solver.solve(right);
    if (!fit.allFinite() || count <= unknowns) return std::nullopt;
    // Of the first round `squares` still belongs to the fit before, zero.
    mean_square = squares / (count - unknowns);
  }
  const double m = fit[unknowns - 1];
  const double variance = mean_square * information.inverse()(unknowns - 1, unknowns - 1);
  if (!(m > kSure * std::sqrt(variance))) return std::nullopt;
  Eigen::VectorXd z(types);
  for (int t = 0; t < types; ++t) z[t] = -fit[2 * t + 1] / (2 * m);
  return z;
}

/// Observations of one marker in one view.
std::vector<std::span<const MicroObservation>> RunsOf(std::span<const MicroView> views) {
  std::vector<std::span<const MicroObservation>> runs;
  for (const MicroView& view : views) {
    for (size_t begin = 0, end = 0; begin < view.size(); begin = end) {
      while (end < view.size() && view[end].seen.marker == view[begin].seen.marker) ++end;
      // Three unknowns of its own; the more beyond, the more it says.
      if (end - begin > 2) runs.emplace_back(view.data() + begin, end - begin);
    }
  }
  return runs;
}

Eigen::Vector2d Offset(const Observation& seen) {
  return {seen.values[0] - seen.values[2], seen.values[1] - seen.values[3]};
}

/// lambda of each type: all x of a marker in a frame are affine in the micro-image centres.
std::optional<Eigen::VectorXd> ShiftOfTypes(int types,
                                            const Eigen::VectorXd& focus,
                                            std::span<const MicroView> views) {
  const auto runs = RunsOf(views);
  Eigen::VectorXd lambda = Eigen::VectorXd::Zero(types);
  Eigen::MatrixXd information;
  double mean_square = 1;  // of the residuals, in sigmas
  for (int round = 0; round < kRounds; ++round) {
    information = Eigen::MatrixXd::Zero(types, types);
    Eigen::VectorXd right = Eigen::VectorXd::Zero(types);
    double squares = 0, redundancy = 0;
    for (const auto& run : runs) {
      const auto n = 2 * static_cast<Eigen::Index>(run.size());
      // x = u_0 + s c + lambda_t (z_t - z) (x - c), rows divided by sigma.
      Eigen::MatrixXd own = Eigen::MatrixXd::Zero(n, 3);
      Eigen::MatrixXd shared = Eigen::MatrixXd::Zero(n, types);
      Eigen::VectorXd rest(n);
      Eigen::Index row = 0;
      for (const MicroObservation& o : run) {
        const Eigen::Vector2d offset = Offset(o.seen);
        for (Eigen::Index k = 0; k < 2; ++k, ++row) {
          own(row, k) = 1;
          own(row, 2) = o.seen.values[static_cast<size_t>(2 + k)] -
                        run[0].seen.values[static_cast<size_t>(2 + k)];
          shared(row, o.type) = (focus[o.type] - o.inverse_depth) * offset[k];
          rest[row] = o.seen.values[static_cast<size_t>(k)];
        }
        own.middleRows<2>(row - 2) /= o.seen.sigma;
        shared.middleRows<2>(row - 2) /= o.seen.sigma;
        rest.segment<2>(row - 2) /= o.seen.sigma;
      }
      if (round > 0) {
        const Eigen::VectorXd free = rest - shared * lambda;
        const Eigen::VectorXd r = free - own * own.colPivHouseholderQr().solve(free);
        for (Eigen::Index i = 0; i < n; ++i) {
          const double weight = CauchyRoot(r[i], mean_square);
          own.row(i) *= weight;
          shared.row(i) *= weight;
          rest[i] *= weight;
        }
      }
      const auto solver = own.colPivHouseholderQr();
      shared -= own * solver.solve(shared);
      rest -= own * solver.solve(rest);
      information += shared.transpose() * shared;
      right += shared.transpose() * rest;
      squares += (rest - shared * lambda).squaredNorm();
      redundancy += static_cast<double>(n - 3);
    }
    lambda = information.ldlt().solve(right);
    if (!lambda.allFinite() || !(redundancy > 0)) return std::nullopt;
    mean_square = squares / redundancy;
  }
  const double square = lambda.dot(information * lambda) / mean_square;
  if (!(square > kSure * kSure)) return std::nullopt;
  return lambda;
}

}  // namespace

void RemoveDefocusShifts(int types, std::vector<MicroView>* views) {
  if (types < 2) return;
  const auto focus = FocusOfTypes(types, *views);
  if (!focus) return;
  const auto lambda = ShiftOfTypes(types, *focus, *views);
  if (!lambda) return;
  for (MicroView& view : *views) {
    for (MicroObservation& o : view) {
      const double stretch = 1 + (*lambda)[o.type] * ((*focus)[o.type] - o.inverse_depth);
      const Eigen::Vector2d offset = Offset(o.seen) / stretch;
      for (size_t k = 0; k < 2; ++k) {
        o.seen.values[k] = o.seen.values[2 + k] + offset[static_cast<Eigen::Index>(k)];
      }
    }
  }
}

}  // namespace plenocal::internal
