// SPDX-License-Identifier: Apache-2.0
#include "detectors/plenoptic/depth/depth_matcher.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <optional>

#include "detectors/plenoptic/depth/pixel_depth.h"

namespace plenocal::internal {
namespace {

constexpr float kInfinity = std::numeric_limits<float>::infinity();

/// Step of the search at the shortest baseline, px: within a Gauss-Newton step of the truth also at
/// the longest baseline.
constexpr float kSearchStep = 0.5f;
/// The search compares with neighbours up to this many pitches away, where every depth step is at
/// most a pixel: the six nearest and the six next, among them those of the same lens type.
constexpr double kSearchReach = 1.75;
/// The refinement has longer baselines, pitches.
constexpr double kRefineReach = 2.0;

/// Comparisons of a whole 3 x 3 window with one other micro image: the fewest that count.
constexpr float kWindowPixels = 9;
/// Standard deviation of |x| over its mean, x normal: sqrt(pi / 2 - 1).
constexpr float kScatterOfMagnitude = 0.756f;
/// The best depth must be better than others by this many standard errors of a window's mean.
constexpr float kClearlyBetter = 3;
/// Depths up to this many steps from the best belong to the same minimum.
constexpr int kSameMinimum = 2;
/// A pixel whose refined depth is farther from its initial depth has left its minimum, steps.
constexpr float kLeftMinimum = 2;
/// Comparisons that a depth needs: a single one cannot be wrong visibly.
constexpr float kFewestPartners = 2;
/// Depths of one surface differ by up to this many standard deviations.
constexpr float kSameSurface = 3;
/// Floats beyond a patch that the blocks of eight in the last row may touch.
constexpr size_t kBlockTail = 16;

/// Depth at the minimum of the mean differences, in steps from the lowest hypothesis, to a fraction
/// of a step; nothing where the minimum is not clear.
std::optional<float> ClearMinimum(const std::vector<float>& mean) {
  const int hypotheses = static_cast<int>(mean.size());
  int best = -1;
  float least = kInfinity;
  for (int h = 0; h < hypotheses; ++h) {
    if (mean[h] < least) {
      least = mean[h];
      best = h;
    }
  }
  // The end of the range is no minimum: a pattern that all micro images share, such as dirt,
  // matches at z = 0.
  if (best <= 0 || best + 1 == hypotheses) return std::nullopt;
  float second = kInfinity;
  for (int h = 0; h < hypotheses; ++h) {
    if (std::abs(h - best) > kSameMinimum) second = std::min(second, mean[h]);
  }
  // Standard error of the difference of two means of at least `kWindowPixels` absolute values.
  const float scatter = kScatterOfMagnitude * least * std::sqrt(2 / kWindowPixels);
  if (!(second - least > kClearlyBetter * scatter)) return std::nullopt;
  float shift = 0;
  if (std::isfinite(mean[best - 1]) && std::isfinite(mean[best + 1])) {
    const float curvature = mean[best - 1] - 2 * mean[best] + mean[best + 1];
    if (curvature > 0) shift = (mean[best - 1] - mean[best + 1]) / (2 * curvature);
  }
  return static_cast<float>(best) + shift;
}

}  // namespace

void TexturedPixels::Clear() {
  for (auto* v : {&x, &y, &z, &value, &gradient_x, &gradient_y, &laplacian, &variance}) v->clear();
  at.clear();
}

DepthPixels TexturedPixels::View() const {
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

DepthEquations TexturedPixels::ResetSums() {
  for (auto* v : {&sum_gradient, &sum_information, &sum_agreement, &sum_count}) {
    v->assign(x.size(), 0.f);
  }
  return {sum_gradient.data(), sum_information.data(), sum_agreement.data(), sum_count.data()};
}

void TexturedPixels::Keep(const std::vector<char>& keep) {
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

DepthMatcher::DepthMatcher(const LensPatches& patches,
                           const MicroLensIndex& index,
                           const SensorNoise& noise)
    : patches_(patches),
      index_(index),
      noise_(noise),
      search_steps_(StepsWithin(index.Array(), kSearchReach)),
      refine_steps_(StepsWithin(index.Array(), kRefineReach)) {}

ZRange DepthMatcher::Magnitudes() const {
  const auto pitch = static_cast<float>(index_.Array().Pitch());
  // The centres within radius / |z| of a point see it, one per cell of sqrt(3/4) pitch^2.
  const float seen_twice =
      patches_.radius_px / pitch * std::sqrt(std::numbers::pi_v<float> / (2 * std::sqrt(0.75f)));
  return {1 / pitch, seen_twice};
}

float DepthMatcher::Step() const {
  return kSearchStep / static_cast<float>(index_.Array().Pitch());
}

void DepthMatcher::Select(size_t lens, MatchScratch* scratch) const {
  const int n = patches_.size;
  scratch->pixels.Clear();
  for (int y = LensPatches::kMargin; y < n - LensPatches::kMargin; ++y) {
    for (int x = LensPatches::kMargin; x < n - LensPatches::kMargin; ++x) {
      AddTextured(lens, x, y, 0, &scratch->pixels);
    }
  }
}

void DepthMatcher::Select(size_t lens,
                          std::span<const DepthStart> starts,
                          MatchScratch* scratch) const {
  scratch->pixels.Clear();
  const int n = patches_.size;
  for (const DepthStart& start : starts) {
    AddTextured(lens, start.at % n, start.at / n, start.z, &scratch->pixels);
  }
}

/// Adds a pixel if it has texture.
void DepthMatcher::AddTextured(size_t lens, int x, int y, float z, TexturedPixels* p) const {
  const int n = patches_.size, at = y * n + x;
  const float* value = patches_.Value(lens);
  const float gx = (value[at + 1] - value[at - 1]) / 2;
  const float gy = (value[at + n] - value[at - n]) / 2;
  if (std::isnan(value[at]) || std::isnan(gx) || std::isnan(gy)) return;
  const float v = patches_.Attenuation(lens, x, y);
  const float variance = (noise_.read + noise_.shot * std::max(0.f, value[at]) * v) / (v * v);
  if (!(gx * gx + gy * gy > kNoGradient * variance / 2)) return;
  p->x.push_back(static_cast<float>(x));
  p->y.push_back(static_cast<float>(y));
  p->z.push_back(z);
  p->value.push_back(value[at]);
  p->gradient_x.push_back(gx);
  p->gradient_y.push_back(gy);
  p->laplacian.push_back(value[at - 1] + value[at + 1] + value[at - n] + value[at + n] -
                         4 * value[at]);
  p->variance.push_back(variance);
  p->at.push_back(at);
}

PatchBox DepthMatcher::WindowsOf(const TexturedPixels& pixels) const {
  const int n = patches_.size;
  PatchBox box{.left = n, .right = 0, .top = n, .bottom = 0};
  for (const int at : pixels.at) {
    const int x = at % n, y = at / n;
    box = {.left = std::min(box.left, x - 1),
           .right = std::max(box.right, x + 2),
           .top = std::min(box.top, y - 1),
           .bottom = std::max(box.bottom, y + 2)};
  }
  return box;
}

/// Mean differences from the neighbours in the 3 x 3 window of each pixel, for each depth.
void DepthMatcher::MeanDifferences(size_t lens,
                                   ZRange range,
                                   int hypotheses,
                                   MatchScratch* s) const {
  const PatchBox box = WindowsOf(s->pixels);
  const int n = patches_.size, rows = box.bottom - box.top;
  const size_t area = patches_.Area(), first = static_cast<size_t>(box.top) * n;
  s->means.resize(hypotheses * area);
  s->work.resize(2 * area);
  s->cost.resize(area + kBlockTail);
  s->count.resize(area + kBlockTail);
  for (int h = 0; h < hypotheses; ++h) {
    std::fill_n(s->cost.begin() + static_cast<std::ptrdiff_t>(first), rows * n, 0.f);
    std::fill_n(s->count.begin() + static_cast<std::ptrdiff_t>(first), rows * n, 0.f);
    const float z = range.lowest + static_cast<float>(h) * Step();
    for (const LatticeStep& to : search_steps_) {
      const int other = index_.Neighbour(static_cast<int>(lens), to);
      if (other >= 0) AddDifferencesAt(z, lens, other, box, s);
    }
    WindowMeans(n,
                rows,
                s->cost.data() + first,
                s->count.data() + first,
                kWindowPixels,
                s->work.data(),
                s->means.data() + h * area + first);
  }
}

/// Adds the differences between two micro images at one depth to the cost and the count.
void DepthMatcher::AddDifferencesAt(
    float z, size_t lens, size_t other, const PatchBox& box, MatchScratch* s) const {
  const MicroLensArray& array = index_.Array();
  const Eigen::Vector2f baseline =
      (array.lenses[other].centre - array.lenses[lens].centre).cast<float>();
  const Eigen::Vector2f shift =
      (patches_.origin[lens] - patches_.origin[other]).cast<float>() + baseline * (1 - z);
  const Eigen::Vector2i whole = shift.array().floor().cast<int>();
  // The overlap of both patches, without their margins, in the box.
  const int n = patches_.size, low = LensPatches::kMargin, high = n - LensPatches::kMargin;
  const int x0 = std::max({low, low - whole.x(), box.left});
  const int x1 = std::min({high, high - whole.x(), box.right});
  const int y0 = std::max({low, low - whole.y(), box.top});
  const int y1 = std::min({high, high - whole.y(), box.bottom});
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

void DepthMatcher::Search(size_t lens, ZRange range, MatchScratch* s) const {
  TexturedPixels& p = s->pixels;
  if (p.x.empty()) return;
  const size_t area = patches_.Area();
  const float step = Step();
  const int hypotheses = static_cast<int>(std::ceil((range.highest - range.lowest) / step)) + 1;
  MeanDifferences(lens, range, hypotheses, s);
  std::vector<char> keep(p.x.size(), 0);
  s->mean.resize(hypotheses);
  for (size_t i = 0; i < p.x.size(); ++i) {
    for (int h = 0; h < hypotheses; ++h) s->mean[h] = s->means[h * area + p.at[i]];
    const std::optional<float> steps = ClearMinimum(s->mean);
    if (!steps) continue;
    keep[i] = 1;
    p.z[i] = range.lowest + *steps * step;
  }
  p.Keep(keep);
}

void DepthMatcher::Refine(size_t lens, const DepthSurvey& survey, MatchScratch* s) const {
  TexturedPixels& p = s->pixels;
  const float step = Step();
  const std::vector<float> start = p.z;
  const auto iterate = [&](std::span<const LatticeStep> steps) {
    const DepthEquations sums = p.ResetSums();
    for (const LatticeStep& to : steps) {
      const int other = index_.Neighbour(static_cast<int>(lens), to);
      if (other < 0) continue;
      AddEquations(p.View(), Partner(lens, other, survey), sums);
    }
    for (size_t i = 0; i < p.x.size(); ++i) {
      if (!(p.sum_information[i] > 0)) continue;
      p.z[i] += std::clamp(-p.sum_gradient[i] / p.sum_information[i], -step, step);
    }
  };
  iterate(search_steps_);
  // Each step leaves the relative error of the gradient. The search's error is the same for all of
  // a surface at one depth, so the rest of it would not average out.
  iterate(refine_steps_);
  iterate(refine_steps_);
  for (size_t i = 0; i < p.x.size(); ++i) {
    const bool good = p.sum_count[i] >= kFewestPartners &&
                      p.sum_agreement[i] > p.sum_count[i] / 2 &&
                      std::abs(p.z[i] - start[i]) < kLeftMinimum * step &&
                      p.z[i] >= survey.range.lowest && p.z[i] <= survey.range.highest;
    if (!good) p.sum_information[i] = 0;
  }
  Smooth(s);
}

size_t DepthMatcher::TypePair(size_t lens, size_t other) const {
  const MicroLensArray& array = index_.Array();
  return static_cast<size_t>(array.lenses[lens].type) * array.types + array.lenses[other].type;
}

OtherPatch DepthMatcher::Partner(size_t lens, size_t other, const DepthSurvey& survey) const {
  const MicroLensArray& array = index_.Array();
  const Eigen::Vector2f baseline =
      (array.lenses[other].centre - array.lenses[lens].centre).cast<float>();
  const Eigen::Vector2f offset =
      (patches_.origin[lens] - patches_.origin[other]).cast<float>() + baseline;
  const LinearInZ& own = survey.defocus[array.lenses[lens].type];
  const LinearInZ& others = survey.defocus[array.lenses[other].type];
  return {patches_.Value(other),
          patches_.size,
          offset.x(),
          offset.y(),
          baseline.x(),
          baseline.y(),
          {others.offset - own.offset, others.slope - own.slope},
          survey.misfit[TypePair(lens, other)]};
}

/// Weighted means over the window of the depths that agree with the middle one: a blur that the
/// model misses displaces both flanks of an edge in opposite directions.
void DepthMatcher::Smooth(MatchScratch* s) const {
  constexpr int kReach = kDepthWindow / 2;
  TexturedPixels& p = s->pixels;
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
    for (int dy = -kReach; dy <= kReach; ++dy) {
      for (int dx = -kReach; dx <= kReach; ++dx) {
        const int k = s->lookup[p.at[i] + dy * n + dx];
        if (k < 0) continue;
        all += 1;
        const float off = p.z[k] - p.z[i], information = p.sum_information[k];
        if (off * off * information * p.sum_information[i] >
            kSameSurface * kSameSurface * (information + p.sum_information[i])) {
          continue;
        }
        sum += information * p.z[k];
        weights += information;
        count += 1;
      }
    }
    if (count * 2 < all || count < kFewestPartners) continue;
    s->smooth[i] = sum / weights;
    s->smooth_information[i] = weights / count;
  }
  p.z = s->smooth;
  p.sum_information = s->smooth_information;
}

}  // namespace plenocal::internal
