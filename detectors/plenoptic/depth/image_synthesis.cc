// SPDX-License-Identifier: Apache-2.0
#include "detectors/plenoptic/depth/image_synthesis.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

#include "calib/base/parallel.h"
#include "calib/base/robust.h"
#include "detectors/plenoptic/depth/fill_holes.h"

namespace plenocal::internal {
namespace {

constexpr int kRowsPerTask = 16;
/// Least |z|: points of smaller inverse depth are treated as if they had this one, so that their
/// neighbourhood stays finite.
constexpr float kLeastZ = 1e-3f;

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
        const float off = s.value - mean;
        const float scale = kCauchyWidthSquared<float> * (s.variance + spread);
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

/// The micro images that see a point of the virtual image, and what they show there.
class Sampler {
 public:
  Sampler(const LensPatches& patches,
          const MicroLensIndex& index,
          const SensorNoise& noise,
          const DepthSurvey& survey)
      : patches_(patches),
        index_(index),
        noise_(noise),
        survey_(survey),
        pitch_(static_cast<float>(index.Array().Pitch())) {
    const MicroLensArray& array = index.Array();
    // A point of inverse depth z is in view of the micro lenses within radius / |z|, plus half a
    // cell to the nearest of them.
    const float longest = patches.radius_px /
                          std::max(std::abs(survey.range.lowest) < std::abs(survey.range.highest)
                                       ? std::abs(survey.range.lowest)
                                       : std::abs(survey.range.highest),
                                   kLeastZ) /
                          pitch_;
    steps_ = StepsWithin(array, longest + 1);
    lengths_.reserve(steps_.size());
    for (const LatticeStep& s : steps_) {
      lengths_.push_back(
          static_cast<float>((s.column * array.e_column + s.row * array.e_row).norm()));
    }
  }

  /// All samples of the point q, raw px, of inverse virtual depth z. `defocus`: working memory.
  void Collect(const Eigen::Vector2d& q,
               float z,
               std::vector<float>* defocus,
               std::vector<Sample>* samples) const {
    samples->clear();
    const int nearest = index_.Nearest(q);
    if (nearest < 0 || std::isnan(z)) return;
    defocus->clear();
    for (const LinearInZ& of_type : survey_.defocus) defocus->push_back(of_type.At(z));
    const float sharpest = *std::min_element(defocus->begin(), defocus->end());
    for (float& one : *defocus) one -= sharpest;
    AddSample(q, z, nearest, *defocus, samples);
    // No point is farther from the nearest centre than the corner of a cell.
    const float reach = patches_.radius_px / std::max(std::abs(z), kLeastZ) +
                        pitch_ / std::sqrt(3.f) + MicroLensIndex::kNearestError;
    for (size_t k = 0; k < steps_.size() && lengths_[k] <= reach; ++k) {
      const int lens = index_.Neighbour(nearest, steps_[k]);
      if (lens >= 0) AddSample(q, z, lens, *defocus, samples);
    }
  }

 private:
  /// `blurs`: by type, half the variance of the blur less that of the sharpest type, px^2.
  void AddSample(const Eigen::Vector2d& q,
                 float z,
                 int lens,
                 const std::vector<float>& blurs,
                 std::vector<Sample>* samples) const {
    const MicroLens& micro_lens = index_.Array().lenses[lens];
    const int n = patches_.size;
    const Eigen::Vector2f from_centre = (q - micro_lens.centre).cast<float>() * z;
    const float square = from_centre.squaredNorm() / (patches_.radius_px * patches_.radius_px);
    if (square >= 1) return;
    const Eigen::Vector2f p = patches_.centre[lens] + from_centre;
    const int column = static_cast<int>(p.x()), row = static_cast<int>(p.y());
    const float fx = p.x() - static_cast<float>(column);
    const float fy = p.y() - static_cast<float>(row);
    const float* v = patches_.Value(lens) + row * n + column;
    const float value =
        (1 - fy) * (v[0] + fx * (v[1] - v[0])) + fy * (v[n] + fx * (v[n + 1] - v[n]));
    if (std::isnan(value)) return;
    // The pixel nearest to p.
    const int right = fx < 0.5f ? 0 : 1, down = fy < 0.5f ? 0 : 1;
    const float* m = v + down * n + right;
    const float laplacian = m[-1] + m[1] + m[-n] + m[n] - 4 * m[0];
    const float lost = std::isnan(laplacian) ? 0.f : blurs[micro_lens.type] * laplacian;
    const float attenuation = patches_.Attenuation(lens, column + right, row + down);
    const float variance = (noise_.read + noise_.shot * std::max(0.f, value) * attenuation) /
                               (attenuation * attenuation) +
                           lost * lost;
    samples->push_back({value, variance, (1 - square) / variance});
  }

  const LensPatches& patches_;
  const MicroLensIndex& index_;
  const SensorNoise& noise_;
  const DepthSurvey& survey_;
  float pitch_;
  std::vector<LatticeStep> steps_;
  std::vector<float> lengths_;  // px, of `steps_`
};

}  // namespace

cv::Mat SynthesiseFocusedImage(const VirtualDepth& depth,
                               const LensPatches& patches,
                               const MicroLensIndex& index,
                               const SensorNoise& noise,
                               const DepthSurvey& survey,
                               int threads) {
  const Sampler sampler(patches, index, noise, survey);
  cv::Mat image(depth.inverse.size(), CV_32F, cv::Scalar(std::numeric_limits<float>::quiet_NaN()));
  ParallelFor((image.rows + kRowsPerTask - 1) / kRowsPerTask, threads, [&](size_t task) {
    std::vector<Sample> samples;
    std::vector<float> defocus;
    const int end = std::min(image.rows, static_cast<int>(task + 1) * kRowsPerTask);
    for (int y = static_cast<int>(task) * kRowsPerTask; y < end; ++y) {
      for (int x = 0; x < image.cols; ++x) {
        const Eigen::Vector2d q(x * depth.scale, y * depth.scale);
        sampler.Collect(q, depth.inverse.at<float>(y, x), &defocus, &samples);
        if (!samples.empty()) image.at<float>(y, x) = Combine(samples);
      }
    }
  });
  return FillHoles(image, cv::Mat::zeros(image.size(), CV_32F)).value;
}

double ScaleTo8Bits(const cv::Mat& image) {
  constexpr size_t kSaturated = 1000;  // one in so many pixels
  std::vector<float> values(image.begin<float>(), image.end<float>());
  const auto high =
      values.begin() + static_cast<std::ptrdiff_t>(values.size() - 1 - values.size() / kSaturated);
  std::nth_element(values.begin(), high, values.end());
  return *high > 0 ? 255 / *high : 1;
}

}  // namespace plenocal::internal
