// SPDX-License-Identifier: Apache-2.0
#include "detectors/plenoptic/white/micro_lens_grid.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <filesystem>
#include <map>
#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>
#include <string>
#include <vector>

#include "calib/base/error.h"
#include "detectors/images/image.h"
#include "detectors/plenoptic/white/micro_lens_attenuation.h"
#include "tests/detectors/plenoptic/white/white_field.h"
#include "tests/digest.h"
#include "tests/optional_data.h"
#include "tests/refusal.h"

namespace plenocal::testing {
namespace TEST_FILE {

constexpr double kCentreRms = 0.005;  // px, required of the lattice (2D)
constexpr double kBorder = 0.05;  // px: a centre as near to the sensor's edge may be on either side

struct Comparison {
  double rms = 0;
  int missed = 0, invented = 0, wrong_types = 0;
  std::vector<size_t> lens_of_truth;
};

Comparison Compare(const RenderedField& truth,
                   const WhiteField& field,
                   const MicroLensArray& array) {
  Comparison result;
  double sum = 0;
  std::vector<bool> hit(array.lenses.size(), false);
  std::map<int, std::map<int, int>> types;  // true set -> found type -> count
  const auto near_edge = [&](const Eigen::Vector2d& c) {
    return std::min({c.x() + 0.5,
                     c.y() + 0.5,
                     field.size[0] - 0.5 - c.x(),
                     field.size[1] - 0.5 - c.y()}) < kBorder;
  };
  for (const TrueLens& lens : truth.lenses) {
    size_t best = 0;
    for (size_t i = 0; i < array.lenses.size(); ++i) {
      if ((array.lenses[i].centre - lens.centre).norm() <
          (array.lenses[best].centre - lens.centre).norm()) {
        best = i;
      }
    }
    const double error = (array.lenses[best].centre - lens.centre).norm();
    result.lens_of_truth.push_back(best);
    if (error > field.pitch / 4) {
      result.missed += near_edge(lens.centre) ? 0 : 1;
      continue;
    }
    hit[best] = true;
    sum += error * error;
    ++types[field.Type(lens.node)][array.lenses[best].type];
  }
  for (size_t i = 0; i < hit.size(); ++i) {
    if (!hit[i] && !near_edge(array.lenses[i].centre)) ++result.invented;
  }
  for (const auto& [colour, counts] : types) {
    int total = 0, most = 0;
    for (const auto& [type, count] : counts) {
      total += count;
      most = std::max(most, count);
    }
    result.wrong_types += total - most;
  }
  result.rms = std::sqrt(sum / static_cast<double>(truth.lenses.size()));
  return result;
}

class MicroLensGridCases : public ::testing::TestWithParam<WhiteField> {};

TEST_P(MicroLensGridCases, FindsEveryCentreAndType) {
  const WhiteField& field = GetParam();
  const RenderedField truth = Render(field);
  const cv::Mat white = field.bayer ? LevelBayerPlanes(truth.white) : truth.white;
  const MicroLensGrid grid = FindMicroLensGrid(white, 2);
  const Comparison found = Compare(truth, field, grid.array);
  EXPECT_LE(found.rms, kCentreRms);
  EXPECT_EQ(found.missed, 0);
  EXPECT_EQ(found.invented, 0);
  EXPECT_EQ(grid.array.types, field.Types());
  EXPECT_EQ(found.wrong_types, 0);
  EXPECT_NEAR(grid.array.Pitch(), field.pitch * (1 + field.aspect) / 2, 0.01 * field.pitch);
  EXPECT_EQ(grid.array.Lattice(), field.lattice);
  const auto unusable = std::count_if(grid.array.lenses.begin(),
                                      grid.array.lenses.end(),
                                      [](const MicroLens& lens) { return !lens.usable; });
  EXPECT_EQ(static_cast<size_t>(unusable), field.dead.size());
  for (size_t i = 0; i < truth.lenses.size(); ++i) {
    const LatticeNode& node = truth.lenses[i].node;
    if (field.dead.contains({node.column, node.row})) {
      EXPECT_FALSE(grid.array.lenses[found.lens_of_truth[i]].usable);
    }
  }
  RecordProperty("rms", std::to_string(found.rms));
}

INSTANTIATE_TEST_SUITE_P(
    Arrays,
    MicroLensGridCases,
    ::testing::Values(
        WhiteField{.size = {400, 300}, .pitch = 8},
        WhiteField{.size = {400, 300}, .pitch = 8, .rotation_deg = 90, .types = 1},
        WhiteField{.size = {401, 300}, .pitch = 10.5, .types = 1, .distortion = -0.01},
        WhiteField{.size = {500, 400}, .pitch = 14, .rotation_deg = 30},
        WhiteField{.pitch = 20, .rotation_deg = 90},
        WhiteField{.pitch = 20, .rotation_deg = 0, .offset = {0, 0}, .types = 1},
        WhiteField{.pitch = 20, .types = 1},
        WhiteField{.pitch = 20, .rotation_deg = -17, .distortion = 0.01},
        WhiteField{.pitch = 24, .distortion = -0.01},
        WhiteField{.pitch = 23.2, .tilt = 0.01},
        WhiteField{.pitch = 18, .images = 1, .gain_scatter = 0},
        WhiteField{.pitch = 18, .types = 1, .level = 1e7, .gain_scatter = 0},
        WhiteField{.pitch = 20, .dead = {{0, 0}, {5, 3}, {-4, 2}, {-3, 2}, {2, -6}}},
        WhiteField{.pitch = 20, .bayer = true},
        WhiteField{.size = {400, 300}, .pitch = 9, .types = 1, .bayer = true},
        WhiteField{.size = {700, 600}, .pitch = 34.9, .rotation_deg = 12},
        WhiteField{.size = {900, 800}, .pitch = 60, .rotation_deg = -25},
        WhiteField{.size = {900, 800}, .pitch = 60, .types = 1, .distortion = -0.003},
        // Their first places are more than a pixel off.
        WhiteField{.size = {900, 800}, .pitch = 60, .types = 1, .tilt = 0.006},
        WhiteField{.size = {436, 436},
                   .pitch = 15.57,
                   .rotation_deg = 0.3,
                   .types = 1,
                   .lattice = LatticeKind::kRectangular},
        WhiteField{.pitch = 20,
                   .rotation_deg = 31,
                   .types = 1,
                   .distortion = 0.01,
                   .lattice = LatticeKind::kRectangular},
        WhiteField{.pitch = 20,
                   .rotation_deg = -12,
                   .types = 1,
                   .lattice = LatticeKind::kRectangular,
                   .aspect = 1.2},
        WhiteField{.pitch = 22, .types = 4, .lattice = LatticeKind::kRectangular},
        // Bent micro images: 0.01 px RMS, were it not allowed for.
        WhiteField{.size = {480, 480}, .pitch = 24, .types = 1, .distortion = 0.015},
        // The same, where distortion makes overlapping neighbours elliptic.
        WhiteField{.size = {720, 720}, .pitch = 37, .types = 1, .distortion = -0.012, .fill = 1.04},
        // As on a chessboard, rows of two types, and types every fourth row.
        WhiteField{.pattern = LensPattern{.columns = 2, .rows = 1, .shift = 1},
                   .lattice = LatticeKind::kRectangular},
        WhiteField{.pattern = LensPattern{.columns = 1, .rows = 2}},
        WhiteField{.pattern = LensPattern{.columns = 1, .rows = 4}},
        WhiteField{.pattern = LensPattern{.columns = 2, .rows = 2, .shift = 1}},
        // One lens in four, and one in three, of another type.
        WhiteField{.pattern = LensPattern{.columns = 2, .rows = 2}, .type_of_set = {0, 0, 1, 0}},
        WhiteField{.pitch = 26, .type_of_set = {0, 1, 0}}),
    [](const ::testing::TestParamInfo<WhiteField>& test) {
      const WhiteField& f = test.param;
      std::string name = "Case" + std::to_string(test.index) + "Pitch" +
                         std::to_string(static_cast<int>(f.pitch)) + "Types" +
                         std::to_string(f.Types());
      if (f.bayer) name += "Bayer";
      if (f.distortion != 0) name += "Distorted";
      if (f.lattice == LatticeKind::kRectangular) name += "Rectangular";
      return name;
    });

TEST(MicroLensGrid, TurnedAndDarkerImagesGiveTheSameGrid) {
  const WhiteField field{.size = {500, 400}, .pitch = 17.3};
  const cv::Mat white = Render(field).white;
  const MicroLensGrid grid = FindMicroLensGrid(white, 2);
  const MicroLensGrid darker = FindMicroLensGrid(white * 0.5, 2);
  cv::Mat turned_image;
  cv::rotate(white, turned_image, cv::ROTATE_90_CLOCKWISE);
  const MicroLensGrid turned = FindMicroLensGrid(turned_image, 2);
  ASSERT_EQ(grid.array.lenses.size(), darker.array.lenses.size());
  ASSERT_EQ(grid.array.lenses.size(), turned.array.lenses.size());
  // Rounding, and the order of the pixels in sums; a hundredth of the noise.
  constexpr double kSame = 5e-4;
  std::map<std::pair<int, int>, int> pairs;  // types here and turned
  for (size_t i = 0; i < grid.array.lenses.size(); ++i) {
    const MicroLens& lens = grid.array.lenses[i];
    EXPECT_LT((lens.centre - darker.array.lenses[i].centre).norm(), kSame);
    const Eigen::Vector2d expected(white.rows - 1 - lens.centre.y(), lens.centre.x());
    const auto nearest =
        std::min_element(turned.array.lenses.begin(),
                         turned.array.lenses.end(),
                         [&](const MicroLens& a, const MicroLens& b) {
                           return (a.centre - expected).norm() < (b.centre - expected).norm();
                         });
    EXPECT_LT((nearest->centre - expected).norm(), kSame);
    ++pairs[{lens.type, nearest->type}];
  }
  EXPECT_EQ(pairs.size(), 3u);
}

TEST(MicroLensGrid, ResultsOnHardFieldsAreTheSameAsBefore) {
  const std::vector<std::pair<WhiteField, double>> cases{
      {{.size = {260, 200}, .pitch = 7, .level = 400, .images = 2, .gain_scatter = 0.1}, -55.5292},
      {{.size = {320, 240}, .pitch = 23, .distortion = 0.02, .fill = 1.1, .tilt = 0.02}, -62.0222},
      {{.size = {320, 240},
        .pitch = 15,
        .types = 1,
        .images = 1,
        .gain_scatter = 0.05,
        .dead = {{0, 0}, {1, 0}, {2, 0}, {-3, 2}, {4, -2}, {-5, -5}},
        .bayer = true},
       -502.0697},
      {{.size = {300, 300},
        .pitch = 21,
        .pattern = LensPattern{.columns = 2, .rows = 2},
        .fill = 1.04,
        .level = 800,
        .lattice = LatticeKind::kRectangular,
        .aspect = 1.1},
       -945.9875},
      {{.size = {220, 180}, .pitch = 33, .rotation_deg = 25, .tilt = -0.01, .gain_scatter = 0.03},
       -100.8486}};
  for (size_t i = 0; i < cases.size(); ++i) {
    const auto& [field, expected] = cases[i];
    const cv::Mat drawn = Render(field).white;
    const cv::Mat white = field.bayer ? LevelBayerPlanes(drawn) : drawn;
    const MicroLensGrid grid = FindMicroLensGrid(white, 1);
    Digest digest;
    for (const MicroLens& lens : grid.array.lenses) {
      digest.AddAll(lens.centre);
      digest.Add(lens.type + (lens.usable ? 0 : 10));
    }
    for (const double gain : grid.gains) digest.Add(gain / field.level);
    for (const double covariance : grid.array.errors.covariance) digest.Add(1e3 * covariance);
    digest.AddAll(std::array{
        grid.centre_rms, grid.centre_sigma, 1.0 * grid.degree, grid.misfit, grid.gain_spread});
    const cv::Mat attenuation = MicroLensAttenuation(
        drawn, grid, field.bayer ? std::optional(BayerOrder::kRggb) : std::nullopt);
    for (int y = 0; y < attenuation.rows; y += 3) {
      for (int x = 0; x < attenuation.cols; x += 2) digest.Add(attenuation.at<float>(y, x));
    }
    EXPECT_NEAR(digest.Sum(), expected, 2e-3) << i;
  }
}

TEST(MicroLensGrid, RefusesAnImageThatIsNotPlenoptic) {
  cv::Mat noise(400, 500, CV_32F), bars(400, 500, CV_32F);
  cv::theRNG().state = 1;
  cv::randn(noise, 1000, 30);
  for (int y = 0; y < bars.rows; ++y) {
    for (int x = 0; x < bars.cols; ++x) {
      bars.at<float>(y, x) = (x / 25) % 2 == 0 ? 100 : 1000;
    }
  }
  for (const cv::Mat& image : {noise, bars, cv::Mat(400, 500, CV_32F, cv::Scalar(1000))}) {
    EXPECT_THAT(RefusalOf([&] { FindMicroLensGrid(image, 2); }, ErrorKind::kJob),
                ::testing::HasSubstr("no hexagonal or rectangular lattice"));
  }
}

// The array of an unfocused light-field microscope: 100 um by design, before pixels of 6.5 um.
TEST(MicroLensGridRealSet, FindsTheSquareArrayOfAMicroscope) {
  const auto path = OptionalData("scene_real/lfm_guv_square") / "Radiometry_GUVExperim1.tif";
  if (!std::filesystem::exists(path)) GTEST_SKIP() << Absent(path);
  cv::Mat white;
  ReadImage(path).convertTo(white, CV_32F);
  const MicroLensGrid grid = FindMicroLensGrid(white, 2);
  EXPECT_EQ(grid.array.Lattice(), LatticeKind::kRectangular);
  EXPECT_EQ(grid.array.types, 1);
  EXPECT_EQ(grid.array.lenses.size(), 28U * 28);
  EXPECT_NEAR(grid.array.e_column.norm(), 100 / 6.5, 0.05);
  EXPECT_NEAR(grid.array.e_row.norm(), 100 / 6.5, 0.05);
  EXPECT_LT(grid.centre_rms, 0.03);
}

}  // namespace TEST_FILE
}  // namespace plenocal::testing
