// SPDX-License-Identifier: Apache-2.0
//
// Sums of outer products, the inner loop of the fits.
#pragma once

#include "detectors/templates/lanes.h"

namespace plenocal::internal {

/// Adds the lower triangle of the sum of j j^T to the size x size matrix `sums`, column by column.
/// The columns j, as many as `count` lanes hold, have `size` values, a multiple of three; the first
/// value of all columns begins at `block`, the next one `stride` lanes later.
void AddSquares(const Lanes* block, int size, int stride, int count, double* sums);
void AddSquares(const DoubleLanes* block, int size, int stride, int count, double* sums);

}  // namespace plenocal::internal
