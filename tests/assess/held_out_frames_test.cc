// SPDX-License-Identifier: Apache-2.0
#include "assess/held_out/held_out_frames.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <vector>

#include "calib/base/statistics.h"
#include "tests/calib/synthetic.h"

namespace plenocal::testing {
namespace TEST_FILE {

constexpr double kNoise = 0.3;  // px
constexpr size_t kFolds = 3;

/// Frames of a rig of two cameras under its true parameters.
class HeldOutFramesOfAPair : public ::testing::Test {
 protected:
  HeldOutFramesOfAPair()
      : problem_(MakeProblem(4, {.cameras = 2, .frames = 9, .noise = kNoise})),
        trained_(TrueBundle(problem_)) {
    size_t frame = 0;
    for (const auto& [name, pose] : problem_.T_rig_target) {
      for (size_t c = 0; c < 2; ++c) {
        std::vector<View>& views = problem_.input.cameras[c].views;
        const auto view = std::ranges::find(views, name, &View::frame);
        if (view == views.end()) continue;
        for (const Observation& seen : view->observations) {
          points_.push_back({.camera = c,
                             .view = static_cast<size_t>(view - views.begin()),
                             .frame = frame,
                             .seen = &seen});
        }
      }
      ++frame;
    }
    outliers_.resize(points_.size());
  }

  [[nodiscard]] std::vector<HeldOutResidual> Predict(size_t fold) const {
    std::vector<HeldOutResidual> residuals(points_.size());
    PredictHeldOut(trained_, {points_, kFolds}, fold, outliers_, &residuals);
    return residuals;
  }

  /// Moves what a camera sees in a frame.
  void Move(size_t camera, size_t frame, double by_px) {
    for (const TrialPoint& point : points_) {
      if (point.camera != camera || point.frame != frame) continue;
      const_cast<Observation*>(point.seen)->values[0] += by_px;  // of `problem_`
    }
  }

  static double Square(const HeldOutResidual& residual) {
    return residual.values[0] * residual.values[0] + residual.values[1] * residual.values[1];
  }
  /// Sum of the squares of a frame.
  [[nodiscard]] double Squares(const std::vector<HeldOutResidual>& residuals, size_t frame) const {
    double squares = 0;
    for (size_t p = 0; p < points_.size(); ++p) {
      if (points_[p].frame == frame && residuals[p].imaged) squares += Square(residuals[p]);
    }
    return squares;
  }

  SyntheticProblem problem_;
  Bundle trained_;
  std::vector<TrialPoint> points_;
  std::vector<bool> outliers_;
};

TEST_F(HeldOutFramesOfAPair, HaveTheResidualsOfTheirNoise) {
  const std::vector<HeldOutResidual> residuals = Predict(1);
  double squares = 0;
  int points = 0;
  for (size_t p = 0; p < points_.size(); ++p) {
    ASSERT_EQ(residuals[p].imaged, points_[p].frame % kFolds == 1) << "frames of the part alone";
    if (!residuals[p].imaged) continue;
    squares += Square(residuals[p]);
    ++points;
  }
  // Six numbers of each of the three frames are fitted.
  const int degrees = 2 * points - 3 * 6;
  ASSERT_GT(degrees, 300);
  const double tail = ChiSquareTail(degrees, squares / (kNoise * kNoise));
  EXPECT_GT(tail, 1e-3);
  EXPECT_LT(tail, 1 - 1e-3);
}

TEST_F(HeldOutFramesOfAPair, HaveOutliersThatDoNotCount) {
  const std::vector<HeldOutResidual> before = Predict(1);
  const auto moved =
      static_cast<size_t>(std::ranges::find(points_, 1U, &TrialPoint::frame) - points_.begin() + 5);
  const_cast<Observation*>(points_[moved].seen)->values[1] += 40;
  outliers_[moved] = true;
  const std::vector<HeldOutResidual> after = Predict(1);
  EXPECT_TRUE(after[moved].imaged);
  EXPECT_NEAR(after[moved].values[1] - before[moved].values[1], 40, 0.3);
  EXPECT_NEAR(
      Squares(after, 1) - Square(after[moved]), Squares(before, 1) - Square(before[moved]), 1);
}

TEST_F(HeldOutFramesOfAPair, HaveNoResidualsWithoutAPose) {
  for (size_t p = 0; p < points_.size(); ++p) {
    outliers_[p] = points_[p].frame == 4 && points_[p].seen->marker >= 3;
  }
  const std::vector<HeldOutResidual> residuals = Predict(1);
  for (size_t p = 0; p < points_.size(); ++p) {
    EXPECT_EQ(residuals[p].imaged, points_[p].frame % kFolds == 1 && points_[p].frame != 4);
  }
  EXPECT_LT(Squares(residuals, 7), 4 * 140 * 2 * kNoise * kNoise) << "the frame after it";
}

TEST_F(HeldOutFramesOfAPair, HaveAPosePerViewWhereTheRigIsNotRigid) {
  Move(1, 4, 5);
  const double rigid = Squares(Predict(1), 4);
  trained_.jitter.translation_sigma = 1e-3;
  trained_.jitter.rotation_sigma = 1e-3;
  trained_.jitter.delta.resize(2 * trained_.T_rig_target.size(), Vector6d::Zero());
  trained_.jitter.misplaced.resize(trained_.jitter.delta.size());
  const double free = Squares(Predict(1), 4);
  EXPECT_GT(rigid, 20 * free);
  EXPECT_LT(free, 4 * 140 * 2 * kNoise * kNoise);
}

}  // namespace TEST_FILE
}  // namespace plenocal::testing
