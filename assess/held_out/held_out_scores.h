// SPDX-License-Identifier: Apache-2.0
//
// Scores of models on held-out frames, and tests between two of them. A model's score depends on no
// other model.
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstddef>
#include <span>
#include <string>
#include <vector>

#include "calib/camera/observation.h"

namespace plenocal {

/// Residual of a held-out point under one model.
struct HeldOutResidual {
  bool imaged = false;
  std::array<double, kMaxObservationSize> values{};  ///< measured minus predicted, px
};

class HeldOutScores {
 public:
  /// Points in `frames` frames that were held out in `folds` parts, with the frame of each;
  /// residuals have `rows` coordinates.
  HeldOutScores(std::vector<size_t> frame_of, size_t frames, size_t folds, size_t rows);

  /// Points that count: those that are no outliers.
  void SetGood(std::vector<bool> good);

  /// Part of the points that count which the model images.
  [[nodiscard]] double Imaged(std::span<const HeldOutResidual> model) const;
  [[nodiscard]] bool Counts(size_t point, std::span<const HeldOutResidual> model) const {
    return good_[point] && model[point].imaged;
  }

  /// RMS of the residuals' lengths and its standard error with frames as units, px.
  struct Rms {
    double value = 0, sigma = 0;
  };
  [[nodiscard]] Rms Score(std::span<const HeldOutResidual> model) const;

  /// Mean square of the residuals of `model` less that of `other`, over the points that both image,
  /// px^2.
  [[nodiscard]] double Excess(std::span<const HeldOutResidual> model,
                              std::span<const HeldOutResidual> other) const;

  /// Logarithms of the mean squares of frames under models, over the points that all of them image:
  /// frames with such points x models.
  [[nodiscard]] Eigen::MatrixXd LogSquares(
      const std::vector<std::span<const HeldOutResidual>>& models) const;

  /// Of residuals that are worse by as much as those of `model` are, if it were as good as `other`:
  /// the smaller p-value of two one-sided t-tests over frames, of the logarithms of the ratios of
  /// mean squares (squares of a model that does not fit have long tails), and of the correlation of
  /// the residuals with the difference between both models' predictions, which finds errors much
  /// smaller than the noise (Clark and West, Approximately normal tests for equal predictive
  /// accuracy in nested models, Journal of Econometrics 138, 2007). 1 when `model` is not worse.
  [[nodiscard]] double ProbabilityOfEqual(std::span<const HeldOutResidual> model,
                                          std::span<const HeldOutResidual> other) const;

 private:
  struct Mean {
    double value = 0, sigma = 0;
  };
  // Of each frame: a sum over its points, and their number.
  struct Sums {
    std::vector<double> sums, points;
  };
  // Sums of squares of `model` over the points that `other` images as well.
  [[nodiscard]] Sums Squares(std::span<const HeldOutResidual> model,
                             std::span<const HeldOutResidual> other) const;
  [[nodiscard]] Mean OverFrames(const Sums& frames) const;
  [[nodiscard]] double ProbabilityOfRatio(const Sums& model, const Sums& other) const;
  [[nodiscard]] double ProbabilityOfAgreement(std::span<const HeldOutResidual> model,
                                              std::span<const HeldOutResidual> other) const;

  std::vector<size_t> frame_of_;
  size_t frames_, folds_, rows_;
  std::vector<bool> good_;
};

}  // namespace plenocal
