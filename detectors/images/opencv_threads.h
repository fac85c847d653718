// SPDX-License-Identifier: Apache-2.0
//
// The number of threads inside OpenCV's functions, which belongs to the whole process.
#pragma once

#include <opencv2/core/utility.hpp>

namespace plenocal {

/// Makes OpenCV work on the calling thread alone. Images run in parallel (`ParallelFor`), with as
/// many threads as the user wants: threads inside OpenCV would only compete with them, and some of
/// its results depend on their number.
inline void UseNoOpenCvThreads() { cv::setNumThreads(1); }

}  // namespace plenocal
