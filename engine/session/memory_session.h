// SPDX-License-Identifier: Apache-2.0
//
// Sessions whose images or points are in the memory of the calling program.
#pragma once

#include <cstddef>
#include <string>
#include <vector>

#include "calib/camera/camera_model.h"
#include "calib/files/frame_images.h"
#include "calib/files/session.h"
#include "targets/target.h"

namespace plenocal {

/// Pixels row by row, which must stay until the run ends.
struct PixelView {
  const void* data = nullptr;
  ImageSize size{};         ///< px
  std::size_t stride = 0;   ///< bytes from one row to the next
  int channels = 1;         ///< 1: gray; 3: blue, green, red
  int bytes_per_value = 1;  ///< 1 or 2; of two the machine's order
};

/// Images of named frames.
using MemoryImages = std::vector<std::pair<std::string, PixelView>>;

/// One camera: images, or points measured in them.
struct MemoryCamera {
  std::string name;
  const CameraModel* model = nullptr;  ///< null: to be chosen by `CalibrateSession`
  MemoryImages images = {};
  std::vector<View> views = {};
  ImageSize image_size{};  ///< of points, px
};

/// A session without a file. Throws `Error` of kind kInput, with camera and frame, for views of
/// memory that are none (size, stride, channels, bytes), names that occur twice, and cameras
/// without images and points.
Session SessionInMemory(const std::string& target, const std::vector<MemoryCamera>& cameras);

/// The images of one camera. Throws `Error` likewise.
std::vector<FrameImage> ImagesInMemory(const std::string& camera, const MemoryImages& images);

}  // namespace plenocal
