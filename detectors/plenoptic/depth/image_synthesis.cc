// SPDX-License-Identifier: Apache-2.0
#include "detectors/plenoptic/depth/image_synthesis.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <limits>
#include <span>
#include <vector>

#include "calib/base/parallel.h"
#include "calib/base/robust.h"
#include "calib/kernels/processors.h"
#include "detectors/plenoptic/depth/fill_holes.h"
#include "detectors/templates/lanes.h"

namespace plenocal::internal {
namespace {

constexpr int kRowsPerTask = 16;
/// Least |z|: points of smaller inverse depth are treated as if they had this one, so that their
/// neighbourhood stays finite.
constexpr float kLeastZ = 1e-3f;

/// Eight samples of one point.
struct Samples {
  Lanes value, laplacian, attenuation;
  Lanes blur;    // half the variance of the lens type's blur less that of the sharpest type, px^2
  Lanes square;  // of the distance from the micro-image centre over the radius
  Lanes variance, weight;
};

PLENOCAL_LANES void Weigh(const SensorNoise& noise, Samples* s) {
  const Lanes lost = s->laplacian == s->laplacian ? s->blur * s->laplacian : Lanes{};
  const Lanes light = (s->value > 0 ? s->value : Lanes{}) * s->attenuation;
  s->variance = (noise.read + noise.shot * light) / (s->attenuation * s->attenuation) + lost * lost;
  s->weight = (1 - s->square) / s->variance;
}

/// Weighted mean, then once more with Cauchy weights about it.
PLENOCAL_LANES float Combine(std::span<const Samples> samples) {
  float mean = 0, spread = 0;
  for (int pass = 0; pass < 2; ++pass) {
    Lanes weights{}, sum{}, square{};
    for (const Samples& s : samples) {
      Lanes weight = s.weight;
      if (pass > 0) {
        const Lanes off = s.value - mean;
        const Lanes scale = kCauchyWidthSquared<float> * (s.variance + spread);
        weight *= scale / (scale + off * off);
      }
      weights += weight;
      sum += weight * s.value;
      square += weight * s.value * s.value;
    }
    const float all = Sum(weights);
    mean = Sum(sum) / all;
    spread = std::max(0.f, Sum(square) / all - mean * mean);
  }
  return mean;
}

/// Lattice steps from a micro lens to itself and to those that may see what it sees.
struct StepsInView {
  std::vector<LatticeStep> steps;
  std::vector<float> lengths;  // px, never decreasing

  StepsInView(const LensPatches& patches, const MicroLensArray& array, const ZRange& range)
      : steps{{0, 0}}, lengths{0} {
    // A point of inverse depth z is in view of the micro lenses within radius / |z|, plus half a
    // cell to the nearest of them.
    const float least =
        std::max(std::min(std::abs(range.lowest), std::abs(range.highest)), kLeastZ);
    const double longest = patches.radius_px / least / array.Pitch();
    for (const LatticeStep& step : StepsWithin(array, longest + 1)) {
      const double length = (step.column * array.e_column + step.row * array.e_row).norm();
      steps.push_back(step);
      lengths.push_back(std::max(lengths.back(), static_cast<float>(length)));
    }
  }
};

/// The micro images that see a point of the virtual image, and what they show there.
class Sampler {
 public:
  /// Keeps references to all of them.
  Sampler(const StepsInView& steps,
          const LensPatches& patches,
          const MicroLensIndex& index,
          const SensorNoise& noise,
          const DepthSurvey& survey)
      : steps_(steps),
        patches_(patches),
        index_(index),
        noise_(noise),
        survey_(survey),
        pitch_(static_cast<float>(index.Array().Pitch())) {}

  /// Value of the point q, raw px, of inverse virtual depth z; NaN where no micro image shows it.
  [[nodiscard]] float At(const Eigen::Vector2d& q, float z) {
    const int nearest = index_.Nearest(q);
    if (nearest < 0 || std::isnan(z)) return std::numeric_limits<float>::quiet_NaN();
    // No point is farther from the nearest centre than the corner of a cell.
    const float reach = patches_.radius_px / std::max(std::abs(z), kLeastZ) +
                        pitch_ / std::sqrt(3.f) + MicroLensIndex::kNearestError;
    const auto end = std::upper_bound(steps_.lengths.begin(), steps_.lengths.end(), reach);
    LookAround(nearest, static_cast<size_t>(end - steps_.lengths.begin()));
    return Value((q - index_.Array().lenses[nearest].centre).cast<float>(), z);
  }

 private:
  struct Neighbour {
    const float* value;          // of its patch
    std::ptrdiff_t attenuation;  // of the patch's first value, in the attenuation image
    Eigen::Vector2f centre;      // in the patch
    int type;
  };

  /// Neighbouring points have one nearest micro lens, so its neighbours are kept for the next.
  void LookAround(int nearest, size_t count) {
    const MicroLensArray& array = index_.Array();
    if (nearest != nearest_) {
      nearest_ = nearest;
      looked_at_ = 0;
      x_.clear(), y_.clear(), neighbours_.clear();
    }
    for (; looked_at_ < count; ++looked_at_) {
      const int lens = index_.Neighbour(nearest, steps_.steps[looked_at_]);
      if (lens < 0) continue;
      const Eigen::Vector2d from = array.lenses[lens].centre - array.lenses[nearest].centre;
      x_.push_back(static_cast<float>(from.x()));
      y_.push_back(static_cast<float>(from.y()));
      const Eigen::Vector2i& origin = patches_.origin[lens];
      neighbours_.push_back(
          {patches_.Value(lens),
           static_cast<std::ptrdiff_t>(patches_.attenuation.step1()) * origin.y() + origin.x(),
           patches_.centre[lens],
           array.lenses[lens].type});
    }
  }

  /// `from`: position from the nearest micro-image centre.
  float Value(const Eigen::Vector2f& from, float z);

  const StepsInView& steps_;
  const LensPatches& patches_;
  const MicroLensIndex& index_;
  const SensorNoise& noise_;
  const DepthSurvey& survey_;
  float pitch_;
  int nearest_ = -1;          // of the last point
  size_t looked_at_ = 0;      // steps from it
  std::vector<float> x_, y_;  // neighbours' centres from that of the nearest, px
  std::vector<Neighbour> neighbours_;
  // Working memory
  std::vector<float> u_, v_, square_;
  std::vector<Samples> samples_;
};

PLENOCAL_FOR_EACH_PROCESSOR
float Sampler::Value(const Eigen::Vector2f& from, float z) {
  std::array<float, kMostLensTypes> blurs{};
  float sharpest = std::numeric_limits<float>::infinity();
  for (size_t type = 0; type < survey_.defocus.size(); ++type) {
    blurs[type] = survey_.defocus[type].At(z);
    sharpest = std::min(sharpest, blurs[type]);
  }
  const size_t count = neighbours_.size();
  u_.resize(count), v_.resize(count), square_.resize(count);
  const float from_x = from.x(), from_y = from.y();
  const float scale = 1 / (patches_.radius_px * patches_.radius_px);
  {
    const float* __restrict x = x_.data();
    const float* __restrict y = y_.data();
    float* __restrict u = u_.data();
    float* __restrict v = v_.data();
    float* __restrict square = square_.data();
    for (size_t k = 0; k < count; ++k) {
      u[k] = (from_x - x[k]) * z;
      v[k] = (from_y - y[k]) * z;
      square[k] = (u[k] * u[k] + v[k] * v[k]) * scale;
    }
  }
  const int n = patches_.size;
  const auto* attenuation = patches_.attenuation.ptr<float>();
  const auto row_length = static_cast<std::ptrdiff_t>(patches_.attenuation.step1());
  samples_.resize((count + kLanes - 1) / kLanes);
  int taken = 0;
  for (size_t k = 0; k < count; ++k) {
    if (!(square_[k] < 1)) continue;
    const Neighbour& lens = neighbours_[k];
    const float x = lens.centre.x() + u_[k], y = lens.centre.y() + v_[k];
    const int column = static_cast<int>(x), row = static_cast<int>(y);
    const float fx = x - static_cast<float>(column), fy = y - static_cast<float>(row);
    const float* v = lens.value + row * n + column;
    const float value =
        (1 - fy) * (v[0] + fx * (v[1] - v[0])) + fy * (v[n] + fx * (v[n + 1] - v[n]));
    if (std::isnan(value)) continue;
    // The pixel nearest to (x, y).
    const int right = fx < 0.5f ? 0 : 1, down = fy < 0.5f ? 0 : 1;
    const float* m = v + down * n + right;
    Samples& s = samples_[taken / kLanes];
    const int lane = taken++ % kLanes;
    s.value[lane] = value;
    s.laplacian[lane] = m[-1] + m[1] + m[-n] + m[n] - 4 * m[0];
    s.attenuation[lane] =
        attenuation[lens.attenuation + (row + down) * row_length + column + right];
    s.blur[lane] = blurs[lens.type] - sharpest;
    s.square[lane] = square_[k];
  }
  if (taken == 0) return std::numeric_limits<float>::quiet_NaN();
  const size_t blocks = (taken + kLanes - 1) / kLanes;
  for (; taken % kLanes != 0; ++taken) {  // of weight 0
    Samples& s = samples_[taken / kLanes];
    const int lane = taken % kLanes;
    s.value[lane] = s.laplacian[lane] = s.blur[lane] = 0;
    s.attenuation[lane] = s.square[lane] = 1;
  }
  for (size_t block = 0; block < blocks; ++block) Weigh(noise_, &samples_[block]);
  return Combine({samples_.data(), blocks});
}

}  // namespace

cv::Mat SynthesiseFocusedImage(const VirtualDepth& depth,
                               const LensPatches& patches,
                               const MicroLensIndex& index,
                               const SensorNoise& noise,
                               const DepthSurvey& survey,
                               int threads) {
  const StepsInView steps(patches, index.Array(), survey.range);
  cv::Mat image(depth.inverse.size(), CV_32F);
  ParallelFor((image.rows + kRowsPerTask - 1) / kRowsPerTask, threads, [&](size_t task) {
    Sampler sampler(steps, patches, index, noise, survey);
    const int end = std::min(image.rows, static_cast<int>(task + 1) * kRowsPerTask);
    for (int y = static_cast<int>(task) * kRowsPerTask; y < end; ++y) {
      for (int x = 0; x < image.cols; ++x) {
        const Eigen::Vector2d q(x * depth.scale, y * depth.scale);
        image.at<float>(y, x) = sampler.At(q, depth.inverse.at<float>(y, x));
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
