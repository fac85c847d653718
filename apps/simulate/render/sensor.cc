// SPDX-License-Identifier: Apache-2.0
#include "apps/simulate/render/sensor.h"

#include <algorithm>
#include <cmath>

namespace plenocal::simulate {

std::vector<float> PixelQuantiles(int count, double blur) {
  // The distribution of box + Gaussian, tabulated; its values there are exact.
  constexpr int kSteps = 4000;
  const double reach = 0.5 + 6 * blur;
  const auto integral = [&](double x) {  // of the Gaussian's distribution function
    if (blur <= 0) return std::max(x, 0.0);
    const double z = x / blur;
    return x * 0.5 * std::erfc(-z / std::sqrt(2.0)) +
           blur * std::exp(-z * z / 2) / std::sqrt(2 * M_PI);
  };
  const auto distribution = [&](double x) { return integral(x + 0.5) - integral(x - 0.5); };
  std::vector<float> quantiles;
  double last_x = -reach, last = distribution(-reach);
  for (int i = 1; i <= kSteps && static_cast<int>(quantiles.size()) < count; ++i) {
    const double x = -reach + 2 * reach * i / kSteps, value = distribution(x);
    while (static_cast<int>(quantiles.size()) < count) {
      const double goal = (static_cast<double>(quantiles.size()) + 0.5) / count;
      if (value < goal) break;
      quantiles.push_back(
          static_cast<float>(last_x + (x - last_x) * (goal - last) / (value - last)));
    }
    last_x = x, last = value;
  }
  return quantiles;
}

cv::Mat Expose(const cv::Mat& light, const SensorSpec& sensor, Random* random) {
  // Transmission of the colour filters for the light of a lamp.
  constexpr double kRed = 0.6, kGreen = 1, kBlue = 0.7;
  const auto filter = [&](int x, int y) {
    if (!sensor.bayer) return 1.0;
    const char colour = BayerColour(*sensor.bayer, x, y);
    return colour == 'R' ? kRed : colour == 'G' ? kGreen : kBlue;
  };
  const double largest = (1 << sensor.bits) - 1;
  const auto gray_of = [&](double level) {  // level 1: a full pixel
    if (!sensor.response) return std::clamp(std::round(level * largest), 0.0, largest);
    const ResponseCurve::Borders& borders = sensor.response->borders;
    return static_cast<double>(std::ranges::upper_bound(borders, level * largest) -
                               borders.begin());
  };
  cv::Mat image(light.size(), sensor.bits == 8 ? CV_8U : CV_16U);
  for (int y = 0; y < light.rows; ++y) {
    for (int x = 0; x < light.cols; ++x) {
      const double electrons =
          sensor.full_well * sensor.exposure * filter(x, y) * light.at<float>(y, x);
      const double noise = std::sqrt(electrons + sensor.read_noise * sensor.read_noise);
      // Counted electrons have the third moment that Gaussian noise lacks (Cornish and Fisher
      // 1938).
      const double skewness = noise > 0 ? electrons / (noise * noise * noise) : 0;
      const double z = random->Gaussian(1);
      const double counted = electrons + noise * (z + skewness / 6 * (z * z - 1));
      const double gray = gray_of(counted / sensor.full_well);
      if (sensor.bits == 8) {
        image.at<std::uint8_t>(y, x) = static_cast<std::uint8_t>(gray);
      } else {
        image.at<std::uint16_t>(y, x) = static_cast<std::uint16_t>(gray);
      }
    }
  }
  return image;
}

}  // namespace plenocal::simulate
