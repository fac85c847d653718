// SPDX-License-Identifier: Apache-2.0
#include "detectors/plenoptic/depth/depth_matcher.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <vector>

#include "calib/base/statistics.h"
#include "tests/detectors/plenoptic/depth/wave_scene.h"

namespace plenocal::internal {
namespace TEST_FILE {

// A gap of eight columns and more between textured pixels made a block without rows, which was read
// beyond the end of its patch.
TEST(CoverWindows, HoldsAllWindowsInBlocksThatAreNotEmpty) {
  constexpr int kSize = 48;
  const std::vector<int> pixels{5 * kSize + 6, 20 * kSize + 40, 22 * kSize + 40};
  std::vector<PatchBlock> blocks{{0, 0, 0}};
  CoverWindows(pixels, kSize, &blocks);
  for (const PatchBlock& block : blocks) EXPECT_LT(block.top, block.bottom) << block.column;
  for (const int at : pixels) {
    for (int y = at / kSize - 1; y <= at / kSize + 1; ++y) {
      for (int x = at % kSize - 1; x <= at % kSize + 1; ++x) {
        EXPECT_EQ(std::ranges::count_if(blocks,
                                        [&](const PatchBlock& block) {
                                          return block.column <= x && x < block.column + 8 &&
                                                 block.top <= y && y < block.bottom;
                                        }),
                  1)
            << x << " " << y;
      }
    }
  }
}

TEST(CoverWindows, OfNothingAreNoBlocks) {
  std::vector<PatchBlock> blocks{{0, 1, 2}};
  CoverWindows({}, 48, &blocks);
  EXPECT_TRUE(blocks.empty());
}

// Initial depths at pixels without texture are dropped.
TEST(Select, HasTheTexturedPixelsHoweverTheyAreGiven) {
  const WaveScene scene{
      .v = -3.5, .noise = 0.2, .array = PlenopticScene{.width = 120, .height = 120}.Array()};
  const MicroLensIndex index(scene.array);
  const LensPatches patches = scene.Patches();
  const SensorNoise noise{0.6f, 0};
  const DepthMatcher matcher(patches, index, noise);
  size_t given = 0, textured = 0;
  for (size_t lens = 0; lens < scene.array.lenses.size(); ++lens) {
    MatchScratch by_texture, by_starts;
    matcher.Select(lens, &by_texture);
    const PatchBox box = patches.Inside(lens, 0);
    std::vector<DepthStart> starts;
    for (int y = box.top; y < box.bottom; ++y) {
      for (int x = box.left; x < box.right; ++x) {
        starts.push_back({.at = y * patches.size + x, .z = static_cast<float>(x)});
      }
    }
    matcher.Select(lens, starts, &by_starts);
    EXPECT_EQ(by_starts.pixels.at, by_texture.pixels.at) << lens;
    for (size_t i = 0; i < by_starts.pixels.at.size(); ++i) {
      EXPECT_EQ(by_starts.pixels.z[i], by_starts.pixels.at[i] % patches.size);
    }
    given += starts.size();
    textured += by_starts.pixels.at.size();
  }
  EXPECT_GT(textured, 0U);
  EXPECT_LT(textured, given);
}

// The pixels of a plane, by the search alone: between the steps by the parabola through three of
// them.
TEST(Search, FindsAPlaneToASmallPartOfItsStep) {
  const WaveScene scene{
      .v = -3.5, .noise = 0.2, .array = PlenopticScene{.width = 240, .height = 240}.Array()};
  const MicroLensIndex index(scene.array);
  const LensPatches patches = scene.Patches();
  const SensorNoise noise{0.04f, 0};
  const DepthMatcher matcher(patches, index, noise);
  const float truth = static_cast<float>(1 / scene.v), step = matcher.Step();
  // Steps at any offset from the truth.
  for (const float offset : {0.f, 0.25f, 0.5f, 0.75f}) {
    MatchScratch scratch;
    std::vector<float> errors;
    for (size_t lens = 0; lens < scene.array.lenses.size(); lens += 5) {
      matcher.Select(lens, &scratch);
      matcher.Search(lens, {truth - (4 + offset) * step, truth + 4 * step}, &scratch);
      for (const float z : scratch.pixels.z) errors.push_back((z - truth) / step);
    }
    ASSERT_GT(errors.size(), 500U);
    EXPECT_NEAR(Median(errors), 0, 0.12) << offset;
    for (float& error : errors) error = std::abs(error);
    EXPECT_LT(Median(errors), 0.15) << offset;
  }
}

}  // namespace TEST_FILE
}  // namespace plenocal::internal
