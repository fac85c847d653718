// SPDX-License-Identifier: Apache-2.0
#include "detectors/pixel_depth.h"

#include <Eigen/Dense>
#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <limits>
#include <mutex>
#include <numbers>
#include <span>

#include "calib/median.h"
#include "calib/parallel.h"
#include "detectors/depth_kernels.h"

namespace plenocal::internal {
namespace {

/// Step of the search at the shortest baseline, px: within a Gauss-Newton step of the truth also at
/// the longest.
constexpr float kSearchStep = 0.5f;
/// The search compares with neighbours up to this many pitches away, where every depth step is at
/// most a pixel: the six nearest and the six next, among them those of the same lens type.
constexpr double kSearchReach = 1.75;
/// The refinement, with longer baselines.
constexpr double kRefineReach = 2.0;
/// Chi-square of two degrees of freedom that noise alone exceeds in one of 10,000 pixels.
constexpr float kNoGradient = 18.42f;
constexpr size_t kLensesPerTask = 32;

/// Pixels of one micro image that have texture, as arrays.
struct Pixels {
  std::vector<float> x, y, z, value, gradient_x, gradient_y, laplacian, variance;
  std::vector<int> at;  // in the patch
  std::vector<float> sum_gradient, sum_information, sum_agreement, sum_count;

  void Clear() {
    for (auto* v : {&x, &y, &z, &value, &gradient_x, &gradient_y, &laplacian, &variance})
      v->clear();
    at.clear();
  }
  [[nodiscard]] DepthPixels View() const {
    return {static_cast<int>(x.size()),
            x.data(),
            y.data(),
            z.data(),
            value.data(),
            gradient_x.data(),
            gradient_y.data(),
            laplacian.data(),
            variance.data()};
  }
  DepthEquations ResetSums() {
    for (auto* v : {&sum_gradient, &sum_information, &sum_agreement, &sum_count}) {
      v->assign(x.size(), 0.f);
    }
    return {sum_gradient.data(), sum_information.data(), sum_agreement.data(), sum_count.data()};
  }
  /// Keeps those whose flag is set.
  void Keep(const std::vector<char>& keep) {
    const auto filter = [&](auto* values) {
      size_t n = 0;
      for (size_t i = 0; i < keep.size(); ++i) {
        if (keep[i] != 0) (*values)[n++] = (*values)[i];
      }
      values->resize(n);
    };
    for (auto* v : {&x, &y, &z, &value, &gradient_x, &gradient_y, &laplacian, &variance}) filter(v);
    filter(&at);
  }
};

/// Working memory of one thread.
struct Scratch {
  Pixels pixels;
  std::vector<float> cost, count;  // patch
  std::vector<float> work;         // two patches
  std::vector<float> means;        // hypotheses x patch: mean difference in a window
  std::vector<int> lookup;         // patch: index of the pixel in `pixels`, or -1
  std::vector<float> smooth, smooth_information;
};

/// A pixel whose depth a search found.
struct Start {
  int at;  // in the patch
  float z;
};

/// grad I . grad V / V at a pixel of a patch, grad I given.
float VignettingPull(
    const LensPatches& patches, size_t lens, int x, int y, float gradient_x, float gradient_y) {
  return patches.LightSlope(lens, x, y).dot(Eigen::Vector2f(gradient_x, gradient_y));
}

float At(const std::array<float, 2>& line, float z) { return line[0] + line[1] * z; }

/// Takes the shift near the edge out of one micro image, at the depths of its pixels.
void RemoveVignettingShift(std::span<const Start> starts,
                           const std::array<float, 2>& vignetting,
                           float usual_z,
                           size_t lens,
                           LensPatches* patches) {
  const int n = patches->size;
  float* value = patches->value.data() + lens * patches->Area();
  std::vector<float> z(patches->Area(), usual_z), shifted(value, value + patches->Area());
  for (const Start& start : starts) z[start.at] = start.z;
  // At the edge of what is known from one side.
  const auto slope = [](float before, float here, float after) {
    if (std::isnan(before)) before = here, after = here + 2 * (after - here);
    if (std::isnan(after)) after = here + 2 * (here - before);
    return std::isnan(after - before) ? 0 : (after - before) / 2;
  };
  for (int y = 1; y + 1 < n; ++y) {
    for (int x = 1; x + 1 < n; ++x) {
      const int at = y * n + x;
      const float* v = shifted.data() + at;
      if (std::isnan(v[0])) continue;
      value[at] -=
          At(vignetting, z[at]) *
          VignettingPull(*patches, lens, x, y, slope(v[-1], v[0], v[1]), slope(v[-n], v[0], v[n]));
    }
  }
}

/// Unknowns of a survey: f_0, f_1, k_0, k_1 of each lens type.
constexpr int kPerType = 4;
using SurveyMatrix = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, 0, 12, 12>;
using SurveyVector = Eigen::Matrix<double, Eigen::Dynamic, 1, 0, 12, 1>;

/// One comparison of a survey: what is left, e = f Laplacian + k pull, other less own, + slope dz.
struct Comparison {
  int own_type, other_type;
  float z, laplacian, own_pull, other_pull, slope;
  float error, weight;
  float variance;  // noise of one grey value
};

/// Normal equations of a survey from one pixel, whose own depth is an unknown too.
class PixelSums {
 public:
  explicit PixelSums(int types)
      : normal_(SurveyMatrix::Zero(kPerType * types, kPerType * types)),
        right_(SurveyVector::Zero(kPerType * types)),
        coupling_(SurveyVector::Zero(kPerType * types)) {}

  /// Noise of the middle pixel is in the error (-1) and in the Laplacian (-4), whose own noise is
  /// 20 times as large.
  void Add(const Comparison& c) {
    const double w = c.weight;
    const int own = kPerType * c.own_type, other = kPerType * c.other_type;
    const std::array<int, 8> at{
        other, other + 1, other + 2, other + 3, own, own + 1, own + 2, own + 3};
    const double f = c.laplacian, in = c.other_pull, out = -c.own_pull, z = c.z;
    const std::array<double, 8> factor{f, f * z, in, in * z, -f, -f * z, out, out * z};
    // By the Laplacian; of one type it cancels.
    const double by = own == other ? 0 : 1;
    const std::array<double, 8> noisy{by, by * z, 0, 0, -by, -by * z, 0, 0};
    const double noise = w * c.variance;
    for (size_t i = 0; i < at.size(); ++i) {
      right_[at[i]] += w * c.error * factor[i] - 4 * noise * noisy[i];
      coupling_[at[i]] += w * c.slope * factor[i];
      for (size_t j = 0; j < at.size(); ++j) {
        normal_(at[i], at[j]) += w * factor[i] * factor[j] - 20 * noise * noisy[i] * noisy[j];
      }
    }
    depth_ += w * c.slope * c.slope;
    depth_right_ += w * c.slope * c.error;
  }

  void Eliminate(Eigen::MatrixXd* normal, Eigen::VectorXd* right) const {
    if (!(depth_ > 0)) return;
    *normal += normal_ - coupling_ * coupling_.transpose() / depth_;
    *right += right_ - coupling_ * (depth_right_ / depth_);
  }

 private:
  SurveyMatrix normal_;
  SurveyVector right_, coupling_;
  double depth_ = 0, depth_right_ = 0;
};

/// Sums over the comparisons of a survey.
struct SurveySums {
  explicit SurveySums(int lens_types)
      : types(lens_types),
        normal(Eigen::MatrixXd::Zero(kPerType * lens_types, kPerType * lens_types)),
        right(Eigen::VectorXd::Zero(kPerType * lens_types)),
        misfits(static_cast<size_t>(lens_types) * lens_types) {}

  void Add(const SurveySums& part) {
    normal += part.normal;
    right += part.right;
    depths.insert(depths.end(), part.depths.begin(), part.depths.end());
    for (size_t pair = 0; pair < misfits.size(); ++pair) {
      misfits[pair].insert(
          misfits[pair].end(), part.misfits[pair].begin(), part.misfits[pair].end());
    }
  }

  /// A prior of one px^2 decides what the comparisons do not, such as a defocus of all types.
  void Apply(DepthSurvey* survey) const {
    Eigen::MatrixXd sum = normal;
    sum.diagonal().array() += 1;
    const Eigen::VectorXd step = sum.ldlt().solve(right);
    for (int type = 0; type < types; ++type) {
      for (int k = 0; k < 2; ++k) {
        survey->defocus[type][k] += static_cast<float>(step[kPerType * type + k]);
        survey->vignetting[type][k] += static_cast<float>(step[kPerType * type + 2 + k]);
      }
    }
    for (size_t pair = 0; pair < misfits.size(); ++pair) {
      const std::vector<float>& values = misfits[pair];
      if (values.empty()) continue;
      // The median of a chi-square of one degree of freedom is 0.4549.
      survey->misfit[pair] = std::max(0.f, Median(values) / 0.4549f);
    }
  }

  int types;
  Eigen::MatrixXd normal;
  Eigen::VectorXd right;
  std::vector<std::vector<float>> misfits;
  std::vector<float> depths;  // z of all pixels that matched
};

class Matcher {
 public:
  Matcher(const LensPatches& patches,
          const MicroLensArray& array,
          const MicroLensIndex& index,
          const SensorNoise& noise)
      : patches_(patches),
        array_(array),
        index_(index),
        noise_(noise),
        search_steps_(StepsWithin(array, kSearchReach)),
        refine_steps_(StepsWithin(array, kRefineReach)) {}

  /// Whole range of |z|: from one pixel of parallax between neighbours to where a point is seen by
  /// two micro images on average: the centres within radius / |z| of it, one a cell of sqrt(3/4)
  /// pitch^2.
  [[nodiscard]] ZRange Magnitudes() const {
    const auto pitch = static_cast<float>(array_.Pitch());
    const float seen_twice =
        patches_.radius_px / pitch * std::sqrt(std::numbers::pi_v<float> / (2 * std::sqrt(0.75f)));
    return {1 / pitch, seen_twice};
  }

  /// Step of the search in z.
  [[nodiscard]] float Step() const { return kSearchStep / static_cast<float>(array_.Pitch()); }

  /// Collects the pixels with texture.
  void Select(size_t lens, Scratch* scratch) const {
    const int n = patches_.size;
    scratch->pixels.Clear();
    for (int y = LensPatches::kMargin; y < n - LensPatches::kMargin; ++y) {
      for (int x = LensPatches::kMargin; x < n - LensPatches::kMargin; ++x) {
        AddTextured(lens, {y * n + x, 0}, &scratch->pixels);
      }
    }
  }

  /// Collects those of them that have texture (still).
  void Select(size_t lens, std::span<const Start> starts, Scratch* scratch) const {
    scratch->pixels.Clear();
    for (const Start& start : starts) AddTextured(lens, start, &scratch->pixels);
  }

  /// Start values: the depth of the 3 x 3 window with the least mean difference. Drops pixels whose
  /// best depth is not clearly better than all that are not next to it.
  void Search(size_t lens, ZRange range, Scratch* s) const {
    Pixels& p = s->pixels;
    const int n = patches_.size;
    const size_t area = patches_.Area();
    const float step = Step();
    const int hypotheses = static_cast<int>(std::ceil((range.highest - range.lowest) / step)) + 1;
    // A window must be compared as a whole with at least one other micro image.
    constexpr float kLeastCount = 9;
    s->means.resize(hypotheses * area);
    s->work.resize(2 * area);
    for (int h = 0; h < hypotheses; ++h) {
      s->cost.assign(area + 16, 0.f);
      s->count.assign(area + 16, 0.f);
      const float z = range.lowest + static_cast<float>(h) * step;
      for (const LatticeStep& to : search_steps_) {
        const int other = index_.Neighbour(static_cast<int>(lens), to);
        if (other >= 0) Compare(lens, other, z, s);
      }
      WindowMeans(n,
                  s->cost.data(),
                  s->count.data(),
                  kLeastCount,
                  s->work.data(),
                  s->means.data() + h * area);
    }
    std::vector<char> keep(p.x.size(), 0);

    std::vector<float> mean(hypotheses);
    for (size_t i = 0; i < p.x.size(); ++i) {
      int best = -1;
      float least = std::numeric_limits<float>::infinity();
      for (int h = 0; h < hypotheses; ++h) {
        mean[h] = s->means[h * area + p.at[i]];
        if (mean[h] < least) {
          least = mean[h];
          best = h;
        }
      }
      // At an end of the range it is no minimum: a pattern that all micro images share, such as
      // dirt,
      // matches at z = 0.
      if (best <= 0 || best + 1 == hypotheses) continue;
      float second = std::numeric_limits<float>::infinity();
      for (int h = 0; h < hypotheses; ++h) {
        if (std::abs(h - best) > 2) second = std::min(second, mean[h]);
      }
      // Of n absolute differences with mean m, normal, the mean scatters by 0.756 m / sqrt(n); n is
      // at least that.
      const float scatter = 0.756f * least * std::sqrt(2 / kLeastCount);
      if (!(second - least > 3 * scatter)) continue;
      keep[i] = 1;
      float shift = 0;
      if (std::isfinite(mean[best - 1]) && std::isfinite(mean[best + 1])) {
        const float curvature = mean[best - 1] - 2 * mean[best] + mean[best + 1];
        if (curvature > 0) shift = (mean[best - 1] - mean[best + 1]) / (2 * curvature);
      }
      p.z[i] = range.lowest + (static_cast<float>(best) + shift) * step;
    }
    p.Keep(keep);
  }

  /// Gauss-Newton steps, shortest baselines first. Drops pixels that leave their start value, agree
  /// with less than half of their partners or have fewer than two.
  void Refine(size_t lens, const DepthSurvey& survey, Scratch* s) const {
    Pixels& p = s->pixels;
    const float step = Step();
    const std::vector<float> start = p.z;
    const auto iterate = [&](std::span<const LatticeStep> steps) {
      const DepthEquations sums = p.ResetSums();
      for (const LatticeStep& to : steps) {
        const int other = index_.Neighbour(static_cast<int>(lens), to);
        if (other < 0) continue;
        AddEquations(p.View(), Other(lens, other, survey), sums);
      }
      for (size_t i = 0; i < p.x.size(); ++i) {
        if (!(p.sum_information[i] > 0)) continue;
        p.z[i] += std::clamp(-p.sum_gradient[i] / p.sum_information[i], -step, step);
      }
    };
    iterate(search_steps_);
    // Each step leaves the share of the error by which the gradient is off. The search's error is
    // the same for all of a surface at one depth, so what is left of it would not average out.
    iterate(refine_steps_);
    iterate(refine_steps_);
    for (size_t i = 0; i < p.x.size(); ++i) {
      const bool good = p.sum_count[i] >= 2 && p.sum_agreement[i] > p.sum_count[i] / 2 &&
                        std::abs(p.z[i] - start[i]) < 2 * step && p.z[i] >= survey.range.lowest &&
                        p.z[i] <= survey.range.highest;
      if (!good) p.sum_information[i] = 0;
    }
    Regularise(s);
  }

  /// What `Search` found.
  [[nodiscard]] static std::vector<Start> Starts(const Scratch& s) {
    std::vector<Start> starts;
    starts.reserve(s.pixels.x.size());
    for (size_t i = 0; i < s.pixels.x.size(); ++i)
      starts.push_back({s.pixels.at[i], s.pixels.z[i]});
    return starts;
  }

  /// Adds what the comparisons at the pixels' depths say about the camera.
  void Collect(size_t lens, const DepthSurvey& survey, Scratch* s, SurveySums* sums) const {
    Pixels& p = s->pixels;
    const std::vector<float> information = p.sum_information;
    const int type = array_.lenses[lens].type;
    DepthSurvey without_misfit = survey;
    std::fill(without_misfit.misfit.begin(), without_misfit.misfit.end(), 0.f);
    std::vector<float> own_pull(p.x.size());
    for (size_t i = 0; i < p.x.size(); ++i) own_pull[i] = Pull(p, i, lens, p.x[i], p.y[i]);
    std::vector<PixelSums> pixels(p.x.size(), PixelSums(array_.types));
    for (const LatticeStep& to : refine_steps_) {
      const int other = index_.Neighbour(static_cast<int>(lens), to);
      if (other < 0) continue;
      const int other_type = array_.lenses[other].type;
      const OtherPatch patch = Other(lens, other, without_misfit);
      const DepthEquations equations = p.ResetSums();
      AddEquations(p.View(), patch, equations);
      const float length = std::hypot(patch.baseline_x, patch.baseline_y);
      for (size_t i = 0; i < p.x.size(); ++i) {
        const float slope =
            -(patch.baseline_x * p.gradient_x[i] + patch.baseline_y * p.gradient_y[i]);
        if (information[i] <= 0 || p.sum_count[i] == 0 || slope == 0) continue;
        const float z = p.z[i];
        const float other_pull = Pull(p,
                                      i,
                                      other,
                                      p.x[i] + patch.offset_x - patch.baseline_x * z,
                                      p.y[i] + patch.offset_y - patch.baseline_y * z);
        // Back from the sums of a single comparison: gradient = w J e, agreement = w * variance.
        const float variance = 2 * p.variance[i];
        const float error = p.sum_gradient[i] * variance / (p.sum_agreement[i] * slope) -
                            At(survey.vignetting[other_type], z) * other_pull +
                            At(survey.vignetting[type], z) * own_pull[i];
        const float along = slope * slope / (length * length);
        const float expected = variance + survey.misfit[Pair(lens, other)] * along;
        pixels[i].Add({.own_type = type,
                       .other_type = other_type,
                       .z = z,
                       .laplacian = p.laplacian[i],
                       .own_pull = own_pull[i],
                       .other_pull = other_pull,
                       .slope = slope,
                       .error = error,
                       .weight = 1 / (expected + error * error / (2.385f * 2.385f)),
                       .variance = p.variance[i]});
        if (along < kNoGradient * p.variance[i]) continue;
        sums->misfits[Pair(lens, other)].push_back((error * error - variance) / along);
      }
    }
    for (const PixelSums& pixel : pixels) pixel.Eliminate(&sums->normal, &sums->right);
    p.sum_information = information;
  }

  [[nodiscard]] LensDepth Results(size_t lens, const Scratch& s) const {
    const Pixels& p = s.pixels;
    LensDepth depth;
    depth.reserve(static_cast<size_t>(std::count_if(
        p.sum_information.begin(), p.sum_information.end(), [](float i) { return i > 0; })));
    for (size_t i = 0; i < p.x.size(); ++i) {
      if (!(p.sum_information[i] > 0)) continue;
      depth.push_back({p.x[i] - patches_.centre[lens].x(),
                       p.y[i] - patches_.centre[lens].y(),
                       p.z[i],
                       1 / p.sum_information[i]});
    }
    return depth;
  }

 private:
  [[nodiscard]] size_t Pair(size_t lens, size_t other) const {
    return static_cast<size_t>(array_.lenses[lens].type) * array_.types + array_.lenses[other].type;
  }

  [[nodiscard]] OtherPatch Other(size_t lens, size_t other, const DepthSurvey& survey) const {
    const Eigen::Vector2f baseline =
        (array_.lenses[other].centre - array_.lenses[lens].centre).cast<float>();
    const Eigen::Vector2f offset =
        (patches_.origin[lens] - patches_.origin[other]).cast<float>() + baseline;
    const auto& of_lens = survey.defocus[array_.lenses[lens].type];
    const auto& of_other = survey.defocus[array_.lenses[other].type];
    return {patches_.Value(other),
            patches_.size,
            offset.x(),
            offset.y(),
            baseline.x(),
            baseline.y(),
            {of_other[0] - of_lens[0], of_other[1] - of_lens[1]},
            survey.misfit[Pair(lens, other)]};
  }

  /// Adds a pixel if it has texture.
  void AddTextured(size_t lens, const Start& start, Pixels* p) const {
    const int n = patches_.size, at = start.at;
    const float* value = patches_.Value(lens);
    const float gx = (value[at + 1] - value[at - 1]) / 2;
    const float gy = (value[at + n] - value[at - n]) / 2;
    if (std::isnan(value[at]) || std::isnan(gx) || std::isnan(gy)) return;
    const int x = at % n, y = at / n;
    const float v = patches_.Light(lens, x, y);
    const float variance = (noise_.read + noise_.shot * std::max(0.f, value[at]) * v) / (v * v);
    if (!(gx * gx + gy * gy > kNoGradient * variance / 2)) return;
    p->x.push_back(static_cast<float>(x));
    p->y.push_back(static_cast<float>(y));
    p->z.push_back(start.z);
    p->value.push_back(value[at]);
    p->gradient_x.push_back(gx);
    p->gradient_y.push_back(gy);
    p->laplacian.push_back(value[at - 1] + value[at + 1] + value[at - n] + value[at + n] -
                           4 * value[at]);
    p->variance.push_back(variance);
    p->at.push_back(at);
  }

  /// The pull on what pixel i shows at (x, y) in the patch of a micro lens.
  [[nodiscard]] float Pull(const Pixels& p, size_t i, size_t lens, float x, float y) const {
    return VignettingPull(patches_,
                          lens,
                          static_cast<int>(std::lround(x)),
                          static_cast<int>(std::lround(y)),
                          p.gradient_x[i],
                          p.gradient_y[i]);
  }

  /// Weighted means over 5 x 5 pixels of what agrees with the middle one to within three sigma: a
  /// blur that the model misses shifts both flanks of an edge in opposite directions.
  void Regularise(Scratch* s) const {
    Pixels& p = s->pixels;
    const int n = patches_.size;
    s->lookup.assign(patches_.Area(), -1);
    for (size_t i = 0; i < p.x.size(); ++i) {
      if (p.sum_information[i] > 0) s->lookup[p.at[i]] = static_cast<int>(i);
    }
    s->smooth.assign(p.x.size(), 0.f);
    s->smooth_information.assign(p.x.size(), 0.f);
    for (size_t i = 0; i < p.x.size(); ++i) {
      if (!(p.sum_information[i] > 0)) continue;
      float sum = 0, weights = 0, count = 0, all = 0;
      for (int dy = -2; dy <= 2; ++dy) {
        for (int dx = -2; dx <= 2; ++dx) {
          const int k = s->lookup[p.at[i] + dy * n + dx];
          if (k < 0) continue;
          all += 1;
          const float off = p.z[k] - p.z[i], information = p.sum_information[k];
          if (off * off * information * p.sum_information[i] >
              9 * (information + p.sum_information[i])) {
            continue;
          }
          sum += information * p.z[k];
          weights += information;
          count += 1;
        }
      }
      if (count * 2 < all || count < 2) continue;
      s->smooth[i] = sum / weights;
      s->smooth_information[i] = weights / count;
    }
    p.z = s->smooth;
    p.sum_information = s->smooth_information;
  }

  /// Adds the differences between two micro images at one depth to s->cost and s->count.
  void Compare(size_t lens, size_t other, float z, Scratch* s) const {
    const Eigen::Vector2f baseline =
        (array_.lenses[other].centre - array_.lenses[lens].centre).cast<float>();
    const Eigen::Vector2f shift =
        (patches_.origin[lens] - patches_.origin[other]).cast<float>() + baseline * (1 - z);
    const Eigen::Vector2i whole = shift.array().floor().cast<int>();
    // Where both patches, without their margins, overlap.
    const int n = patches_.size, low = LensPatches::kMargin, high = n - LensPatches::kMargin;
    const int x0 = std::max(low, low - whole.x()), x1 = std::min(high, high - whole.x());
    const int y0 = std::max(low, low - whole.y()), y1 = std::min(high, high - whole.y());
    if (x1 <= x0 || y1 <= y0) return;
    const int at = y0 * n + x0;
    AddDifferences({.reference = patches_.Value(lens) + at,
                    .other = patches_.Value(other) + at + whole.y() * n + whole.x(),
                    .stride = n,
                    .rows = y1 - y0,
                    .columns = x1 - x0,
                    .shift_x = shift.x() - static_cast<float>(whole.x()),
                    .shift_y = shift.y() - static_cast<float>(whole.y())},
                   s->cost.data() + at,
                   s->count.data() + at);
  }

  const LensPatches& patches_;
  const MicroLensArray& array_;
  const MicroLensIndex& index_;
  const SensorNoise& noise_;
  std::vector<LatticeStep> search_steps_, refine_steps_;
};

/// Where nearly all depths lie, half as much again on either side and at least a few steps of the
/// search.
ZRange LikelyRange(std::vector<float> depths, ZRange all, float step) {
  constexpr size_t kOutliers = 200;  // one in so many at either end may be a chance match
  constexpr float kLeastSteps = 3;
  if (depths.empty()) return all;
  std::sort(depths.begin(), depths.end());
  const float low = depths[depths.size() / kOutliers];
  const float high = depths[depths.size() - 1 - depths.size() / kOutliers];
  const float margin = std::max((high - low) / 2, kLeastSteps * step);
  return {std::max(all.lowest, low - margin), std::min(all.highest, high + margin)};
}

}  // namespace

DepthSurvey SurveyDepth(const LensPatches& patches,
                        const MicroLensArray& array,
                        const MicroLensIndex& index,
                        const SensorNoise& noise,
                        int threads) {
  constexpr size_t kSample = 400;
  // Before anything is known: matches are right to within rounding to whole pixels.
  constexpr float kRounding = 1.f / 12;
  const Matcher matcher(patches, array, index, noise);
  const size_t stride = std::max<size_t>(1, array.lenses.size() / kSample);
  const auto match = [&](const DepthSurvey& survey) {
    SurveySums sums(array.types);
    std::mutex mutex;
    ParallelFor(array.lenses.size() / stride, threads, [&](size_t task) {
      Scratch scratch;
      SurveySums own(array.types);
      matcher.Select(task * stride, &scratch);
      matcher.Search(task * stride, survey.likely, &scratch);
      matcher.Refine(task * stride, survey, &scratch);
      for (size_t i = 0; i < scratch.pixels.z.size(); ++i) {
        if (scratch.pixels.sum_information[i] > 0) own.depths.push_back(scratch.pixels.z[i]);
      }
      matcher.Collect(task * stride, survey, &scratch, &own);
      const std::lock_guard lock(mutex);
      sums.Add(own);
    });
    return sums;
  };

  const ZRange magnitudes = matcher.Magnitudes();
  DepthSurvey galilean{
      .range = magnitudes,
      .likely = magnitudes,
      .defocus = std::vector(array.types, std::array{0.f, 0.f}),
      .vignetting = std::vector(array.types, std::array{0.f, 0.f}),
      .misfit = std::vector(static_cast<size_t>(array.types) * array.types, kRounding)};
  DepthSurvey keplerian = galilean;
  keplerian.range = {-magnitudes.highest, -magnitudes.lowest};
  keplerian.likely = keplerian.range;
  const SurveySums as_galilean = match(galilean), as_keplerian = match(keplerian);
  const bool is_galilean = as_galilean.depths.size() >= as_keplerian.depths.size();
  DepthSurvey survey = is_galilean ? galilean : keplerian;
  (is_galilean ? as_galilean : as_keplerian).Apply(&survey);
  // Once more with what was found.
  survey.likely =
      LikelyRange((is_galilean ? as_galilean : as_keplerian).depths, survey.range, matcher.Step());
  const SurveySums again = match(survey);
  again.Apply(&survey);
  survey.likely = LikelyRange(again.depths, survey.range, matcher.Step());
  return survey;
}

std::vector<LensDepth> MatchMicroImages(const MicroLensArray& array,
                                        const MicroLensIndex& index,
                                        const SensorNoise& noise,
                                        const DepthSurvey& survey,
                                        int threads,
                                        LensPatches* patches) {
  const Matcher matcher(*patches, array, index, noise);
  const size_t lenses = array.lenses.size();
  const auto for_each_lens = [&](const std::function<void(size_t, Scratch*)>& use) {
    ParallelFor((lenses + kLensesPerTask - 1) / kLensesPerTask, threads, [&](size_t task) {
      Scratch scratch;
      const size_t end = std::min(lenses, (task + 1) * kLensesPerTask);
      for (size_t lens = task * kLensesPerTask; lens < end; ++lens) use(lens, &scratch);
    });
  };

  std::vector<std::vector<Start>> starts(lenses);
  for_each_lens([&](size_t lens, Scratch* scratch) {
    matcher.Select(lens, scratch);
    const size_t textured = scratch->pixels.x.size();
    if (textured == 0) return;
    matcher.Search(lens, survey.likely, scratch);
    if (scratch->pixels.x.size() < textured / 2) {
      // Perhaps something that the survey did not meet.
      matcher.Select(lens, scratch);
      matcher.Search(lens, survey.range, scratch);
    }
    starts[lens] = Matcher::Starts(*scratch);
  });
  const float usual_z = (survey.likely.lowest + survey.likely.highest) / 2;
  for_each_lens([&](size_t lens, Scratch*) {
    RemoveVignettingShift(
        starts[lens], survey.vignetting[array.lenses[lens].type], usual_z, lens, patches);
  });
  std::vector<LensDepth> depths(lenses);
  for_each_lens([&](size_t lens, Scratch* scratch) {
    if (starts[lens].empty()) return;
    matcher.Select(lens, starts[lens], scratch);
    starts[lens] = {};
    matcher.Refine(lens, survey, scratch);
    depths[lens] = matcher.Results(lens, *scratch);
  });
  return depths;
}

}  // namespace plenocal::internal
