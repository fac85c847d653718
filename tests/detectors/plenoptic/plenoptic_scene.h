// SPDX-License-Identifier: Apache-2.0
//
// Raw images of a plane through an ideal focused plenoptic camera, with known truth, in any
// geometry of the array.
#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>
#include <optional>
#include <random>
#include <string>
#include <string_view>

#include "calib/camera/bayer.h"
#include "calib/camera/micro_lens_array.h"

namespace plenocal {

struct PlenopticScene {
  int width = 400, height = 400;
  double pitch = 18, rotation = 0.01;  ///< px, rad
  int types = 3;
  /// Virtual depth of the plane at q relative to the middle of the image: depth + slope . q.
  /// Negative: Keplerian.
  double depth = 3.5;
  Eigen::Vector2d slope{0.0006, -0.0004};
  double detail = 24;                    ///< px of the virtual image: mean size of its texture
  double brightness = 150;               ///< of white, grey values
  double read_noise = 0.8, shot = 0.03;  ///< grey values; variance per grey value
  std::optional<BayerOrder> bayer = {};  ///< a mosaic under `Tint`
  bool colour = false;                   ///< three channels (BGR) under `Tint`
  double hue = 0;                        ///< amplitude of what changes of the tint over the image
  /// Sigma of a Gaussian that blurs what reaches the sensor, image and attenuation as one, px: the
  /// micro images are then shifted near their edges (detectors/plenoptic/depth/pixel_depth.h, k =
  /// blur^2).
  double blur = 0;
  unsigned seed = 7;

  [[nodiscard]] double Depth(const Eigen::Vector2d& q) const {
    return depth + slope.dot(q - Eigen::Vector2d(width, height) / 2);
  }
  /// Grey value, 0 to 1: irregular spots with edges 2 px of a micro image wide.
  [[nodiscard]] double Texture(const Eigen::Vector2d& q) const {
    const double k = 2 * std::numbers::pi / (2 * detail);
    double sum = 0;
    for (int i = 0; i < 7; ++i) {
      const double angle = 0.3 + 0.9 * i, frequency = k * (0.6 + 0.13 * i);
      sum += std::sin(frequency * (std::cos(angle) * q.x() + std::sin(angle) * q.y()) + 1.7 * i);
    }
    return 0.15 + 0.75 / (1 + std::exp(-2 * sum));
  }

  /// Factor of a colour (0 blue, 1 green, 2 red) at q: a light that is not white, and bands of
  /// colour across the texture.
  [[nodiscard]] double Tint(int c, const Eigen::Vector2d& q) const {
    constexpr double kLight[] = {0.7, 1, 0.5};
    const double phase = 2 * std::numbers::pi * ((q.x() + q.y()) / 150 + c / 3.0);
    return kLight[c] * (1 + hue * std::sin(phase));
  }

  [[nodiscard]] MicroLensArray Array() const {
    MicroLensArray array;
    array.image_size = {width, height};
    array.types = types;
    const auto turned = [&](double angle) {
      return Eigen::Vector2d(pitch * std::cos(rotation + angle),
                             pitch * std::sin(rotation + angle));
    };
    array.e_column = turned(0);
    array.e_row = turned(std::numbers::pi / 3);
    const int most = static_cast<int>(2 * (width + height) / pitch);
    for (int row = -most; row <= most; ++row) {
      for (int column = -most; column <= most; ++column) {
        const Eigen::Vector2d centre = Eigen::Vector2d(width / 2.0 + 0.3, height / 2.0 - 0.4) +
                                       column * array.e_column + row * array.e_row;
        if (centre.x() < 0 || centre.y() < 0 || centre.x() > width - 1 || centre.y() > height - 1)
          continue;
        const int set = ((column - row) % 3 + 3) % 3;
        array.lenses.push_back(
            {.row = row, .column = column, .centre = centre, .type = types == 3 ? set : 0});
      }
    }
    return array;
  }

  /// Soft discs, CV_32F.
  [[nodiscard]] cv::Mat Attenuation(const MicroLensArray& array) const {
    return Blurred(Discs(array));
  }

  /// CV_16U with 256 steps a grey value of `brightness`, so that rounding does not matter; CV_16UC3
  /// in colour.
  [[nodiscard]] cv::Mat Raw(const MicroLensArray& array) const {
    std::mt19937 random(seed);
    if (!colour) {
      return Channel(array, &random, [&](int x, int y, const Eigen::Vector2d& q) {
        if (!bayer) return 1.0;
        const char letter = BayerColour(*bayer, x, y);
        return Tint(static_cast<int>(std::string_view("BGR").find(letter)), q);
      });
    }
    std::array<cv::Mat, 3> channels;
    for (int c = 0; c < 3; ++c) {
      channels[c] =
          Channel(array, &random, [&](int, int, const Eigen::Vector2d& q) { return Tint(c, q); });
    }
    cv::Mat image;
    cv::merge(channels, image);
    return image;
  }

 private:
  /// `tint(x, y, q)`: factor of what pixel (x, y) gets from q.
  template <typename Tinted>
  [[nodiscard]] cv::Mat Channel(const MicroLensArray& array,
                                std::mt19937* random,
                                const Tinted& tint) const {
    constexpr int kSamples = 3;
    const cv::Mat attenuation = Discs(array);
    cv::Mat raw(height, width, CV_32F, cv::Scalar(0));
    cv::Mat nearest(height, width, CV_32F, cv::Scalar(1e9));
    ForEachPixel(array, [&](int x, int y, const MicroLens& lens) {
      const auto r = static_cast<float>((Eigen::Vector2d(x, y) - lens.centre).norm());
      if (r >= nearest.at<float>(y, x)) return;
      nearest.at<float>(y, x) = r;
      double sum = 0;
      for (int k = 0; k < kSamples * kSamples; ++k) {
        const int row = k / kSamples, column = k % kSamples;
        const Eigen::Vector2d sub((column + 0.5) / kSamples - 0.5, (row + 0.5) / kSamples - 0.5);
        const Eigen::Vector2d from_centre = Eigen::Vector2d(x, y) + sub - lens.centre;
        // v = depth + slope . (q - middle) and q = centre + v * from_centre, solved for v.
        const double v = Depth(lens.centre) / (1 - slope.dot(from_centre));
        const Eigen::Vector2d q = lens.centre + v * from_centre;
        sum += Texture(q) * tint(x, y, q);
      }
      raw.at<float>(y, x) = static_cast<float>(brightness * attenuation.at<float>(y, x) * sum /
                                               (kSamples * kSamples));
    });
    raw = Blurred(raw);
    std::normal_distribution<double> normal;
    cv::Mat image(height, width, CV_16U);
    for (int y = 0; y < height; ++y) {
      for (int x = 0; x < width; ++x) {
        const double value = raw.at<float>(y, x);
        const double noisy =
            value + std::sqrt(read_noise * read_noise + shot * value) * normal(*random);
        image.at<std::uint16_t>(y, x) = cv::saturate_cast<std::uint16_t>(256 * noisy);
      }
    }
    return image;
  }

  [[nodiscard]] cv::Mat Discs(const MicroLensArray& array) const {
    cv::Mat attenuation(height, width, CV_32F, cv::Scalar(0.02));
    ForEachPixel(array, [&](int x, int y, const MicroLens& lens) {
      const double r = (Eigen::Vector2d(x, y) - lens.centre).norm();
      auto& value = attenuation.at<float>(y, x);
      value = std::max(value,
                       static_cast<float>(0.02 + 0.98 / (1 + std::exp((r - 0.47 * pitch) / 0.3))));
    });
    return attenuation;
  }

  [[nodiscard]] cv::Mat Blurred(const cv::Mat& image) const {
    if (blur == 0) return image;
    cv::Mat blurred;
    cv::GaussianBlur(image, blurred, {}, blur);
    return blurred;
  }

  template <typename Use>
  void ForEachPixel(const MicroLensArray& array, const Use& use) const {
    for (const MicroLens& lens : array.lenses) {
      const int x0 = std::max(0, static_cast<int>(lens.centre.x() - pitch * 0.6));
      const int x1 = std::min(width - 1, static_cast<int>(lens.centre.x() + pitch * 0.6) + 1);
      const int y0 = std::max(0, static_cast<int>(lens.centre.y() - pitch * 0.6));
      const int y1 = std::min(height - 1, static_cast<int>(lens.centre.y() + pitch * 0.6) + 1);
      for (int y = y0; y <= y1; ++y) {
        for (int x = x0; x <= x1; ++x) use(x, y, lens);
      }
    }
  }
};

}  // namespace plenocal
