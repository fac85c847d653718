// SPDX-License-Identifier: Apache-2.0
#include "detectors/plenoptic/markers/vignetting_correction.h"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <numbers>
#include <span>

#include "calib/base/linear_algebra.h"

namespace plenocal::internal {
namespace {

constexpr int kReweightings = 6;  // of reweighting

/// k_pixel, px^2: a pixel's area has a variance of 1 / 12, its point spread one of up to 0.6^2.
constexpr double kPixelArea = 1 / 12.0, kPointSpread = 0.36;
/// k, px^2: an aperture's covariance is about 1 where it blurs by a pixel.
constexpr double kAperturePrior = 1;
/// Relative error of a displacement by the formula of the header.
constexpr double kFormulaError = 0.1;
/// Unknowns of one marker in one image: two of u_0, and its depth.
constexpr int kOwnUnknowns = 3;

/// k_pixel and the two k of each type (at the nearest and the farthest marker), and a root of their
/// covariance.
struct Displacement {
  Eigen::VectorXd k;
  Eigen::MatrixXd root;
};

/// Change of (x, y) with each of `Displacement::k`.
Eigen::Matrix2Xd ByDisplacement(int types,
                                const DepthInterpolation& depths,
                                const MarkerMeasurement& m) {
  Eigen::Matrix2Xd by = Eigen::Matrix2Xd::Zero(2, 1 + 2 * types);
  by.col(0) = m.vignetting_sensitivity.col(0);
  by.middleCols<2>(1 + 2 * m.lens_type) =
      m.vignetting_sensitivity.col(1) * depths.Weights(m.inverse_depth).transpose();
  return by;
}

/// Equations x = u_0 + s c + k sensitivity of one marker in one image, rows divided by sigma:
/// `own` for u_0 and s, `shared` for k.
struct MarkerEquations {
  Eigen::MatrixXd own, shared;
  Eigen::VectorXd rest;

  MarkerEquations(std::span<const MarkerMeasurement> group,
                  int types,
                  const DepthInterpolation& depths) {
    const auto n = 2 * static_cast<Eigen::Index>(group.size());
    own = Eigen::MatrixXd::Zero(n, kOwnUnknowns);
    shared = Eigen::MatrixXd::Zero(n, 1 + 2 * types);
    rest.resize(n);
    Eigen::Index row = 0;
    for (const MarkerMeasurement& m : group) {
      shared.middleRows<2>(row) = ByDisplacement(types, depths, m);
      own.block<2, 2>(row, 0).setIdentity();
      own.block<2, 1>(row, 2) = m.U0ByInverseDepth() - group[0].U0ByInverseDepth();
      rest.segment<2>(row) = m.U0();
      own.middleRows<2>(row) /= m.observation.detector_sigma;
      shared.middleRows<2>(row) /= m.observation.detector_sigma;
      rest.segment<2>(row) /= m.observation.detector_sigma;
      row += 2;
    }
  }

  /// Multiplies the rows by the roots of their robust weights about the displacement k.
  void Reweight(const Eigen::VectorXd& k, double mean_square) {
    const Eigen::VectorXd free = rest - shared * k;
    const Eigen::VectorXd r = free - own * LeastSquares(own, free);
    for (Eigen::Index i = 0; i < rest.size(); ++i) {
      const double weight = std::sqrt(WideCauchyWeight(r[i], mean_square));
      own.row(i) *= weight;
      shared.row(i) *= weight;
      rest[i] *= weight;
    }
  }

  /// Eliminates u_0 and s.
  void Project() {
    shared -= own * LeastSquares(own, shared);
    rest -= own * LeastSquares(own, rest);
  }
};

/// The displacement that fits best: all x of a marker in an image are affine in the micro-image
/// centres but for it. Iteratively reweighted least squares with a prior.
Displacement FindDisplacement(int types,
                              const DepthInterpolation& depths,
                              std::span<const RawMeasurements> images) {
  const auto groups = GroupByMarker(images);
  const Eigen::Index count = 1 + 2 * types;
  // The point spread's part is evenly distributed over its range: mean range / 2, variance
  // range^2 / 12.
  Eigen::VectorXd prior = Eigen::VectorXd::Zero(count);
  prior[0] = kPixelArea + kPointSpread / 2;
  Eigen::VectorXd precision = Eigen::VectorXd::Constant(count, 1 / kAperturePrior);
  precision[0] = 12 / (kPointSpread * kPointSpread);
  Displacement displacement{prior, {}};
  Eigen::VectorXd& k = displacement.k;
  Eigen::MatrixXd information;
  double mean_square = 1;  // of the residuals, in sigmas
  for (int round = 0; round < kReweightings; ++round) {
    information = (mean_square * precision).asDiagonal();
    Eigen::VectorXd right = information * prior;
    double squares = 0, redundancy = 0;
    for (const auto& group : groups) {
      MarkerEquations equations(group, types, depths);
      if (round > 0) equations.Reweight(k, mean_square);
      equations.Project();
      information += equations.shared.transpose() * equations.shared;
      right += equations.shared.transpose() * equations.rest;
      squares += (equations.rest - equations.shared * k).squaredNorm();
      redundancy += static_cast<double>(equations.rest.size() - kOwnUnknowns);
    }
    k = SolveSymmetric(information, right);
    if (redundancy > 0 && squares > 0) mean_square = squares / redundancy;
  }
  Eigen::MatrixXd covariance = Inverse(information) * mean_square;
  covariance.diagonal() += (kFormulaError * k).cwiseAbs2();
  displacement.root = covariance.llt().matrixL();
  return displacement;
}

}  // namespace

double ApertureShape(double V) {
  // The segment of height e = 1 - d is 4 sqrt(2) / (3 pi) e^(3/2) (1 - 0.15 e + ..) of the disc.
  // Its inverse is the leading power `first` times 1 + 2/3 * 0.15 e.
  constexpr double kSecondOrder = 0.1;
  const double first =
      std::pow(std::max(0.0, 1 - V) * 3 * std::numbers::pi / (4 * std::sqrt(2)), 2.0 / 3);
  const double e = std::min(1.0, first * (1 + kSecondOrder * first));
  return 4.0 / 3 * e * (2 - e);
}

std::vector<std::vector<std::vector<double>>> CorrectVignettingDisplacement(
    int types, std::vector<RawMeasurements>* images) {
  std::vector<std::vector<std::vector<double>>> left(images->size());
  const DepthInterpolation depths(*images);
  const Displacement displacement = FindDisplacement(types, depths, *images);
  if (!displacement.k.allFinite() || !displacement.root.allFinite()) return left;
  for (size_t i = 0; i < images->size(); ++i) {
    for (MarkerMeasurement& m : (*images)[i]) {
      const Eigen::Matrix2Xd by = ByDisplacement(types, depths, m);
      m.Move(-by * displacement.k);
      const Eigen::Matrix<double, 2, Eigen::Dynamic, Eigen::RowMajor> uncertain =
          by * displacement.root;
      left[i].emplace_back(uncertain.data(), uncertain.data() + uncertain.size());
    }
  }
  return left;
}

}  // namespace plenocal::internal
