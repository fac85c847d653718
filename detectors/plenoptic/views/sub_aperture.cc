// SPDX-License-Identifier: Apache-2.0
#include "detectors/plenoptic/views/sub_aperture.h"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <limits>
#include <opencv2/imgproc.hpp>
#include <vector>

namespace plenocal::internal {
namespace {

constexpr float kUnknown = std::numeric_limits<float>::quiet_NaN();

/// The value of a micro image at an offset from its centre, linear between pixels; NaN where one of
/// them is unknown.
float ValueAt(const LensPatches& patches, size_t lens, const Eigen::Vector2d& offset) {
  const Eigen::Vector2d at = patches.centre[lens].cast<double>() + offset;
  const int x = static_cast<int>(std::floor(at.x())), y = static_cast<int>(std::floor(at.y()));
  if (x < 0 || y < 0 || x + 1 >= patches.size || y + 1 >= patches.size) return kUnknown;
  const float* const row = patches.Value(lens) + y * patches.size + x;
  const auto u = static_cast<float>(at.x() - x), v = static_cast<float>(at.y() - y);
  return (1 - v) * ((1 - u) * row[0] + u * row[1]) +
         v * ((1 - u) * row[patches.size] + u * row[patches.size + 1]);
}

/// Adds values to places between pixels, and makes means of them.
class SplatImage {
 public:
  SplatImage(const ViewGrid& grid, double sigma)
      : sum_(grid.size, CV_32F, cv::Scalar(0)),
        weight_(grid.size, CV_32F, cv::Scalar(0)),
        step_(grid.step),
        sigma_(std::max(sigma / grid.step, kLeastSigma)) {}

  void Add(const Eigen::Vector2d& raw, float value, float weight) {
    const Eigen::Vector2d at = raw / step_;
    const double reach = kReach * sigma_;
    const int x0 = std::max(0, static_cast<int>(std::ceil(at.x() - reach)));
    const int x1 = std::min(sum_.cols - 1, static_cast<int>(std::floor(at.x() + reach)));
    const int y0 = std::max(0, static_cast<int>(std::ceil(at.y() - reach)));
    const int y1 = std::min(sum_.rows - 1, static_cast<int>(std::floor(at.y() + reach)));
    for (int y = y0; y <= y1; ++y) {
      for (int x = x0; x <= x1; ++x) {
        const double d2 = (Eigen::Vector2d(x, y) - at).squaredNorm();
        const auto share = weight * static_cast<float>(std::exp(-d2 / (2 * sigma_ * sigma_)));
        sum_.at<float>(y, x) += share * value;
        weight_.at<float>(y, x) += share;
      }
    }
  }

  [[nodiscard]] cv::Mat Mean() const {
    // Less than what a pixel gives its neighbour but one comes from nothing near.
    constexpr double kFewest = 1e-3;
    cv::Mat mean = sum_ / weight_;
    mean.setTo(kUnknown, weight_ < kFewest);
    return mean;
  }

 private:
  static constexpr double kLeastSigma = 0.5, kReach = 2;  // pixels; sigmas
  cv::Mat sum_, weight_;
  double step_, sigma_;
};

}  // namespace

ViewGrid MakeViewGrid(ImageSize image_size, double step) {
  return {step,
          {static_cast<int>(std::floor((image_size[0] - 1) / step)) + 1,
           static_cast<int>(std::floor((image_size[1] - 1) / step)) + 1}};
}

cv::Mat SubApertureImage(const LensPatches& patches,
                         const MicroLensIndex& index,
                         const Eigen::Vector2d& offset,
                         const ViewGrid& grid) {
  const MicroLensArray& array = index.Array();
  std::vector<float> values;
  values.reserve(array.lenses.size());
  for (size_t lens = 0; lens < array.lenses.size(); ++lens) {
    values.push_back(ValueAt(patches, lens, offset));
  }
  Eigen::Matrix2d basis;
  basis << array.e_column, array.e_row;
  const Eigen::Matrix2d to_nodes = basis.inverse();
  cv::Mat image(grid.size, CV_32F, cv::Scalar(kUnknown));
  for (int y = 0; y < image.rows; ++y) {
    for (int x = 0; x < image.cols; ++x) {
      const Eigen::Vector2d raw(x * grid.step, y * grid.step);
      const int nearest = index.Nearest(raw);
      if (nearest < 0) continue;
      const Eigen::Vector2d node =
          to_nodes * (raw - array.lenses[static_cast<size_t>(nearest)].centre);
      const Eigen::Vector2d part = node.cwiseAbs().cwiseMin(1);
      double sum = 0, weights = 0;
      for (int corner = 0; corner < 4; ++corner) {
        const bool along = (corner & 1) != 0, across = (corner & 2) != 0;
        const double weight =
            (along ? part.x() : 1 - part.x()) * (across ? part.y() : 1 - part.y());
        const int lens = index.Neighbour(
            nearest, {along ? (node.x() < 0 ? -1 : 1) : 0, across ? (node.y() < 0 ? -1 : 1) : 0});
        if (lens < 0 || std::isnan(values[static_cast<size_t>(lens)])) continue;
        sum += weight * values[static_cast<size_t>(lens)];
        weights += weight;
      }
      if (weights > 0) image.at<float>(y, x) = static_cast<float>(sum / weights);
    }
  }
  return image;
}

cv::Mat RefocusedImage(const LensPatches& patches,
                       const MicroLensArray& array,
                       double virtual_depth,
                       const ViewGrid& grid) {
  // A raw pixel is |v| px wide there. Below 1 the pixels of a micro image leave gaps between the
  // centres, over which its values are spread.
  constexpr double kPixelSigma = 0.35, kGapSigma = 0.4;  // of a width
  const double size = std::abs(virtual_depth);
  SplatImage image(
      grid, std::max(kPixelSigma * size, kGapSigma * array.Pitch() * (1 - std::min(1.0, size))));
  for (size_t lens = 0; lens < array.lenses.size(); ++lens) {
    const Eigen::Vector2d& centre = array.lenses[lens].centre;
    const float* value = patches.Value(lens);
    for (int y = 0; y < patches.size; ++y) {
      for (int x = 0; x < patches.size; ++x, ++value) {
        if (std::isnan(*value)) continue;
        const Eigen::Vector2d raw = (patches.origin[lens] + Eigen::Vector2i(x, y)).cast<double>();
        const float V = patches.Attenuation(lens, x, y);
        image.Add(centre + virtual_depth * (raw - centre), *value, V * V);
      }
    }
  }
  return image.Mean();
}

}  // namespace plenocal::internal
