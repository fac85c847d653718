// SPDX-License-Identifier: Apache-2.0
//
// Maps and attenuations as files that other programs read.
#pragma once

#include <filesystem>
#include <map>
#include <opencv2/core/mat.hpp>
#include <string>
#include <vector>

#include "engine/resample/pixel_map.h"

namespace plenocal {

/// Files for cv::remap: with an empty `format` map_x.tiff and map_y.tiff, 32-bit floats, and
/// mask.png, 255 where there is a source; with "yml" or "xml" one FileStorage under the empty name
/// that holds map_x, map_y, camera_matrix of the view and the sizes.
std::map<std::string, std::string> MapFiles(const PixelMap& map,
                                            const std::vector<double>& pinhole,
                                            const std::string& format);

/// An attenuation (CV_32F) as PNG of 16 bits whose largest value is 65535, as DSO reads it.
std::string VignettePng(const cv::Mat& attenuation);
/// The same of a TIFF.
std::string VignettePng(const std::filesystem::path& attenuation);

}  // namespace plenocal
