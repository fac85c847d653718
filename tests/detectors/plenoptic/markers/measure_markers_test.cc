// SPDX-License-Identifier: Apache-2.0
#include "detectors/plenoptic/markers/measure_markers.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "detectors/plenoptic/depth/lens_patches.h"
#include "tests/detectors/plenoptic/plenoptic_scene.h"

namespace plenocal::internal {
namespace TEST_FILE {

/// Corners of a chessboard with squares of `cell` px in the virtual image, seen through micro
/// lenses without vignetting.
class Chessboard {
 public:
  explicit Chessboard(double cell) : cell_(cell), array_(PlenopticScene{}.Array()) {
    constexpr int kSamples = 8;
    const PlenopticScene scene;
    raw_ = cv::Mat(scene.height, scene.width, CV_32F, cv::Scalar(0));
    for (const MicroLens& lens : array_.lenses) {
      for (int y = 0; y < raw_.rows; ++y) {
        for (int x = 0; x < raw_.cols; ++x) {
          if ((Eigen::Vector2d(x, y) - lens.centre).norm() > scene.pitch / 2) continue;
          double white = 0;
          for (int k = 0; k < kSamples * kSamples; ++k) {
            const int row = k / kSamples, column = k % kSamples;
            // Over two pixels: what the sensor and its point spread do.
            const Eigen::Vector2d sub(2 * (column + 0.5) / kSamples - 1,
                                      2 * (row + 0.5) / kSamples - 1);
            const Eigen::Vector2d in_cells =
                Cells(lens.centre + kDepth * (Eigen::Vector2d(x, y) + sub - lens.centre));
            white += std::fmod(std::floor(in_cells.x()) + std::floor(in_cells.y()) + 100, 2);
          }
          raw_.at<float>(y, x) = static_cast<float>(50 + 100 * white / (kSamples * kSamples));
        }
      }
    }
  }

  /// The corners measured by drawings for a depth that is too large by a relative error, whose
  /// gradient to the right is `slope`, 1 / px; noise of 2 grey values with a `seed` other than 0.
  /// `margin`: as if the board were one tag.
  [[nodiscard]] RawMeasurements Measure(double error,
                                        unsigned seed = 0,
                                        int margin = 0,
                                        double slope = 0) const {
    cv::Mat raw = raw_.clone();
    if (seed != 0) {
      cv::Mat noise(raw.size(), CV_32F);
      cv::RNG(seed).fill(noise, cv::RNG::NORMAL, 0, kNoise);
      raw += noise;
    }
    VirtualDepth depth;
    depth.inverse = cv::Mat(raw_.size(), CV_32F);
    for (int x = 0; x < raw_.cols; ++x) {
      depth.inverse.col(x) = 1 / (kDepth * (1 + error + slope * (x - Middle())));
    }
    depth.sigma = cv::Mat(raw_.size(), CV_32F, cv::Scalar(0.01));
    depth.known = cv::Mat(raw_.size(), CV_8U, cv::Scalar(255));
    std::vector<float> cells;
    cells.reserve(kCells * kCells);
    for (int i = 0; i < kCells * kCells; ++i) {
      cells.push_back((i / kCells + i % kCells) % 2 == 0 ? -1.f : 1.f);
    }
    std::vector<MarkerTemplate> markers;
    for (int row = 6; row <= 13; ++row) {
      for (int column = 6; column <= 13; ++column) {
        Eigen::Matrix3d cells_by_image = Eigen::Matrix3d::Identity() / cell_;
        cells_by_image(2, 2) = 1;
        MarkerTemplate marker{.marker = row * kCells + column,
                              .position = Corner(row * kCells + column),
                              .cells_by_image = cells_by_image,
                              .pattern = CellTemplate(cells, kCells),
                              .margin = margin};
        markers.push_back(marker);
      }
    }
    const cv::Mat even(raw_.size(), CV_32F, cv::Scalar(1));
    return MeasureMarkers(markers,
                          depth,
                          CutPatches(raw, even, array_, std::nullopt, 2),
                          array_,
                          {seed == 0 ? 0.1f : kNoise * kNoise, 0},
                          2);
  }

  [[nodiscard]] double Middle() const { return raw_.cols / 2.0; }
  /// In the virtual image, px.
  [[nodiscard]] Eigen::Vector2d Corner(int marker) const {
    return cell_ * Eigen::Vector2d(marker % kCells, marker / kCells);
  }

 private:
  static constexpr int kCells = 20;
  static constexpr double kDepth = 3.5;
  static constexpr float kNoise = 2;
  [[nodiscard]] Eigen::Vector2d Cells(const Eigen::Vector2d& q) const { return q / cell_; }

  double cell_;
  MicroLensArray array_;
  cv::Mat raw_;
};

/// Keeps the measurements that both have: the depth also selects the micro images.
void KeepCommon(RawMeasurements* a, RawMeasurements* b) {
  const auto lacks = [](const RawMeasurements& view) {
    return [&view](const MarkerMeasurement& o) {
      return std::none_of(view.begin(), view.end(), [&](const MarkerMeasurement& other) {
        return other.observation.marker == o.observation.marker && other.Centre() == o.Centre();
      });
    };
  };
  std::erase_if(*a, lacks(*b));
  std::erase_if(*b, lacks(*a));
}

TEST(MeasureMarkers, HaveTheirSensitivityToAWrongDepth) {
  constexpr double kError = -0.003;
  const Chessboard board(20);
  // Pixels on one side of the micro image only: of boards few are used, on both sides.
  std::vector<RawMeasurements> right{board.Measure(0, 0, 2)}, wrong{board.Measure(kError, 0, 2)};
  KeepCommon(&right[0], &wrong[0]);
  ASSERT_GT(right[0].size(), 150u);
  double moved = 0, unexplained = 0, outward = 0;
  for (size_t i = 0; i < right[0].size(); ++i) {
    const MarkerMeasurement &before = right[0][i], &after = wrong[0][i];
    const Eigen::Vector2d by = after.Position() - before.Position();
    moved += by.squaredNorm();
    unexplained += (by - kError * after.depth_sensitivity).squaredNorm();
    outward += by.dot((before.Position() - before.Centre()).normalized());
  }
  EXPECT_LT(unexplained, 0.05 * moved);
  EXPECT_GT(outward / static_cast<double>(right[0].size()), 0.003);
}

TEST(MeasureMarkers, HaveTheirSensitivityToAWrongGradientOfDepth) {
  constexpr double kSlope = 1e-4;
  const Chessboard board(20);
  std::vector<RawMeasurements> right{board.Measure(0, 0, 2)}, wrong{board.Measure(0, 0, 2, kSlope)};
  KeepCommon(&right[0], &wrong[0]);
  ASSERT_GT(right[0].size(), 150u);
  double by_depth = 0, by_gradient = 0, unexplained = 0;
  for (size_t i = 0; i < right[0].size(); ++i) {
    const MarkerMeasurement &before = right[0][i], &after = wrong[0][i];
    const double off = board.Corner(after.observation.marker).x() - board.Middle();
    const Eigen::Vector2d moved = after.Position() - before.Position();
    const Eigen::Vector2d depth = kSlope * off * after.depth_sensitivity;
    const Eigen::Vector2d gradient = kSlope * after.gradient_sensitivity.col(0);
    by_depth += (moved - gradient).squaredNorm();
    by_gradient += (moved - depth).squaredNorm();
    unexplained += (moved - depth - gradient).squaredNorm();
  }
  EXPECT_LT(unexplained, 0.05 * by_depth);
  EXPECT_LT(unexplained, 0.1 * by_gradient);
}

// Corners of a board are one square apart: the pixels beside one must not count as measurements of
// its neighbours, too.
TEST(MeasureMarkers, ErrorsOfNeighbouringCornersAreNotTheSame) {
  const Chessboard board(30);
  const RawMeasurements exact = board.Measure(0, 0);
  double products = 0, squares = 0, variances = 0, count = 0;
  for (unsigned seed = 1; seed <= 12; ++seed) {
    RawMeasurements clean = exact, noisy = board.Measure(0, seed);
    KeepCommon(&clean, &noisy);
    for (size_t i = 0; i < noisy.size(); ++i) {
      const Eigen::Vector2d error = noisy[i].Position() - clean[i].Position();
      squares += error.squaredNorm();
      variances += 2 * std::pow(noisy[i].observation.detector_sigma, 2);
      count += 2;
      for (size_t k = i + 1; k < noisy.size(); ++k) {
        const int apart = noisy[k].observation.marker - noisy[i].observation.marker;
        if (noisy[k].Centre() != noisy[i].Centre() || (apart != 1 && apart != 20)) continue;
        products += error.dot(noisy[k].Position() - clean[k].Position());
      }
    }
  }
  ASSERT_GT(count, 1000);
  // Each corner has about one such neighbour in its micro image.
  EXPECT_LT(products, 0.1 * squares);
  EXPECT_LT(squares, 1.3 * variances);
  EXPECT_GT(squares, 0.5 * variances);
}

}  // namespace TEST_FILE
}  // namespace plenocal::internal
