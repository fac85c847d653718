// SPDX-License-Identifier: Apache-2.0
//
// Search for the lattice vectors of micro images.
#pragma once

#include <Eigen/Core>
#include <opencv2/core/mat.hpp>
#include <optional>

namespace plenocal::internal {

/// The basis (columns: next in a row, next row; px) of the hexagonal or rectangular lattice that is
/// the period of the middle of an image, by its autocorrelation; nothing when there is none.
/// `flat`: CV_32F, mean near zero, without large-scale shading.
std::optional<Eigen::Matrix2d> FindLatticePeriod(const cv::Mat& flat);

}  // namespace plenocal::internal
