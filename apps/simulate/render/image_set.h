// SPDX-License-Identifier: Apache-2.0
//
// Lists the images of a simulated session, and makes and writes them.
#pragma once

#include <filesystem>
#include <functional>
#include <memory>
#include <opencv2/core/mat.hpp>
#include <string>
#include <vector>

#include "apps/simulate/render/observer.h"
#include "apps/simulate/render/renderer.h"
#include "apps/simulate/spec/request.h"
#include "calib/io/output_folder.h"

namespace plenocal::simulate {

using Renderers = std::vector<std::unique_ptr<Renderer>>;

/// The renderers of all cameras.
Renderers MakeRenderers(const SimulationSpec& spec, const Observer& observer, int threads);

/// The seed of random sampling in one image.
std::uint64_t SamplingSeed(const SimulationSpec& spec, std::size_t camera, std::size_t frame);

/// An image to make: its file below the output folder, and what makes its pixels.
struct ImageTask {
  std::string name;
  bool slow = false;
  std::function<cv::Mat()> make;
};

/// The images of one camera: `frames`, with the light that `light` returns, and images of a white
/// field, exposed with the lamp's flicker.
std::vector<ImageTask> ListCameraImages(const SimulationSpec& spec,
                                        std::size_t camera,
                                        const Renderer& renderer,
                                        const std::vector<std::string>& frames,
                                        const std::function<cv::Mat(std::size_t frame)>& light,
                                        int white_images);

/// Makes and writes all images, the slow ones first, so that all threads end at about the same
/// time. Throws `Error` of kind kInput if their folders below `folder` contain another .png, which
/// would become part of the session.
void WriteImages(std::vector<ImageTask> tasks,
                 const std::filesystem::path& folder,
                 int threads,
                 const Progress& progress,
                 OutputFolder* out);

}  // namespace plenocal::simulate
