// SPDX-License-Identifier: Apache-2.0
#include "assess/held_out/held_out_scores.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "calib/base/statistics.h"

namespace plenocal {
namespace {

constexpr double kExact = 1e-6;  // px; smaller residuals are rounding

}  // namespace

HeldOutScores::HeldOutScores(std::vector<size_t> frame_of, size_t frames, size_t folds, size_t rows)
    : frame_of_(std::move(frame_of)),
      frames_(frames),
      folds_(folds),
      rows_(rows),
      good_(frame_of_.size(), true) {}

void HeldOutScores::SetGood(std::vector<bool> good) { good_ = std::move(good); }

double HeldOutScores::Imaged(std::span<const HeldOutResidual> model) const {
  double imaged = 0, good = 0;
  for (size_t p = 0; p < good_.size(); ++p) {
    good += good_[p] ? 1 : 0;
    imaged += Counts(p, model) ? 1 : 0;
  }
  return good > 0 ? imaged / good : 0;
}

HeldOutScores::Sums HeldOutScores::Squares(std::span<const HeldOutResidual> model,
                                           std::span<const HeldOutResidual> other) const {
  Sums frames{std::vector<double>(frames_, 0.0), std::vector<double>(frames_, 0.0)};
  for (size_t p = 0; p < good_.size(); ++p) {
    if (!Counts(p, model) || !other[p].imaged) continue;
    frames.points[frame_of_[p]] += 1;
    for (size_t r = 0; r < rows_; ++r) {
      frames.sums[frame_of_[p]] += model[p].values[r] * model[p].values[r];
    }
  }
  return frames;
}

// Mean a point of what frames sum up to. Training sets overlap, so that frames correlate: the
// variance of a mean over n frames is s^2 / n (1 + K / (K - 1)) (Nadeau and Bengio, Inference for
// the generalization error, Machine Learning 52, 2003).
HeldOutScores::Mean HeldOutScores::OverFrames(const Sums& frames) const {
  double sum = 0, count = 0;
  for (size_t f = 0; f < frames_; ++f) {
    sum += frames.sums[f];
    count += frames.points[f];
  }
  Mean mean{.value = sum / count};
  double squares = 0;
  for (size_t f = 0; f < frames_; ++f) {
    squares += std::pow(frames.sums[f] - mean.value * frames.points[f], 2);
  }
  const auto n = static_cast<double>(frames_), k = static_cast<double>(folds_);
  mean.sigma = std::sqrt(squares * n / (n - 1) * (1 + k / (k - 1))) / count;
  return mean;
}

HeldOutScores::Rms HeldOutScores::Score(std::span<const HeldOutResidual> model) const {
  const Mean mean = OverFrames(Squares(model, model));
  const double rms = std::sqrt(mean.value);
  return {rms, rms > 0 ? mean.sigma / (2 * rms) : 0};
}

double HeldOutScores::Excess(std::span<const HeldOutResidual> model,
                             std::span<const HeldOutResidual> other) const {
  return OverFrames(Squares(model, other)).value - OverFrames(Squares(other, model)).value;
}

Eigen::MatrixXd HeldOutScores::LogSquares(
    const std::vector<std::span<const HeldOutResidual>>& models) const {
  const auto frames = static_cast<Eigen::Index>(frames_);
  Eigen::MatrixXd squares = Eigen::MatrixXd::Zero(frames, std::ssize(models));
  Eigen::VectorXd points = Eigen::VectorXd::Zero(frames);
  for (size_t p = 0; p < good_.size(); ++p) {
    if (!std::ranges::all_of(models, [&](const auto& model) { return Counts(p, model); })) continue;
    const auto frame = static_cast<Eigen::Index>(frame_of_[p]);
    points[frame] += 1;
    for (size_t m = 0; m < models.size(); ++m) {
      for (size_t r = 0; r < rows_; ++r) {
        squares(frame, static_cast<Eigen::Index>(m)) += std::pow(models[m][p].values[r], 2);
      }
    }
  }
  std::vector<Eigen::Index> seen;
  for (Eigen::Index f = 0; f < frames; ++f) {
    if (points[f] > 0) seen.push_back(f);
  }
  return (squares(seen, Eigen::all).array().colwise() / points(seen).array() + kExact * kExact)
      .log();
}

double HeldOutScores::ProbabilityOfRatio(const Sums& model, const Sums& other) const {
  Sums ratios{std::vector<double>(frames_, 0.0), model.points};
  for (size_t f = 0; f < frames_; ++f) {
    const double rounding = model.points[f] * kExact * kExact;
    if (rounding == 0) continue;
    ratios.sums[f] =
        model.points[f] * std::log((model.sums[f] + rounding) / (other.sums[f] + rounding));
  }
  const Mean mean = OverFrames(ratios);
  if (!(mean.value > 0)) return 1;
  return StudentTail(mean.value / mean.sigma, static_cast<double>(frames_ - 1));
}

// If the other model describes nothing that this one does not, the terms of frames have no mean and
// do not correlate, since predictions of a frame do not depend on its noise.
double HeldOutScores::ProbabilityOfAgreement(std::span<const HeldOutResidual> model,
                                             std::span<const HeldOutResidual> other) const {
  std::vector<double> sums(frames_, 0.0);
  for (size_t p = 0; p < good_.size(); ++p) {
    if (!Counts(p, model) || !other[p].imaged) continue;
    for (size_t r = 0; r < rows_; ++r) {
      const double difference = model[p].values[r] - other[p].values[r];
      if (std::abs(difference) < kExact) continue;
      sums[frame_of_[p]] += model[p].values[r] * difference;
    }
  }
  double sum = 0, squares = 0;
  const auto n = static_cast<double>(frames_);
  for (const double each : sums) sum += each;
  for (const double each : sums) squares += std::pow(each - sum / n, 2);
  if (!(sum > 0)) return 1;
  return StudentTail(sum / std::sqrt(squares * n / (n - 1)), n - 1);
}

double HeldOutScores::ProbabilityOfEqual(std::span<const HeldOutResidual> model,
                                         std::span<const HeldOutResidual> other) const {
  const Sums own = Squares(model, other), others = Squares(other, model);
  if (!(OverFrames(own).value > OverFrames(others).value)) return 1;
  return std::min(ProbabilityOfRatio(own, others), ProbabilityOfAgreement(model, other));
}

}  // namespace plenocal
