// SPDX-License-Identifier: Apache-2.0
#include "detectors/plenoptic/depth/pixel_depth.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <string>
#include <vector>

#include "calib/base/statistics.h"
#include "detectors/plenoptic/depth/depth_survey.h"
#include "tests/detectors/plenoptic/depth/wave_scene.h"
#include "tests/digest.h"

namespace plenocal::internal {
namespace TEST_FILE {

constexpr int kThreads = 2;

SensorNoise NoiseOf(const WaveScene& scene) {
  return {static_cast<float>(scene.noise * scene.noise), 0};
}

struct Matched {
  DepthSurvey survey;
  std::vector<LensDepth> depths;

  explicit Matched(const WaveScene& scene) {
    const MicroLensIndex index(scene.array);
    LensPatches patches = scene.Patches();
    survey = SurveyDepth(patches, index, NoiseOf(scene), kThreads);
    depths = MatchMicroImages(index, NoiseOf(scene), survey, kThreads, &patches);
  }
  [[nodiscard]] size_t Count() const {
    size_t count = 0;
    for (const LensDepth& lens : depths) count += lens.size();
    return count;
  }
};

class PlaneAt : public ::testing::TestWithParam<double> {};

TEST_P(PlaneAt, HasTheDepthOfItsPixels) {
  const WaveScene scene{.v = GetParam()};
  const Matched matched(scene);
  ASSERT_GT(matched.Count(), 20000u);
  std::vector<float> relative, pulls;
  const auto truth = static_cast<float>(1 / scene.v);
  for (const LensDepth& lens : matched.depths) {
    for (const PixelDepth& pixel : lens) {
      relative.push_back(pixel.z / truth - 1);
      pulls.push_back(std::abs(pixel.z - truth) / std::sqrt(pixel.variance));
    }
  }
  const float bias = Median(relative);
  for (float& one : relative) one = std::abs(one);
  std::sort(pulls.begin(), pulls.end());
  RecordProperty("bias", std::to_string(bias));
  RecordProperty("median_error", std::to_string(Median(relative)));
  RecordProperty("pull_95", std::to_string(pulls[pulls.size() * 95 / 100]));
  EXPECT_LT(std::abs(bias), 0.001);
  EXPECT_LT(Median(relative), 0.005);
  // The variance is that of a single pixel, not of the window's mean; so it is not too small.
  EXPECT_LT(pulls[pulls.size() * 95 / 100], 2.5);
}

TEST_P(PlaneAt, DecidesTheSignOfDepth) {
  const WaveScene scene{.v = GetParam()};
  const Matched matched(scene);
  const auto truth = static_cast<float>(1 / scene.v);
  EXPECT_EQ(matched.survey.range.highest < 0, scene.v < 0);
  EXPECT_LT(matched.survey.likely.lowest, truth);
  EXPECT_GT(matched.survey.likely.highest, truth);
  // A plane needs a fraction of the whole range.
  EXPECT_LT(matched.survey.likely.highest - matched.survey.likely.lowest,
            0.5F * (matched.survey.range.highest - matched.survey.range.lowest));
}

INSTANTIATE_TEST_SUITE_P(Depths,
                         PlaneAt,
                         ::testing::Values(2.6, 3.5, 5.0, 17.0, -3.5),
                         [](const auto& test) {
                           std::string name = test.param < 0 ? "Keplerian" : "Galilean";
                           name += std::to_string(static_cast<int>(10 * std::abs(test.param)));
                           return name;
                         });

TEST(SurveyDepth, FindsTheDefocusOfALensType) {
  constexpr double kBlur = 0.8;
  WaveScene scene;
  scene.blur = {0, kBlur, 0};
  const Matched matched(scene);
  const auto z = static_cast<float>(1 / scene.v);
  const auto& defocus = matched.survey.defocus;
  ASSERT_EQ(defocus.size(), 3u);
  // Half the variance of the blur; a tenth of it is what the first order in the blur leaves.
  EXPECT_NEAR(defocus[1].At(z) - defocus[0].At(z), kBlur * kBlur / 2, 0.1 * kBlur * kBlur / 2);
  EXPECT_NEAR(defocus[2].At(z) - defocus[0].At(z), 0, 0.02);
}

// A lens type is in focus at one depth and not at the other.
TEST(SurveyDepth, FindsDefocusThatChangesWithDepth) {
  constexpr double kBlur = 0.8;
  WaveScene scene{.v = 2.6, .right_v = 5};
  scene.blur = {0, kBlur, 0};
  scene.right_blur = {0, 0, kBlur};
  const Matched matched(scene);
  const auto& defocus = matched.survey.defocus;
  ASSERT_EQ(defocus.size(), 3u);
  const auto beyond_first = [&](size_t type, double v) {
    const auto z = static_cast<float>(1 / v);
    return defocus[type].At(z) - defocus[0].At(z);
  };
  constexpr double kHalf = kBlur * kBlur / 2;
  EXPECT_NEAR(beyond_first(1, scene.v), kHalf, 0.15 * kHalf);
  EXPECT_NEAR(beyond_first(1, *scene.right_v), 0, 0.15 * kHalf);
  EXPECT_NEAR(beyond_first(2, scene.v), 0, 0.15 * kHalf);
  EXPECT_NEAR(beyond_first(2, *scene.right_v), kHalf, 0.15 * kHalf);
}

TEST(SurveyDepth, IsTheSameToTheLastBitForAnyNumberOfThreads) {
  const WaveScene scene;
  const MicroLensIndex index(scene.array);
  const LensPatches patches = scene.Patches();
  const auto numbers = [&](int threads) {
    const DepthSurvey survey = SurveyDepth(patches, index, NoiseOf(scene), threads);
    std::vector<float> all{survey.likely.lowest, survey.likely.highest};
    for (const auto* properties : {&survey.defocus, &survey.vignetting}) {
      for (const LinearInZ& one : *properties) {
        all.push_back(one.offset);
        all.push_back(one.slope);
      }
    }
    all.insert(all.end(), survey.misfit.begin(), survey.misfit.end());
    return all;
  };
  const std::vector<float> alone = numbers(1);
  constexpr int kRuns = 10;  // threads end in another order each time
  for (int run = 0; run < kRuns; ++run) {
    EXPECT_EQ(numbers(2), alone);
    EXPECT_EQ(numbers(5), alone);
  }
}

TEST(SurveyDepth, ResultsOnHardScenesAreTheSameAsBefore) {
  std::vector<WaveScene> scenes(3);
  scenes[0].v = 6.5;
  scenes[0].noise = 3;
  scenes[1].v = -2.4;
  scenes[1].blur = {0.9, 0, 0.4};
  scenes[2].v = 2.6;
  scenes[2].right_v = 7;
  scenes[2].amplitude = 4;
  scenes[2].right_blur = {0, 0.7, 0};
  const std::vector<double> expected{169.969, 548.783, -327.420};
  for (size_t i = 0; i < scenes.size(); ++i) {
    const Matched matched(scenes[i]);
    const DepthSurvey& survey = matched.survey;
    testing::Digest digest;
    digest.AddAll(std::vector{
        survey.range.lowest, survey.range.highest, survey.likely.lowest, survey.likely.highest});
    for (const auto& of_types : {survey.defocus, survey.vignetting}) {
      for (const LinearInZ& k : of_types) digest.AddAll(std::vector{k.offset, k.slope});
    }
    for (const float variance : survey.misfit) digest.Add(variance);
    for (const LensDepth& lens : matched.depths) {
      for (const PixelDepth& pixel : lens) {
        digest.AddAll(std::vector{pixel.x, pixel.y, pixel.z, 100 * std::sqrt(pixel.variance)});
      }
    }
    EXPECT_NEAR(digest.Sum(), expected[i], 1e-2) << i << ": " << matched.Count();
  }
}

TEST(SurveyDepth, FindsNoVignettingWithoutAttenuation) {
  const Matched matched{WaveScene{}};
  for (const LinearInZ& k : matched.survey.vignetting) {
    EXPECT_EQ(k.offset, 0);
    EXPECT_EQ(k.slope, 0);
  }
}

TEST(MatchMicroImages, HasNoDepthWhereThereIsNoTexture) {
  const WaveScene scene{.amplitude = 0};
  const Matched matched(scene);
  EXPECT_LT(matched.Count(), 20u);
}

TEST(MatchMicroImages, LeavesUnusableMicroLensesOut) {
  WaveScene scene;
  for (size_t i = 0; i < scene.array.lenses.size(); i += 7) scene.array.lenses[i].usable = false;
  const Matched matched(scene);
  size_t others = 0;
  for (size_t i = 0; i < scene.array.lenses.size(); ++i) {
    if (i % 7 == 0) {
      EXPECT_TRUE(matched.depths[i].empty()) << i;
    } else {
      others += matched.depths[i].size();
    }
  }
  EXPECT_GT(others, 15000u);
}

}  // namespace TEST_FILE
}  // namespace plenocal::internal
