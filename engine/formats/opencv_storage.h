// SPDX-License-Identifier: Apache-2.0
//
// YAML as cv::FileStorage writes it: OpenCV, ORB-SLAM.
#pragma once

#include <filesystem>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "calib/io/yaml.h"
#include "engine/formats/lens_form.h"

namespace plenocal {

/// First lines of such a file.
inline constexpr const char* kOpenCvHead = "%YAML:1.0\n---\n";

/// A matrix; `type` is "d" or "f" for 64 or 32 bits. `data`: row by row.
std::string OpenCvMatrix(
    const std::string& key, int rows, int cols, char type, std::span<const double> data);
/// The 3 x 3 camera matrix.
std::string CameraMatrix(const std::string& key, const Lens& lens);
/// The distortion coefficients as one row.
std::string Coefficients(const std::string& key, const Lens& lens);

YamlNode ReadStorage(const std::filesystem::path& path);

/// The numbers of a matrix, also of a plain list, possibly of rows. `count` 0: any number.
std::vector<double> MatrixData(const YamlNode& node, size_t count);

enum class OpenCvDistortion { kRadtan, kFisheye };
/// A lens from camera matrix and distortion coefficients.
Lens LensOf(const YamlNode& K, const std::optional<YamlNode>& D, OpenCvDistortion distortion);

}  // namespace plenocal
