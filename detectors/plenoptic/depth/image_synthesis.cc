// SPDX-License-Identifier: Apache-2.0
#include "detectors/plenoptic/depth/image_synthesis.h"

#include <algorithm>
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

/// What one micro image shows of eight points; weight 0 where it does not.
struct Samples {
  Lanes value, variance, weight;
};

/// Weighted means, then once more with Cauchy weights about them; NaN without any weight.
PLENOCAL_LANES void Combine(std::span<const Samples> samples, Lanes* mean) {
  Lanes spread{};
  for (int pass = 0; pass < 2; ++pass) {
    Lanes weights{}, sum{}, square{};
    for (const Samples& s : samples) {
      Lanes weight = s.weight;
      if (pass > 0) {
        const Lanes off = s.value - *mean;
        const Lanes scale = kCauchyWidthSquared<float> * (s.variance + spread);
        weight *= scale / (scale + off * off);
      }
      weights += weight;
      sum += weight * s.value;
      square += weight * s.value * s.value;
    }
    *mean = sum / weights;
    spread = square / weights - *mean * *mean;
    spread = spread > 0 ? spread : Lanes{};
  }
}

/// Lattice steps from a micro lens to itself and to those that may see points near it.
struct StepsInView {
  std::vector<LatticeStep> steps;
  std::vector<float> lengths;  // px, never decreasing

  /// `beyond`: distance of the points from the micro lens' cell, px.
  StepsInView(const LensPatches& patches,
              const MicroLensArray& array,
              const ZRange& range,
              double beyond)
      : steps{{0, 0}}, lengths{0} {
    // A point of inverse depth z is in view of the micro lenses within radius / |z|, plus half a
    // cell to the nearest of them.
    const float least =
        std::max(std::min(std::abs(range.lowest), std::abs(range.highest)), kLeastZ);
    const double longest = (patches.radius_px / least + beyond) / array.Pitch();
    for (const LatticeStep& step : StepsWithin(array, longest + 1)) {
      const double length = (step.column * array.e_column + step.row * array.e_row).norm();
      steps.push_back(step);
      lengths.push_back(std::max(lengths.back(), static_cast<float>(length)));
    }
  }
};

/// The micro images that see points of the virtual image, and what they show there.
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

  /// Sets the values of eight points, the first at `first`, raw px, and the others `step` px apart
  /// in its row, from their inverse virtual depths; NaN where no micro image shows them.
  void Sample(const Eigen::Vector2d& first, double step, const Lanes& depths, Lanes* values) {
    Lanes z = depths;
    int middle = -1, nearest = -1;  // a point near the middle, and the micro lens nearest to it
    float least = std::numeric_limits<float>::infinity();
    for (int l = 0; l < kLanes; ++l) {
      const int lens = index_.Nearest({first.x() + l * step, first.y()});
      if (lens < 0) z[l] = std::numeric_limits<float>::quiet_NaN();
      if (std::isnan(z[l])) continue;
      if (middle < 0 || l <= kLanes / 2) middle = l, nearest = lens;
      least = std::min(least, std::abs(z[l]));
    }
    if (middle < 0) {
      *values = Lanes{} + std::numeric_limits<float>::quiet_NaN();
      return;
    }
    // No point is farther from the nearest centre than the corner of a cell.
    const float reach = patches_.radius_px / std::max(least, kLeastZ) + pitch_ / std::sqrt(3.f) +
                        MicroLensIndex::kNearestError +
                        static_cast<float>(step) * std::max(middle, kLanes - 1 - middle);
    const auto end = std::upper_bound(steps_.lengths.begin(), steps_.lengths.end(), reach);
    LookAround(nearest, static_cast<size_t>(end - steps_.lengths.begin()));
    const Eigen::Vector2f from = (first - index_.Array().lenses[nearest].centre).cast<float>();
    CombineAround(from, static_cast<float>(step), z, values);
  }

 private:
  struct Neighbour {
    const float* value;      // of its patch
    Eigen::Vector2i origin;  // of the patch
    Eigen::Vector2f centre;  // in the patch
    Eigen::Vector2f from;    // the nearest micro-image centre to its own, px
    int type;
  };

  /// Points beside each other have one nearest micro lens, so its neighbours are kept for the next.
  void LookAround(int nearest, size_t count) {
    const MicroLensArray& array = index_.Array();
    if (nearest != nearest_) {
      nearest_ = nearest;
      looked_at_ = 0;
      neighbours_.clear();
    }
    for (; looked_at_ < count; ++looked_at_) {
      const int lens = index_.Neighbour(nearest, steps_.steps[looked_at_]);
      if (lens < 0) continue;
      const Eigen::Vector2d from = array.lenses[lens].centre - array.lenses[nearest].centre;
      neighbours_.push_back({patches_.Value(lens),
                             patches_.origin[lens],
                             patches_.centre[lens],
                             from.cast<float>(),
                             array.lenses[lens].type});
    }
  }

  /// `from`: position of the first point from the nearest micro-image centre.
  void CombineAround(const Eigen::Vector2f& from, float step, const Lanes& z, Lanes* values);

  const StepsInView& steps_;
  const LensPatches& patches_;
  const MicroLensIndex& index_;
  const SensorNoise& noise_;
  const DepthSurvey& survey_;
  float pitch_;
  int nearest_ = -1;      // to the last points
  size_t looked_at_ = 0;  // steps from it
  std::vector<Neighbour> neighbours_;
  std::vector<Samples> samples_;  // working memory
};

PLENOCAL_FOR_EACH_PROCESSOR
void Sampler::CombineAround(const Eigen::Vector2f& from,
                            float step,
                            const Lanes& z,
                            Lanes* values) {
  // Half the variances of the blurs less that of the sharpest type, px^2.
  struct {
    Lanes of_type[kMostLensTypes];
  } blur;
  Lanes sharpest = Lanes{} + std::numeric_limits<float>::infinity();
  for (size_t type = 0; type < survey_.defocus.size(); ++type) {
    const Lanes own = survey_.defocus[type].offset + survey_.defocus[type].slope * z;
    blur.of_type[type] = own;
    sharpest = own < sharpest ? own : sharpest;
  }
  const Lanes along = from.x() + step * Lanes{0, 1, 2, 3, 4, 5, 6, 7};
  const float scale = 1 / (patches_.radius_px * patches_.radius_px);
  const int n = patches_.size;
  const cv::Mat& image = patches_.attenuation;
  const auto* attenuations = image.ptr<float>();
  const int stride = static_cast<int>(image.step1());
  samples_.clear();
  for (const Neighbour& lens : neighbours_) {
    const Lanes u = (along - lens.from.x()) * z, v = (from.y() - lens.from.y()) * z;
    const Lanes square = (u * u + v * v) * scale;
    const IntLanes inside = square < 1;
    int any = 0;
    for (int l = 0; l < kLanes; ++l) any |= inside[l];
    if (any == 0) continue;
    // Points that are not in view are sampled at the centre and get no weight.
    const Lanes x = lens.centre.x() + (inside ? u : Lanes{});
    const Lanes y = lens.centre.y() + (inside ? v : Lanes{});
    const IntLanes column = __builtin_convertvector(x, IntLanes);
    const IntLanes row = __builtin_convertvector(y, IntLanes);
    const Lanes fx = x - __builtin_convertvector(column, Lanes);
    const Lanes fy = y - __builtin_convertvector(row, Lanes);
    // The nearest pixel, also in the image, where unknown values may have none.
    const IntLanes right = fx < 0.5f ? IntLanes{} : IntLanes{} + 1;
    const IntLanes down = fy < 0.5f ? IntLanes{} : IntLanes{} + 1;
    IntLanes image_x = column + right + lens.origin.x(), image_y = row + down + lens.origin.y();
    image_x = image_x < 0 ? IntLanes{} : image_x;
    image_y = image_y < 0 ? IntLanes{} : image_y;
    image_x = image_x < image.cols ? image_x : IntLanes{} + (image.cols - 1);
    image_y = image_y < image.rows ? image_y : IntLanes{} + (image.rows - 1);
    const IntLanes at = row * n + column, nearest = at + down * n + right;
    const IntLanes pixel = image_y * stride + image_x;
    Lanes upper_left, upper_right, lower_left, lower_right, laplacian, attenuation;
    for (int l = 0; l < kLanes; ++l) {
      const float* corner = lens.value + at[l];
      const float* m = lens.value + nearest[l];
      upper_left[l] = corner[0];
      upper_right[l] = corner[1];
      lower_left[l] = corner[n];
      lower_right[l] = corner[n + 1];
      laplacian[l] = m[-1] + m[1] + m[-n] + m[n] - 4 * m[0];
      attenuation[l] = attenuations[pixel[l]];
    }
    Lanes value = (1 - fy) * (upper_left + fx * (upper_right - upper_left)) +
                  fy * (lower_left + fx * (lower_right - lower_left));
    const IntLanes known = inside & (value == value);
    value = known ? value : Lanes{};
    const Lanes lost =
        laplacian == laplacian ? (blur.of_type[lens.type] - sharpest) * laplacian : Lanes{};
    const Lanes light = (value > 0 ? value : Lanes{}) * attenuation;
    const Lanes variance =
        known ? (noise_.read + noise_.shot * light) / (attenuation * attenuation) + lost * lost
              : Lanes{} + 1;
    samples_.push_back({value, variance, known ? (1 - square) / variance : Lanes{}});
  }
  Combine(samples_, values);
}

}  // namespace

cv::Mat SynthesiseFocusedImage(const VirtualDepth& depth,
                               const LensPatches& patches,
                               const MicroLensIndex& index,
                               const SensorNoise& noise,
                               const DepthSurvey& survey,
                               int threads) {
  const StepsInView steps(patches, index.Array(), survey.range, kLanes * depth.scale);
  cv::Mat image(depth.inverse.size(), CV_32F);
  ParallelFor((image.rows + kRowsPerTask - 1) / kRowsPerTask, threads, [&](size_t task) {
    Sampler sampler(steps, patches, index, noise, survey);
    const int end = std::min(image.rows, static_cast<int>(task + 1) * kRowsPerTask);
    for (int y = static_cast<int>(task) * kRowsPerTask; y < end; ++y) {
      const auto* const inverse = depth.inverse.ptr<float>(y);
      auto* const out = image.ptr<float>(y);
      for (int x = 0; x < image.cols; x += kLanes) {
        const int count = std::min(kLanes, image.cols - x);
        Lanes z = Lanes{} + std::numeric_limits<float>::quiet_NaN(), values;
        for (int l = 0; l < count; ++l) z[l] = inverse[x + l];
        sampler.Sample({x * depth.scale, y * depth.scale}, depth.scale, z, &values);
        for (int l = 0; l < count; ++l) out[x + l] = values[l];
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
