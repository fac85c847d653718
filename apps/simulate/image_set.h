// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <functional>
#include <mutex>
#include <opencv2/core/mat.hpp>
#include <string>
#include <vector>

#include "apps/simulate/renderer.h"
#include "calib/io/output_folder.h"

namespace plenocal::simulate {

/// An image to make: its file below the output folder, and what makes its pixels.
struct ImageTask {
  std::string name;
  std::function<cv::Mat()> make;
};

/// Throws `Error` of kind kInput if the folders of the images hold another .png, which would become
/// part of the session.
void RefuseOtherImages(const std::vector<ImageTask>& tasks, const std::filesystem::path& out);

/// Makes and writes all images. `progress` is called with the number of those done.
void WriteImages(const std::vector<ImageTask>& tasks,
                 int threads,
                 const std::function<void(std::size_t done, std::size_t total)>& progress,
                 OutputFolder* out);

/// The image of a white field, one of several of a camera; exposed with the lamp's flicker.
cv::Mat TakeWhite(const Renderer& renderer,
                  const CameraSpec& camera,
                  int seed,
                  std::size_t camera_index,
                  std::size_t index);

}  // namespace plenocal::simulate
