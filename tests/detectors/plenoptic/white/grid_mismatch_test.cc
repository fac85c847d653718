// SPDX-License-Identifier: Apache-2.0
#include "detectors/plenoptic/white/grid_mismatch.h"

#include <gmock/gmock.h>

#include <Eigen/Geometry>
#include <cmath>
#include <random>

#include "tests/detectors/plenoptic/plenoptic_scene.h"

namespace plenocal::internal {
namespace TEST_FILE {

using ::testing::AllOf;
using ::testing::HasSubstr;

const PlenopticScene kScene{.types = 1};

cv::Mat RawOf(const PlenopticScene& scene, const MicroLensArray& array) {
  cv::Mat raw;
  scene.Raw(array).convertTo(raw, CV_32F, 1 / 256.0);
  return raw;
}

// Turned about the middle of the image, stretched and displaced.
MicroLensArray Moved(MicroLensArray array, double stretch, double turn, const Eigen::Vector2d& by) {
  const Eigen::Vector2d middle(array.image_size[0] / 2.0, array.image_size[1] / 2.0);
  const Eigen::Matrix2d A = stretch * Eigen::Rotation2Dd(turn).toRotationMatrix();
  for (MicroLens& lens : array.lenses) lens.centre = middle + A * (lens.centre - middle) + by;
  array.e_column = A * array.e_column;
  array.e_row = A * array.e_row;
  return array;
}

TEST(GridMismatch, IsNoneForTheImageOfTheGrid) {
  const MicroLensArray array = kScene.Array();
  EXPECT_EQ(GridMismatch(RawOf(kScene, array), kScene.Attenuation(array), array), "");
}

TEST(GridMismatch, OfAnImageWithoutLight) {
  const MicroLensArray array = kScene.Array();
  const cv::Mat black(400, 400, CV_32F, cv::Scalar(0));
  EXPECT_THAT(GridMismatch(black, kScene.Attenuation(array), array), HasSubstr("is black"));
  // Noise of many times the brightness, in few cells.
  MicroLensArray few = array;
  std::erase_if(few.lenses, [](const MicroLens& lens) {
    return (lens.centre - Eigen::Vector2d(200, 200)).norm() > 30;
  });
  cv::Mat dark(400, 400, CV_32F);
  cv::RNG(3).fill(dark, cv::RNG::NORMAL, 0.2, 5);
  EXPECT_THAT(GridMismatch(dark, kScene.Attenuation(array), few),
              AllOf(HasSubstr("does not show micro images where the grid has them (agreement "),
                    HasSubstr("too dark, or not a raw plenoptic image")));
}

TEST(GridMismatch, OfAnotherGrid) {
  const MicroLensArray array = kScene.Array();
  const cv::Mat shifted = RawOf(kScene, Moved(array, 1, 0, {9, 0}));  // half a pitch
  EXPECT_THAT(GridMismatch(shifted, kScene.Attenuation(array), array),
              HasSubstr("of another camera or setting than the white images"));
}

TEST(GridMismatch, OfAPartOfTheImage) {
  const MicroLensArray array = kScene.Array();
  cv::Mat raw = RawOf(kScene, array);
  const cv::Mat shifted = RawOf(kScene, Moved(array, 1, 0, {9, 0}));
  shifted(cv::Rect(0, 0, 133, 133)).copyTo(raw(cv::Rect(0, 0, 133, 133)));
  EXPECT_THAT(GridMismatch(raw, kScene.Attenuation(array), array), HasSubstr("in 1 of 9 parts"));
  shifted(cv::Rect(267, 134, 133, 133)).copyTo(raw(cv::Rect(267, 134, 133, 133)));
  EXPECT_THAT(GridMismatch(raw, kScene.Attenuation(array), array), HasSubstr("in 2 of 9 parts"));
}

// Two cells that show the structure of the white image with 0.3 +- `spread` of its contrast: the
// standard error of their mean is spread / sqrt(2).
std::string OfTwoCells(double spread) {
  MicroLensArray array = kScene.Array();
  array.lenses.resize(2);
  cv::Mat white(400, 400, CV_32F, cv::Scalar(1)), raw = white.clone();
  for (int k = 0; k < 2; ++k) {
    const int cx = 150 + 100 * k;
    array.lenses[k].centre = {cx, 200};
    array.lenses[k].usable = true;
    for (int y = -20; y <= 20; ++y) {
      for (int x = -20; x <= 20; ++x) {
        const double structure = 0.3 * std::sin(x) * std::sin(y);  // its mean is 0
        white.at<float>(200 + y, cx + x) = static_cast<float>(1 + structure);
        raw.at<float>(200 + y, cx + x) =
            static_cast<float>(1 + (0.3 + (2 * k - 1) * spread) * structure);
      }
    }
  }
  return GridMismatch(raw, white, array);
}

// An agreement of 1/2 and less is another grid's where its standard error is below 1/6.
TEST(GridMismatch, HasTheStandardErrorOfTheScatterBetweenCells) {
  EXPECT_THAT(OfTwoCells(0.22),
              AllOf(HasSubstr("(agreement 0.30 +- 0.16, "), HasSubstr("of another camera")));
  EXPECT_THAT(OfTwoCells(0.25),
              AllOf(HasSubstr("(agreement 0.30 +- 0.18, "), HasSubstr("too dark")));
}

TEST(GridMismatch, IsNotKnownForAnImageThatWasCorrected) {
  const MicroLensArray array = kScene.Array();
  const cv::Mat ones(400, 400, CV_32F, cv::Scalar(1));
  EXPECT_EQ(GridMismatch(RawOf(kScene, array), ones, array), "");
}

TEST(MeasureLatticeShift, FindsDisplacementStretchAndTurn) {
  const MicroLensArray array = kScene.Array();
  const double half = Eigen::Vector2d(200, 200).norm();  // from the middle to a corner
  const Eigen::Vector4d expected(0.31, -0.22, 0.0015 * half, -0.001 * half);
  const MicroLensArray moved = Moved(array, 1.0015, -0.001, expected.head<2>());
  double squares = 0;
  constexpr unsigned kSeeds = 6;
  for (unsigned seed = 1; seed <= kSeeds; ++seed) {
    PlenopticScene scene = kScene;
    scene.seed = seed;
    const LatticeShift shift =
        MeasureLatticeShift(RawOf(scene, moved), scene.Attenuation(array), array, {1, 1, 1, 1});
    EXPECT_NEAR(shift.corner, half, 1e-9);
    for (int k = 0; k < 4; ++k) {
      EXPECT_NEAR(shift.value[k], expected[k], 0.05) << k;
      EXPECT_LT(shift.sigma[k], 0.03) << k;
      EXPECT_GT(shift.sigma[k], 0.001) << k;
      squares += std::pow((shift.value[k] - expected[k]) / shift.sigma[k], 2) / (4 * kSeeds);
    }
  }
  // The texture is the same for all seeds: its errors do not average out.
  EXPECT_LT(squares, 9);
}

// As wide as the edges of the micro images.
TEST(MeasureLatticeShift, FindsADisplacementOfSomePixels) {
  const MicroLensArray array = kScene.Array();
  const Eigen::Vector2d expected(1.8, -1.1);
  const LatticeShift shift = MeasureLatticeShift(
      RawOf(kScene, Moved(array, 1, 0, expected)), kScene.Attenuation(array), array, {1, 1, 1, 1});
  EXPECT_LT((shift.value.head<2>() - expected).norm(), 0.05) << shift.value;
  EXPECT_LT(shift.value.tail<2>().norm(), 0.05) << shift.value;
  EXPECT_LT(shift.sigma.maxCoeff(), 0.05);
}

TEST(MeasureLatticeShift, TakesTheColoursOfAMosaicForOne) {
  const MicroLensArray array = kScene.Array();
  cv::Mat raw = RawOf(kScene, Moved(array, 1, 0, {0.3, 0}));
  const std::array<float, 4> gains{0.5F, 1, 0.8F, 0.25F};
  std::array<float, 4> by_place{};
  for (size_t k = 0; k < 4; ++k) by_place[k] = 1 / gains[k];
  cv::Mat mosaic = raw.clone();
  for (int y = 0; y < raw.rows; ++y) {
    for (int x = 0; x < raw.cols; ++x) {
      mosaic.at<float>(y, x) *= gains[static_cast<size_t>(2 * (y % 2) + x % 2)];
    }
  }
  const cv::Mat attenuation = kScene.Attenuation(array);
  const LatticeShift of_grey = MeasureLatticeShift(raw, attenuation, array, {1, 1, 1, 1}),
                     of_mosaic = MeasureLatticeShift(mosaic, attenuation, array, by_place);
  for (int k = 0; k < 4; ++k) EXPECT_NEAR(of_mosaic.value[k], of_grey.value[k], 1e-4) << k;
  EXPECT_NEAR(of_grey.value[0], 0.3, 0.05);
}

TEST(MeasureLatticeShift, IsNoneWithoutMicroImages) {
  const MicroLensArray array = kScene.Array();
  const cv::Mat ones(400, 400, CV_32F, cv::Scalar(1));
  const LatticeShift shift = MeasureLatticeShift(RawOf(kScene, array), ones, array, {1, 1, 1, 1});
  EXPECT_EQ(shift.corner, LatticeShift().corner);
}

}  // namespace TEST_FILE
}  // namespace plenocal::internal
