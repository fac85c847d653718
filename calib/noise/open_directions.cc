// SPDX-License-Identifier: Apache-2.0
#include "calib/noise/open_directions.h"

#include <algorithm>
#include <cmath>
#include <numeric>

#include "calib/base/linear_algebra.h"
#include "calib/base/statistics.h"

namespace plenocal {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

// Part of the diagonal that is rounding: entries are differences of sums.
constexpr double kRoundingPart = 1e-13;
// The estimate lies where the noise resembles motion most, so a usual level is exceeded too often.
constexpr double kMostByChance = 1e-6;
constexpr int kMostDegrees = 1000;

// NoiseSpectrum u with u' M u = 1, of which each pair is uncorrelated by noise too.
struct NoiseSpectrum {
  MatrixXd vectors;     // those of noise first
  VectorXd noise_part;  // u' N u: 1 where all information is the noise's
  Index open = 0;       // how many noise explains
};

NoiseSpectrum DecomposeByNoise(const NoisyInformation& noisy) {
  const auto& [M, of_noise] = noisy;
  const VectorXd inverse_size = M.diagonal().cwiseMax(1e-300).cwiseSqrt().cwiseInverse();
  const SymmetricEigen spectrum =
      DecomposeSymmetric(MatrixXd(inverse_size.asDiagonal() * M * inverse_size.asDiagonal()));
  const MatrixXd whitening =
      inverse_size.asDiagonal() * spectrum.vectors *
      spectrum.values.cwiseMax(kRoundingPart).cwiseSqrt().cwiseInverse().asDiagonal();
  MatrixXd mean = MatrixXd::Zero(M.rows(), M.cols());
  for (const MatrixXd& sample : of_noise) mean += sample / static_cast<double>(of_noise.size());
  mean.diagonal() += kRoundingPart * M.diagonal();
  const SymmetricEigen parts =
      DecomposeSymmetric(MatrixXd(whitening.transpose() * mean * whitening));
  NoiseSpectrum found{whitening * parts.vectors.rowwise().reverse(), parts.values.reverse(), 0};
  for (; found.open < M.rows(); ++found.open) {
    const VectorXd u = found.vectors.col(found.open);
    const double part = found.noise_part[found.open];
    if (!(part > 0)) break;
    double variance = 0;
    for (const MatrixXd& sample : of_noise) {
      variance += std::pow(u.dot(sample * u) - u.dot(mean * u), 2) /
                  static_cast<double>(of_noise.size() - 1);
    }
    // Noise of this mean and variance is chi-square with so many degrees of freedom.
    const double degrees = std::clamp(2 * part * part / variance, 1.0, double{kMostDegrees});
    if (ChiSquareTail(static_cast<int>(degrees), degrees / part) < kMostByChance) break;
  }
  return found;
}

// The same by coordinates along the columns of a basis.
NoisyInformation Project(const NoisyInformation& noisy, const MatrixXd& basis) {
  NoisyInformation projected{basis.transpose() * noisy.information * basis, {}};
  for (const MatrixXd& sample : noisy.of_noise) {
    projected.of_noise.emplace_back(basis.transpose() * sample * basis);
  }
  return projected;
}

NoiseSpectrum DecomposeByNoise(const NoisyInformation& noisy, const std::vector<Index>& unknowns) {
  const Index all = noisy.information.rows();
  return DecomposeByNoise(Project(noisy, MatrixXd::Identity(all, all)(Eigen::all, unknowns)));
}

// The fewest unknowns (their indices) in which noise still explains as many directions: those with
// small shares are left out, first many at once.
std::vector<Index> FewestUnknowns(const NoisyInformation& noisy, const NoiseSpectrum& all) {
  const VectorXd shares = all.vectors.leftCols(all.open).cwiseAbs().rowwise().maxCoeff();
  std::vector<Index> kept(static_cast<size_t>(shares.size()));
  std::iota(kept.begin(), kept.end(), Index{0});
  std::ranges::stable_sort(kept, std::ranges::less(), [&](Index i) { return shares[i]; });
  for (size_t count = kept.size() / 2; count > 0; count /= 2) {
    for (size_t begin = 0; begin < kept.size();) {
      std::vector<Index> rest = kept;
      const auto first = rest.begin() + static_cast<std::ptrdiff_t>(begin);
      rest.erase(first, first + static_cast<std::ptrdiff_t>(std::min(count, kept.size() - begin)));
      if (!rest.empty() && DecomposeByNoise(noisy, rest).open >= all.open) {
        kept = rest;
      } else {
        begin += count;
      }
    }
  }
  return kept;
}

// An orthonormal basis of what is orthogonal to the columns of U.
MatrixXd Complement(const MatrixXd& U) {
  const MatrixXd onto = U * PseudoInverse(U);
  return DecomposeSymmetric(MatrixXd((onto + onto.transpose()) / 2))
      .vectors.leftCols(U.rows() - U.cols());
}

}  // namespace

NoisyInformation SampleNoise(
    MatrixXd information,
    const std::function<MatrixXd(unsigned sample, double sign)>& information_at) {
  constexpr unsigned kSamples = 16;  // their scatter is known to 18 %
  NoisyInformation noisy{std::move(information), {}};
  for (unsigned sample = 0; sample < kSamples; ++sample) {
    noisy.of_noise.emplace_back((information_at(sample, 1) + information_at(sample, -1)) / 2 -
                                noisy.information);
  }
  return noisy;
}

DeterminedPart Separate(const NoisyInformation& noisy, const VectorXd& unit) {
  const NoisyInformation natural = Project(noisy, unit.asDiagonal());
  const Index unknowns = unit.size();
  const NoiseSpectrum all = DecomposeByNoise(natural);
  MatrixXd open = MatrixXd::Zero(unknowns, all.open);
  if (all.open > 0) {
    const std::vector<Index> fewest = FewestUnknowns(natural, all);
    open(fewest, Eigen::all) = DecomposeByNoise(natural, fewest).vectors.leftCols(all.open);
    for (auto column : open.colwise()) column /= column.cwiseAbs().maxCoeff();
  }
  const MatrixXd basis =
      all.open > 0 ? Complement(open) : MatrixXd(MatrixXd::Identity(unknowns, unknowns));
  const NoiseSpectrum rest = DecomposeByNoise(Project(natural, basis));
  const MatrixXd determined =
      unit.asDiagonal() * basis * rest.vectors *
      (1 - rest.noise_part.cwiseMax(0).array()).inverse().matrix().asDiagonal();
  return {determined * determined.transpose(), unit.asDiagonal() * open};
}

OpenDirection Describe(const Eigen::VectorXd& direction,
                       double sigma,
                       const std::vector<std::string>& names) {
  constexpr double kShare = 0.1;
  OpenDirection described{{}, sigma};
  const double largest = direction.cwiseAbs().maxCoeff();
  for (Eigen::Index i = 0; i < direction.size(); ++i) {
    const double share = std::abs(direction[i]) / largest;
    if (share >= kShare) described.parts.emplace_back(names[static_cast<size_t>(i)], share);
  }
  std::stable_sort(described.parts.begin(), described.parts.end(), [](auto& a, auto& b) {
    return a.second > b.second;
  });
  return described;
}

}  // namespace plenocal
