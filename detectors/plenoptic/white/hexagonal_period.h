// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <opencv2/core/mat.hpp>
#include <optional>

namespace plenocal::internal {

/// The basis (columns: next in a row, next row; px) of the hexagonal lattice with which the middle
/// of an image repeats itself, from its autocorrelation; nothing when it has none. `flat`: CV_32F,
/// mean near zero, without large-scale shading.
std::optional<Eigen::Matrix2d> FindHexagonalPeriod(const cv::Mat& flat);

}  // namespace plenocal::internal
