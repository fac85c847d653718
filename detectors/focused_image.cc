// SPDX-License-Identifier: Apache-2.0
#include "detectors/focused_image.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

#include "calib/parallel.h"
#include "detectors/fill.h"

namespace plenocal::internal {
namespace {

constexpr int kRowsPerTask = 16;
/// Error of MicroLensIndex::Nearest, px.
constexpr float kNearest = 2;

struct Sample {
  float value, variance, weight;
};

/// Weighted mean, then once more with Cauchy weights about it.
float Combine(const std::vector<Sample>& samples) {
  float mean = 0, spread = 0;
  for (int pass = 0; pass < 2; ++pass) {
    float weights = 0, sum = 0, square = 0;
    for (const Sample& s : samples) {
      float weight = s.weight;
      if (pass > 0) {
        const float off = s.value - mean, scale = 2.385f * 2.385f * (s.variance + spread);
        weight *= scale / (scale + off * off);
      }
      weights += weight;
      sum += weight * s.value;
      square += weight * s.value * s.value;
    }
    mean = sum / weights;
    spread = std::max(0.f, square / weights - mean * mean);
  }
  return mean;
}

}  // namespace

cv::Mat SynthesiseFocused(const VirtualDepth& depth,
                          const LensPatches& patches,
                          const MicroLensArray& array,
                          const MicroLensIndex& index,
                          const SensorNoise& noise,
                          const DepthSurvey& survey,
                          int threads) {
  const float nan = std::numeric_limits<float>::quiet_NaN();
  const auto pitch = static_cast<float>(array.Pitch());
  // A point of inverse depth z is in view of the micro lenses within radius / |z|, plus half a cell
  // to the nearest of them.
  const float longest = patches.radius_px /
                        std::max(std::abs(survey.range.lowest) < std::abs(survey.range.highest)
                                     ? std::abs(survey.range.lowest)
                                     : std::abs(survey.range.highest),
                                 1e-3f) /
                        pitch;
  std::vector<LatticeStep> steps = StepsWithin(array, longest + 1);
  std::vector<float> lengths;
  lengths.reserve(steps.size());
  for (const LatticeStep& s : steps) {
    lengths.push_back(static_cast<float>((s.column * array.e_column + s.row * array.e_row).norm()));
  }
  const int n = patches.size;
  cv::Mat image(depth.inverse.size(), CV_32F, cv::Scalar(nan));
  ParallelFor((image.rows + kRowsPerTask - 1) / kRowsPerTask, threads, [&](size_t task) {
    std::vector<Sample> samples;
    std::vector<float> defocus(array.types);
    const int y1 = std::min(image.rows, static_cast<int>(task + 1) * kRowsPerTask);
    for (int y = static_cast<int>(task) * kRowsPerTask; y < y1; ++y) {
      for (int x = 0; x < image.cols; ++x) {
        const float z = depth.inverse.at<float>(y, x);
        const Eigen::Vector2d q(x * depth.scale, y * depth.scale);
        const int nearest = index.Nearest(q);
        if (nearest < 0 || std::isnan(z)) continue;
        for (int t = 0; t < array.types; ++t) {
          defocus[t] = survey.defocus[t][0] + survey.defocus[t][1] * z;
        }
        const float sharpest = *std::min_element(defocus.begin(), defocus.end());
        samples.clear();
        const auto look = [&](int lens) {
          if (lens < 0) return;
          const Eigen::Vector2f from_centre = (q - array.lenses[lens].centre).cast<float>() * z;
          const float square = from_centre.squaredNorm() / (patches.radius_px * patches.radius_px);
          if (square >= 1) return;
          const Eigen::Vector2f p = patches.centre[lens] + from_centre;
          const int column = static_cast<int>(p.x()), row = static_cast<int>(p.y());
          const float fx = p.x() - static_cast<float>(column);
          const float fy = p.y() - static_cast<float>(row);
          const int at = row * n + column;
          const float* v = patches.Value(lens) + at;
          const float value =
              (1 - fy) * (v[0] + fx * (v[1] - v[0])) + fy * (v[n] + fx * (v[n + 1] - v[n]));
          if (std::isnan(value)) return;
          const int middle = (fy < 0.5f ? 0 : n) + (fx < 0.5f ? 0 : 1);
          const float* m = v + middle;
          const float laplacian = m[-1] + m[1] + m[-n] + m[n] - 4 * m[0];
          const float blur = defocus[array.lenses[lens].type] - sharpest;
          const float lost = std::isnan(laplacian) ? 0.f : blur * laplacian;
          const float light =
              patches.Light(lens, column + (fx < 0.5f ? 0 : 1), row + (fy < 0.5f ? 0 : 1));
          const float variance =
              (noise.read + noise.shot * std::max(0.f, value) * light) / (light * light) +
              lost * lost;
          samples.push_back({value, variance, (1 - square) / variance});
        };
        look(nearest);
        // No place is farther from the nearest centre than the corner of a cell.
        const float reach =
            patches.radius_px / std::max(std::abs(z), 1e-3f) + pitch / std::sqrt(3.f) + kNearest;
        for (size_t k = 0; k < steps.size() && lengths[k] <= reach; ++k) {
          look(index.Neighbour(nearest, steps[k]));
        }
        if (!samples.empty()) image.at<float>(y, x) = Combine(samples);
      }
    }
  });
  return FillHoles(image, cv::Mat::zeros(image.size(), CV_32F)).value;
}

}  // namespace plenocal::internal
