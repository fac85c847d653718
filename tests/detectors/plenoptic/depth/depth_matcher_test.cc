// SPDX-License-Identifier: Apache-2.0
#include "detectors/plenoptic/depth/depth_matcher.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <vector>

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

}  // namespace TEST_FILE
}  // namespace plenocal::internal
