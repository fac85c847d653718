// SPDX-License-Identifier: Apache-2.0
//
// Response of a sensor with grey values of 8 bits: I = G(light), U = G^-1. J. Engel, V. Usenko,
// D. Cremers, "A Photometrically Calibrated Benchmark For Monocular Visual Odometry", 2016.
#pragma once

#include <array>
#include <cstddef>
#include <filesystem>
#include <opencv2/core/mat.hpp>
#include <string>

namespace plenocal {

/// U: light by grey value, in units in which grey value 255 is light 255 and 0 is none.
class ResponseCurve {
 public:
  static constexpr std::size_t kValues = 256;
  using Table = std::array<double, kValues>;
  /// Light at the 255 borders between grey values: k + 1/2.
  using Borders = std::array<double, kValues - 1>;

  /// Grey values that are proportional to the light.
  ResponseCurve();
  /// REQUIRES: `light` rises strictly. It is scaled to the range 0 to 255.
  explicit ResponseCurve(const Table& light);

  [[nodiscard]] double Light(std::size_t grey) const { return light_[grey]; }
  [[nodiscard]] const Table& Values() const { return light_; }
  /// dU/dI at a grey value: light per grey value.
  [[nodiscard]] double Slope(std::size_t grey) const;
  /// Cubic interpolation between the values.
  [[nodiscard]] Borders MakeBorders() const;

 private:
  Table light_;
};

/// Reads pcalib.txt, as DSO and the TUM monocular benchmark have it: 256 numbers that rise
/// strictly. Throws `Error` of kind kInput that names the file and what is wrong.
ResponseCurve ReadResponse(const std::filesystem::path& path);
/// The content of pcalib.txt.
std::string PcalibText(const ResponseCurve& response);

/// The light of an image (CV_8U, any number of channels), CV_32F from 0 to 255.
cv::Mat LightOf(const cv::Mat& image, const ResponseCurve& response);

}  // namespace plenocal
