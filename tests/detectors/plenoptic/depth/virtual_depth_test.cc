// SPDX-License-Identifier: Apache-2.0
#include "detectors/plenoptic/depth/virtual_depth.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>

#include "tests/detectors/plenoptic/plenoptic_scene.h"

namespace plenocal::internal {
namespace TEST_FILE {

constexpr double kScale = 2;
constexpr float kRadius = 8.5;  // px, of a micro image of pitch 18
constexpr float kSigma = 0.003f;
constexpr int kBorder = 35;  // pixels of the map: fewer micro images see a point

/// Estimates of all pixels of all micro images that look at a surface of virtual depth v(q), each
/// with noise of its own.
template <typename Depth>
std::vector<LensDepth> Estimates(const MicroLensArray& array, const Depth& v) {
  std::mt19937 random(3);
  std::normal_distribution<float> noise(0, kSigma);
  std::vector<LensDepth> depths(array.lenses.size());
  for (size_t l = 0; l < array.lenses.size(); ++l) {
    for (int y = -8; y <= 8; ++y) {
      for (int x = -8; x <= 8; ++x) {
        if (x * x + y * y > kRadius * kRadius) continue;
        // The surface that this pixel sees: v at q = c + v x, by iteration from the centre.
        const Eigen::Vector2d c = array.lenses[l].centre;
        double depth = v(c);
        for (int i = 0; i < 5; ++i) depth = v(c + depth * Eigen::Vector2d(x, y));
        depths[l].push_back({static_cast<float>(x),
                             static_cast<float>(y),
                             static_cast<float>(1 / depth) + noise(random),
                             kSigma * kSigma});
      }
    }
  }
  return depths;
}

/// Calls `use` with raw coordinates and the pixel of the map away from the border; returns how many
/// pixels there are.
template <typename Use>
int ForEachInside(const VirtualDepth& depth, const Use& use) {
  int count = 0;
  for (int y = kBorder; y < depth.inverse.rows - kBorder; ++y) {
    for (int x = kBorder; x < depth.inverse.cols - kBorder; ++x) {
      use(Eigen::Vector2d(kScale * x, kScale * y), cv::Point(x, y));
      ++count;
    }
  }
  return count;
}

TEST(FuseDepth, PutsEstimatesWhereTheirPointsAre) {
  const MicroLensArray array = PlenopticScene{}.Array();
  const auto v = [](const Eigen::Vector2d& q) { return 3.5 + 0.002 * q.x() - 0.001 * q.y(); };
  const VirtualDepth depth = FuseDepth(Estimates(array, v), array, kRadius, kScale, 2);
  EXPECT_EQ(depth.inverse.size(), cv::Size(200, 200));
  double squares = 0, signed_errors = 0, pulls = 0;
  int known = 0;
  const int inside = ForEachInside(depth, [&](const Eigen::Vector2d& q, cv::Point at) {
    known += depth.known.at<uchar>(at) != 0 ? 1 : 0;
    const double error = depth.inverse.at<float>(at) - 1 / v(q);
    const double sigma = depth.sigma.at<float>(at);
    ASSERT_GT(sigma, 0);
    signed_errors += error;
    squares += error * error;
    pulls += error * error / (sigma * sigma);
  });
  ASSERT_GT(inside, 10000);
  EXPECT_EQ(known, inside);
  // Noise of z moves the points too, so the mean is not exactly free of it.
  EXPECT_LT(std::abs(signed_errors / inside), kSigma / 20);
  // Some ten micro images see each point.
  EXPECT_LT(std::sqrt(squares / inside), kSigma / 2);
  // Their estimates usually share pixels; here they are independent, so sigma is too large.
  EXPECT_LT(std::sqrt(pulls / inside), 1);
  EXPECT_GT(std::sqrt(pulls / inside), 0.2);
}

TEST(FuseDepth, IgnoresEstimatesThatMostContradict) {
  const MicroLensArray array = PlenopticScene{}.Array();
  std::vector<LensDepth> depths = Estimates(array, [](const Eigen::Vector2d&) { return 3.5; });
  std::mt19937 random(4);
  std::uniform_real_distribution<float> any(0.22f, 0.45f), chance(0, 1);
  for (LensDepth& lens : depths) {
    for (PixelDepth& pixel : lens) {
      if (chance(random) < 0.1f) pixel.z = any(random);
    }
  }
  const VirtualDepth depth = FuseDepth(depths, array, kRadius, kScale, 2);
  int wrong = 0;
  const int inside = ForEachInside(depth, [&](const Eigen::Vector2d&, cv::Point at) {
    wrong += std::abs(depth.inverse.at<float>(at) - 1 / 3.5) > 0.03 ? 1 : 0;
  });
  EXPECT_LT(wrong, 0.03 * inside);
}

TEST(FuseDepth, RemovesSurfacesSmallerThanAWindow) {
  const MicroLensArray array = PlenopticScene{}.Array();
  // A patch of 6 px of the virtual image at another depth, where a window has 5 v = 17.
  const auto v = [](const Eigen::Vector2d& q) {
    return (q - Eigen::Vector2d(200, 200)).lpNorm<Eigen::Infinity>() < 3 ? 6.0 : 3.5;
  };
  const VirtualDepth depth = FuseDepth(Estimates(array, v), array, kRadius, kScale, 2);
  const int inside = ForEachInside(depth, [&](const Eigen::Vector2d&, cv::Point at) {
    EXPECT_GT(depth.inverse.at<float>(at), 0.22) << at;
  });
  EXPECT_GT(inside, 10000);
}

TEST(FuseDepth, KeepsAStepBetweenSurfaces) {
  const MicroLensArray array = PlenopticScene{}.Array();
  const auto v = [](const Eigen::Vector2d& q) { return q.x() < 200 ? 3.0 : 4.5; };
  const VirtualDepth depth = FuseDepth(Estimates(array, v), array, kRadius, kScale, 2);
  int left = 0, right = 0;
  ForEachInside(depth, [&](const Eigen::Vector2d& q, cv::Point at) {
    if (q.x() < 180) {
      EXPECT_NEAR(depth.inverse.at<float>(at), 1 / 3.0, 5 * kSigma);
      ++left;
    }
    if (q.x() > 220) {
      EXPECT_NEAR(depth.inverse.at<float>(at), 1 / 4.5, 5 * kSigma);
      ++right;
    }
  });
  EXPECT_GT(left, 3000);
  EXPECT_GT(right, 3000);
}

}  // namespace TEST_FILE
}  // namespace plenocal::internal
