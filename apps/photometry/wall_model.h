// SPDX-License-Identifier: Apache-2.0
//
// Model of the views of a wall: brightness c of the wall by cell, gain g of each view, attenuation
// v by pixel of the reduced images (all logarithms), noise of the pixels. Holds the estimates while
// they are fitted, and predicts each sample from them.
#pragma once

#include <Eigen/Core>
#include <array>
#include <cmath>
#include <string>
#include <utility>
#include <vector>

#include "apps/photometry/response/sum_parts.h"
#include "apps/photometry/wall_samples.h"

namespace plenocal {

/// Width of Tukey's biweight in standard deviations; specular spots lie beyond it.
inline constexpr double kTukeyWidth = 6;
/// Side of the blocks of cells, in cells: far more than the distance over which errors of
/// neighbouring cells correlate.
inline constexpr size_t kBlockCells = 8;

inline double Square(double x) { return x * x; }

class WallModel {
 public:
  /// Where a sample lies: row and column of the grid.
  struct Cell {
    size_t row, column;
  };
  /// The model's prediction of a sample. `light` and the noise in `weight` follow from the model:
  /// computed from the sample, they would depend on its noise and bias the estimates.
  struct Expected {
    double light = 0;
    double residual = 0;  ///< of the light, relative
    double weight = 0;    ///< inverse of the variance, with the correlated noise of neighbours
    double freedom = 1;   ///< variance of the residual over that of the sample
  };

  /// Throws `Error` as `ChooseGrid` does.
  WallModel(WallRecording wall, const std::string& where, int threads);

  [[nodiscard]] const WallRecording& Wall() const { return wall_; }
  [[nodiscard]] int Threads() const { return threads_; }
  [[nodiscard]] const WallGrid& Grid() const { return grid_; }
  [[nodiscard]] const WallProjector& Projector() const { return projector_; }
  [[nodiscard]] const std::vector<WallRow>& Rows() const { return rows_; }
  /// c by row and column of the grid; NaN: in no view.
  [[nodiscard]] const std::vector<std::vector<float>>& Brightness() const { return c_; }
  [[nodiscard]] const Eigen::VectorXd& Gains() const { return g_; }
  [[nodiscard]] const cv::Mat& Attenuation() const { return v_; }
  /// By view: 1, or 0 for a view that `LeaveOutMisplaced` has left out.
  [[nodiscard]] const Eigen::VectorXd& Used() const { return used_; }
  [[nodiscard]] size_t Measurements() const;

  void SetAttenuation(cv::Mat v) { v_ = std::move(v); }
  void ChangeGains(const Eigen::VectorXd& change) { g_ += change; }
  void EstimateWall();
  /// Estimates the variance of a pixel's light as a linear function of the light, from the
  /// residuals. Weights are robust from then on.
  void EstimateNoise();
  /// Leaves out the view that fits the wall of the others worst, if far worse than usual: its pose
  /// may be the second, mirrored solution for the tilt of a small marker. To be called before
  /// weights are robust, which would hide the misfit.
  bool LeaveOutMisplaced();
  /// Refines the poses by the wall's texture: those from the marker are uncertain far from it.
  void RefinePoses();

  [[nodiscard]] Expected Expect(const WallSample& s, const Cell& cell) const;
  /// Relative variance of a sample with this light by the noise of its pixels.
  [[nodiscard]] double Noise(const WallSample& s, double light) const;
  /// Mean square of the differences of a cell's brightness from those beside it, relative; NaN at
  /// the border.
  [[nodiscard]] double Texture(const Cell& cell) const;

  /// The sum of what body(cell, sample, expected, &sum) adds to `zero` for all samples with a
  /// weight. A part of the sum covers whole rows of blocks.
  template <typename Sum, typename Body>
  [[nodiscard]] Sum SumSamples(const Sum& zero, const Body& body) const {
    return SumParts(zero, threads_, [&](size_t part, Sum* sum) {
      std::vector<Expected> expected;
      constexpr size_t kSkip = (kSumParts - 1) * kBlockCells;
      for (size_t r = part * kBlockCells; r < rows_.size();
           r += r % kBlockCells + 1 == kBlockCells ? kSkip + 1 : 1) {
        const WallRow& row = rows_[r];
        for (size_t column = 0; column + 1 < row.begin.size(); ++column) {
          if (std::isnan(c_[r][column])) continue;
          const Cell cell{r, column};
          expected.clear();
          double total = 0;
          for (const WallSample& s : row.Samples(column)) {
            expected.push_back(Expect(s, cell));
            total += expected.back().weight;
          }
          auto at = expected.begin();
          for (const WallSample& s : row.Samples(column)) {
            at->freedom = std::max(1 - at->weight / total, 0.1);
            if (at->weight > 0) body(cell, s, *at, sum);
            ++at;
          }
        }
      }
    });
  }

 private:
  void Sample();
  void EstimateCell(const Cell& cell);
  void EstimateAround(const Cell& cell);
  void RefinePose(size_t view);
  void TabulateNoise();
  [[nodiscard]] double Rounding(double light) const;
  [[nodiscard]] double LogVariance(double light) const;
  [[nodiscard]] double Predicted(const WallSample& s) const {
    return g_[s.view] + Interpolate(v_, s.x, s.y);
  }

  WallRecording wall_;
  int threads_;
  WallGrid grid_;
  WallProjector projector_;
  std::vector<WallRow> rows_;
  std::vector<std::vector<float>> c_;
  std::vector<std::vector<float>> around_;    // logarithm of the mean brightness around each cell
  std::vector<std::vector<float>> contrast_;  // `Texture` of each cell, 0 where it has none
  Eigen::VectorXd g_, used_;
  cv::Mat v_;
  double noise_gain_ = 255.0 / 1e4, noise_read_ = 0;  // variance of a pixel: gain * light + read
  std::array<float, 1024> log_variances_{};           // of a reduced pixel, by light
  bool robust_ = false;
};

}  // namespace plenocal
