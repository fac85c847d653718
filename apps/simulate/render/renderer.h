// SPDX-License-Identifier: Apache-2.0
//
// Renderers of ordinary and plenoptic cameras: the light on each pixel of the sensor.
#pragma once

#include <cstdint>
#include <memory>
#include <opencv2/core/mat.hpp>

#include "apps/simulate/render/micro_lens_optics.h"
#include "apps/simulate/render/surface.h"
#include "apps/simulate/spec/simulation_spec.h"

namespace plenocal::simulate {

/// Renders the light on a camera's sensor. One object may be used from several threads.
class Renderer {
 public:
  virtual ~Renderer() = default;
  /// CV_32F; 1: white paper without vignetting. `seed`: of random sampling.
  [[nodiscard]] virtual cv::Mat Render(const Surface& surface, std::uint64_t seed) const = 0;
  /// The image of a uniform white field, CV_32F: the true attenuation image.
  [[nodiscard]] virtual const cv::Mat& White() const = 0;
};

/// Traces the model's rays: 4 x 4 samples a pixel, Gaussian blur, vignetting that grows with the
/// square of the distance from the image's middle.
std::unique_ptr<Renderer> MakeOrdinaryRenderer(const CameraSpec& camera);

/// Traces the rays from points of each pixel through points of each micro lens that pass the main
/// lens' stop; see micro_lens_optics.h. Brightness falls with cos^4 of the angle to the axis.
/// `optics` must outlive the renderer.
std::unique_ptr<Renderer> MakePlenopticRenderer(const CameraSpec& camera,
                                                const MicroLensOptics& optics,
                                                int seed,
                                                int threads);

}  // namespace plenocal::simulate
