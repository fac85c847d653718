// SPDX-License-Identifier: Apache-2.0
//
// The parts of a simulation's specification that belong to photometric calibration.
#pragma once

#include <Eigen/Core>
#include <array>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "calib/camera/observation.h"
#include "calib/io/yaml.h"
#include "detectors/photometry/response_curve.h"

namespace plenocal::simulate {

/// From light to grey values of 8 bits.
struct ToneSpec {
  ResponseCurve curve;             ///< U, the truth
  ResponseCurve::Borders borders;  ///< light, 0 to 255, between grey values
};

/// Attenuation 1 + a_1 r^2 + a_2 r^4 + a_3 r^6 with r = 1 in the corners of a centred image, or
/// r^2 = sum ((u - centre) / axis)^2 over half of the image's diagonal.
struct VignettingSpec {
  std::array<double, 3> polynomial{-0.2, 0, 0};
  std::optional<Eigen::Vector2d> centre = {};  ///< px; nothing: the image's middle
  Eigen::Vector2d axes{1, 1};                  ///< of the ellipse r = 1 / half of the diagonal

  [[nodiscard]] double At(double x, double y, const ImageSize& size) const;
};

/// The target's plane as a wall with a texture.
struct WallSpec {
  double contrast = 0.25;    ///< of the texture, standard deviation / mean
  double structure = 0.004;  ///< m, finest structure
  double light = 0.3;        ///< part of the light that is lost 1 m from the lamp's foot
  double gloss = 0;          ///< largest reflection of the lamp, 1: white paper
  double shading = 0;  ///< change of the light by the tangent from the camera's axis along the
                       ///< wall's x: it moves with the camera but does not roll with it
  std::optional<double> fold = {};  ///< m, x at which the wall is folded
  double fold_angle = 0.3;          ///< rad
};

/// Exposure times of the images.
struct ExposureSpec {
  double least = 1, largest = 10;  ///< ms
  double nominal = 5;              ///< ms; at it a camera's `exposure` holds
  bool sweep = false;              ///< rising through the range; else random
  bool known = true;               ///< written to times.txt
  double error = 0;          ///< relative standard deviation of the true about the written ones
  std::string late_camera;   ///< its exposure differs in single frames; empty: none
  double late_change = 0.1;  ///< relative
  double late_share = 0.02;  ///< of the frames
};

/// `response`: {gamma: 2.2} or {file: pcalib.txt}. Functions throw `Error` with file, line and key.
ToneSpec ReadToneSpec(const YamlNode& node, const std::filesystem::path& spec);
/// `vignetting`: part of the light lost in the corners, or a map.
VignettingSpec ReadVignettingSpec(const YamlNode& node);
WallSpec ReadWallSpec(const YamlNode& node);
ExposureSpec ReadExposureSpec(const YamlNode& node, const std::vector<std::string>& cameras);

}  // namespace plenocal::simulate
