// SPDX-License-Identifier: Apache-2.0
#include "detectors/plenoptic/markers/measure_markers.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "detectors/plenoptic/depth/lens_patches.h"
#include "tests/detectors/plenoptic/plenoptic_scene.h"

namespace plenocal::internal {
namespace TEST_FILE {

/// Corners of a chessboard, seen through micro lenses without vignetting and without noise.
class Chessboard {
 public:
  Chessboard() : array_(PlenopticScene{}.Array()) {
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

  /// The corners measured by drawings for a depth that is too large by a relative error.
  [[nodiscard]] RawMeasurements Measure(double error) const {
    constexpr int kCells = 20;
    VirtualDepth depth;
    depth.inverse = cv::Mat(raw_.size(), CV_32F, cv::Scalar(1 / (kDepth * (1 + error))));
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
        Eigen::Matrix3d cells_by_image = Eigen::Matrix3d::Identity() / kCell;
        cells_by_image(2, 2) = 1;
        MarkerTemplate marker{.marker = row * kCells + column,
                              .position = kCell * Eigen::Vector2d(column, row),
                              .cells_by_image = cells_by_image,
                              .pattern = CellDrawing(cells, kCells)};
        markers.push_back(marker);
      }
    }
    const cv::Mat even(raw_.size(), CV_32F, cv::Scalar(1));
    return MeasureMarkers(
        markers, depth, CutPatches(raw_, even, array_, std::nullopt, 2), array_, {0.1f, 0}, 2);
  }

 private:
  static constexpr double kDepth = 3.5, kCell = 20;  ///< px of the virtual image
  static Eigen::Vector2d Cells(const Eigen::Vector2d& q) { return q / kCell; }

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
  const Chessboard board;
  std::vector<RawMeasurements> right{board.Measure(0)}, wrong{board.Measure(kError)};
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

}  // namespace TEST_FILE
}  // namespace plenocal::internal
