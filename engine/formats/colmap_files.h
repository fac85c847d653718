// SPDX-License-Identifier: Apache-2.0
//
// Cameras and images of a COLMAP model, as text (.txt) or binary (.bin).
#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include "calib/camera/camera_model.h"

namespace plenocal {

struct ColmapCamera {
  std::uint64_t id = 0;
  std::string model;  ///< COLMAP's name: "OPENCV"
  ImageSize image_size{};
  std::vector<double> params;  ///< in COLMAP's order
  std::string where;           ///< file and place, for messages
};

/// A scene point in an image.
struct ColmapObservation {
  int point = 0;
  double x = 0, y = 0;  ///< px, (0, 0) is the centre of the top-left pixel
};

struct ColmapImage {
  std::string name;  ///< path below the image folder
  std::uint64_t camera = 0;
  std::vector<ColmapObservation> observations;  ///< of points that have a position
  std::string where;                            ///< file and place, for messages
};

/// (0, 0) is the corner of the top-left pixel in COLMAP's files.
inline constexpr double kColmapPixelCentre = 0.5;

/// All members of `cameras.txt` or `cameras.bin`, told by the extension. Throws `Error` of kind
/// kInput with file and place.
std::vector<ColmapCamera> ReadColmapCameras(const std::filesystem::path& file);

/// All members of `images.txt` or `images.bin`. Throws likewise.
std::vector<ColmapImage> ReadColmapImages(const std::filesystem::path& file);

}  // namespace plenocal
