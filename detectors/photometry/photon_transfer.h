// SPDX-License-Identifier: Apache-2.0
//
// Noise of a sensor from white images: the photon transfer curve, var(I) = read^2 + gain I, as EMVA
// standard 1288 has it, and pixels that do not follow it.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "calib/camera/bayer.h"
#include "calib/files/frame_images.h"

namespace plenocal {

struct WhiteImages;

/// Noise of pixels of one brightness.
struct NoiseLevel {
  double level = 0;     ///< mean grey value
  double variance = 0;  ///< grey values squared
  double sigma = 0;     ///< standard error of `variance`
};

enum class PixelDefect { kBright, kDark, kNoisy };

/// A pixel far from its neighbours, or with far more noise than pixels of its brightness.
struct DefectivePixel {
  int x = 0, y = 0;
  PixelDefect defect = PixelDefect::kBright;
  double excess =
      0;  ///< in standard deviations of good pixels; of a noisy one its noise over theirs
};

struct PhotonTransfer {
  double gain = 0, gain_sigma = 0;  ///< grey values
  double read = 0, read_sigma = 0;  ///< grey values; with the rounding to whole ones
  double saturation = 0;            ///< largest grey value of the images' format
  /// RMS deviation of the levels from the line, relative: small for raw values, large for
  /// processed ones (gamma, JPEG, noise reduction).
  double misfit = 0;
  std::vector<NoiseLevel> levels = {};       ///< ascending
  std::vector<DefectivePixel> defects = {};  ///< by row, then column
};

/// From the differences of the white images that `white` is the mean of, each with brightness and
/// shading of its own. Nothing for a single image or when all pixels are clipped. Throws `Error`
/// where an image cannot be read any more.
std::optional<PhotonTransfer> MeasurePhotonTransfer(const std::vector<FrameImage>& images,
                                                    const WhiteImages& white,
                                                    std::optional<BayerOrder> bayer);

/// The content of noise_<camera>.yaml.
std::string PhotonTransferYaml(const PhotonTransfer& noise);

}  // namespace plenocal
