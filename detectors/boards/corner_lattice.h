// SPDX-License-Identifier: Apache-2.0
//
// Search for lattices of chessboard corners of any size.
#pragma once

#include <Eigen/Core>
#include <opencv2/core/mat.hpp>
#include <vector>

namespace plenocal::internal {

/// A rectangular lattice of chessboard corners, before they are measured: good to about a tenth of
/// a square.
struct CornerLattice {
  int columns = 0, rows = 0;  ///< as found: an image does not distinguish them
  /// px, row-major. Where a corner is not seen its place follows from its neighbours.
  std::vector<Eigen::Vector2d> corners;
};

/// Columns and rows exchanged.
CornerLattice Transposed(const CornerLattice& lattice);

/// The lattices in which at least `min_found` corners are seen. The same board may come several
/// times, from several scales, the finest first. A border line of which less than half is seen is
/// no part of the lattice. Takes time with the number of pixels, whatever they show.
std::vector<CornerLattice> FindCornerLattices(const cv::Mat& gray, int min_found);

/// The same without the finest scales of a large image, which take nine tenths of the time; none in
/// an image that is not large.
std::vector<CornerLattice> FindLargeCornerLattices(const cv::Mat& gray, int min_found);

}  // namespace plenocal::internal
