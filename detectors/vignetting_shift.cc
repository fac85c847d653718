// SPDX-License-Identifier: Apache-2.0
#include "detectors/vignetting_shift.h"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <numbers>
#include <span>

namespace plenocal::internal {
namespace {

constexpr int kRounds = 6;  // of reweighting

/// k_pixel and the two k of each type, and a root of their covariance.
struct Shifts {
  Eigen::VectorXd k;
  Eigen::MatrixXd root;
};

/// Change of (x, y) with each of `Shifts::k`.
Eigen::Matrix2Xd ByShifts(int types, const DepthLine& line, const MicroObservation& o) {
  Eigen::Matrix2Xd by = Eigen::Matrix2Xd::Zero(2, 1 + 2 * types);
  by.col(0) = o.pull.col(0);
  by.middleCols<2>(1 + 2 * o.type) = o.pull.col(1) * line.At(o.inverse_depth).transpose();
  return by;
}

/// The shifts that the micro images of markers show: all x of a marker in a view are affine in the
/// micro-image centres.
Shifts FindShifts(int types, const DepthLine& line, std::span<const MicroView> views) {
  // px^2. A pixel's area has a variance of 1 / 12, its point spread one of up to 0.6^2; as much as
  // an even distribution between these. An aperture's covariance is about 1 where it blurs by a px.
  constexpr double kLeastPixel = 1 / 12.0, kPointSpread = 0.36, kAperturePrior = 1;
  constexpr double kFormula = 0.1;  // of a shift: what the two terms leave (header)
  const auto runs = RunsOf(views);
  const Eigen::Index count = 1 + 2 * types;
  Eigen::VectorXd prior = Eigen::VectorXd::Zero(count);
  prior[0] = kLeastPixel + kPointSpread / 2;
  Eigen::VectorXd precision = Eigen::VectorXd::Constant(count, 1 / kAperturePrior);
  precision[0] = 12 / (kPointSpread * kPointSpread);
  Shifts shifts{prior, {}};
  Eigen::VectorXd& k = shifts.k;
  double mean_square = 1;  // of the residuals, in sigmas
  for (int round = 0; round < kRounds; ++round) {
    Eigen::MatrixXd information = (mean_square * precision).asDiagonal();
    Eigen::VectorXd right = information * prior;
    double squares = 0, redundancy = 0;
    for (const auto& run : runs) {
      const auto n = 2 * static_cast<Eigen::Index>(run.size());
      // x = u_0 + s c + k pull, rows divided by sigma.
      Eigen::MatrixXd own = Eigen::MatrixXd::Zero(n, 3);
      Eigen::MatrixXd shared = Eigen::MatrixXd::Zero(n, count);
      Eigen::VectorXd rest(n);
      Eigen::Index row = 0;
      for (const MicroObservation& o : run) {
        shared.middleRows<2>(row) = ByShifts(types, line, o);
        own.block<2, 2>(row, 0).setIdentity();
        own.block<2, 1>(row, 2) = o.U0ByInverseDepth() - run[0].U0ByInverseDepth();
        rest.segment<2>(row) = o.U0();
        row += 2;
        own.middleRows<2>(row - 2) /= o.seen.sigma;
        shared.middleRows<2>(row - 2) /= o.seen.sigma;
        rest.segment<2>(row - 2) /= o.seen.sigma;
      }
      if (round > 0) {
        const Eigen::VectorXd free = rest - shared * k;
        const Eigen::VectorXd r = free - own * own.colPivHouseholderQr().solve(free);
        for (Eigen::Index i = 0; i < n; ++i) {
          const double weight = std::sqrt(CauchyWeight(r[i], mean_square));
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
      squares += (rest - shared * k).squaredNorm();
      redundancy += static_cast<double>(n - 3);
    }
    k = information.ldlt().solve(right);
    if (redundancy > 0 && squares > 0) mean_square = squares / redundancy;
    if (round == kRounds - 1) {
      Eigen::MatrixXd covariance = information.inverse() * mean_square;
      covariance.diagonal() += (kFormula * k).cwiseAbs2();
      shifts.root = covariance.llt().matrixL();
    }
  }
  return shifts;
}

}  // namespace

double ApertureShape(double V) {
  // The segment of height e = 1 - d is 4 sqrt(2) / (3 pi) e^(3/2) (1 - 0.15 e + ..) of the disc.
  const double first =
      std::pow(std::max(0.0, 1 - V) * 3 * std::numbers::pi / (4 * std::sqrt(2)), 2.0 / 3);
  const double e = std::min(1.0, first * (1 + 0.1 * first));
  return 4.0 / 3 * e * (2 - e);
}

std::vector<std::vector<std::vector<double>>> RemoveVignettingShifts(
    int types, std::vector<MicroView>* views) {
  std::vector<std::vector<std::vector<double>>> left(views->size());
  const DepthLine line(*views);
  const Shifts shifts = FindShifts(types, line, *views);
  if (!shifts.k.allFinite() || !shifts.root.allFinite()) return left;
  for (size_t v = 0; v < views->size(); ++v) {
    for (MicroObservation& o : (*views)[v]) {
      const Eigen::Matrix2Xd by = ByShifts(types, line, o);
      o.Move(-by * shifts.k);
      const Eigen::Matrix<double, 2, Eigen::Dynamic, Eigen::RowMajor> uncertain = by * shifts.root;
      left[v].emplace_back(uncertain.data(), uncertain.data() + uncertain.size());
    }
  }
  return left;
}

}  // namespace plenocal::internal
