// SPDX-License-Identifier: Apache-2.0
#include "detectors/templates/square_sums.h"

#include "calib/kernels/processors.h"

namespace plenocal::internal {
namespace {

template <typename SomeLanes>
PLENOCAL_LANES void AddTiles(
    const SomeLanes* block, int size, int stride, int count, double* sums) {
  // As many sums at once as there are registers for.
  constexpr int kTile = 3;
  for (int a = 0; a < size; a += kTile) {
    for (int b = a; b < size; b += kTile) {
      SomeLanes tile[kTile][kTile] = {};
      for (int i = 0; i < count; ++i) {
        for (int c = 0; c < kTile; ++c) {
          for (int r = 0; r < kTile; ++r) {
            tile[c][r] += block[(a + c) * stride + i] * block[(b + r) * stride + i];
          }
        }
      }
      for (int c = 0; c < kTile; ++c) {
        for (int r = 0; r < kTile; ++r) sums[(a + c) * size + b + r] += Sum(tile[c][r]);
      }
    }
  }
}

}  // namespace

PLENOCAL_FOR_EACH_PROCESSOR
void AddSquares(const Lanes* block, int size, int stride, int count, double* sums) {
  AddTiles(block, size, stride, count, sums);
}

PLENOCAL_FOR_EACH_PROCESSOR
void AddSquares(const DoubleLanes* block, int size, int stride, int count, double* sums) {
  AddTiles(block, size, stride, count, sums);
}

}  // namespace plenocal::internal
