// SPDX-License-Identifier: Apache-2.0
#include "detectors/plenoptic/depth/depth_matcher.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <optional>

#include "detectors/templates/lanes.h"

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

void TexturedPixels::ResetSums() {
  for (auto* v : {&sum_gradient, &sum_information, &sum_agreement, &sum_count}) {
    v->assign(x.size(), 0.f);
  }
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

void CoverWindows(std::span<const int> pixels, int size, std::vector<PatchBlock>* blocks) {
  int left = size, right = 0;
  for (const int at : pixels) {
    left = std::min(left, at % size - 1);
    right = std::max(right, at % size + 2);
  }
  blocks->clear();
  for (int column = left; column < right; column += kLanes) blocks->push_back({column, size, 0});
  for (const int at : pixels) {
    const int x = at % size, y = at / size;
    for (const int side : {x - 1, x + 1}) {
      PatchBlock& block = (*blocks)[(side - left) / kLanes];
      block.top = std::min(block.top, y - 1);
      block.bottom = std::max(block.bottom, y + 2);
    }
  }
  std::erase_if(*blocks, [](const PatchBlock& block) { return block.top >= block.bottom; });
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
  return {1 / pitch - Step(), seen_twice};
}

float DepthMatcher::Step() const {
  return kSearchStep / static_cast<float>(index_.Array().Pitch());
}

void DepthMatcher::Select(size_t lens, MatchScratch* s) const {
  const Eigen::Vector2i& origin = patches_.origin[lens];
  const PatchBox box = patches_.Inside(lens, 0);
  const int n = patches_.size;
  s->textured.resize(n);
  TexturedPixels& p = s->pixels;
  p.at.clear();
  for (int y = box.top; y < box.bottom; ++y) {
    const int first = y * n + box.left, count = box.right - box.left;
    FindTexture(patches_.Value(lens) + first,
                patches_.attenuation.ptr<float>(origin.y() + y) + origin.x() + box.left,
                n,
                count,
                noise_,
                kNoGradient / 2,
                s->textured.data());
    for (int i = 0; i < count; ++i) {
      if (s->textured[i] != 0) p.at.push_back(first + i);
    }
  }
  p.z.assign(p.at.size(), 0.f);
  Describe(lens, &p);
}

void DepthMatcher::Select(size_t lens, std::span<const DepthStart> starts, MatchScratch* s) const {
  TexturedPixels& p = s->pixels;
  p.at.clear();
  p.z.clear();
  for (const DepthStart& start : starts) {
    p.at.push_back(start.at);
    p.z.push_back(start.z);
  }
  Describe(lens, &p);
  std::vector<char> keep(p.at.size());
  for (size_t i = 0; i < keep.size(); ++i) {
    const float gx = p.gradient_x[i], gy = p.gradient_y[i];
    keep[i] = gx * gx + gy * gy > kNoGradient / 2 * p.variance[i] ? 1 : 0;
  }
  p.Keep(keep);
}

void DepthMatcher::Describe(size_t lens, TexturedPixels* p) const {
  const size_t count = p->at.size();
  for (auto* v :
       {&p->x, &p->y, &p->value, &p->gradient_x, &p->gradient_y, &p->laplacian, &p->variance}) {
    v->resize(count);
  }
  const int n = patches_.size;
  for (size_t i = 0; i < count; ++i) {
    const int x = p->at[i] % n, y = p->at[i] / n;
    const float* value = patches_.Value(lens) + p->at[i];
    const float left = value[-1], right = value[1], above = value[-n], below = value[n];
    const float v = patches_.Attenuation(lens, x, y);
    p->x[i] = static_cast<float>(x);
    p->y[i] = static_cast<float>(y);
    p->value[i] = *value;
    p->gradient_x[i] = (right - left) / 2;
    p->gradient_y[i] = (below - above) / 2;
    p->laplacian[i] = left + right + above + below - 4 * *value;
    p->variance[i] = (noise_.read + noise_.shot * std::max(0.f, *value) * v) / (v * v);
  }
}

/// Mean differences from the neighbours in the 3 x 3 window of each pixel, for each depth.
void DepthMatcher::MeanDifferences(size_t lens,
                                   ZRange range,
                                   int hypotheses,
                                   MatchScratch* s) const {
  CoverWindows(s->pixels.at, patches_.size, &s->blocks);
  s->partners.clear();
  for (const LatticeStep& to : search_steps_) {
    const int other = index_.Neighbour(static_cast<int>(lens), to);
    if (other >= 0) s->partners.push_back(Partner(lens, other));
  }
  const int n = patches_.size;
  const size_t area = patches_.Area();
  s->means.resize(hypotheses * area + kBlockTail);
  for (int h = 0; h < hypotheses; ++h) {
    s->cost.assign(area + kBlockTail, 0.f);
    s->count.assign(area + kBlockTail, 0.f);
    const float z = range.lowest + static_cast<float>(h) * Step();
    for (const OtherPatch& other : s->partners) {
      AddDifferences(Shifted(lens, other, z), s->blocks, s->cost.data(), s->count.data());
    }
    WindowMeans(
        s->blocks, n, s->cost.data(), s->count.data(), kWindowPixels, s->means.data() + h * area);
  }
}

OtherPatch DepthMatcher::Partner(size_t lens, size_t other) const {
  const MicroLensArray& array = index_.Array();
  const Eigen::Vector2f baseline =
      (array.lenses[other].centre - array.lenses[lens].centre).cast<float>();
  const Eigen::Vector2f offset =
      (patches_.origin[lens] - patches_.origin[other]).cast<float>() + baseline;
  return {.value = patches_.Value(other),
          .size = patches_.size,
          .offset_x = offset.x(),
          .offset_y = offset.y(),
          .baseline_x = baseline.x(),
          .baseline_y = baseline.y()};
}

ShiftedPatches DepthMatcher::Shifted(size_t lens, const OtherPatch& other, float z) const {
  const float x = other.offset_x - z * other.baseline_x, y = other.offset_y - z * other.baseline_y;
  const int whole_x = static_cast<int>(std::floor(x)), whole_y = static_cast<int>(std::floor(y));
  // The overlap of both patches, without their margins.
  const int n = patches_.size, low = LensPatches::kMargin, high = n - LensPatches::kMargin;
  return {.reference = patches_.Value(lens),
          .other = other.value,
          .stride = n,
          .whole_shift = whole_y * n + whole_x,
          .shift_x = x - static_cast<float>(whole_x),
          .shift_y = y - static_cast<float>(whole_y),
          .overlap = {.left = std::max(low, low - whole_x),
                      .right = std::min(high, high - whole_x),
                      .top = std::max(low, low - whole_y),
                      .bottom = std::min(high, high - whole_y)}};
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
    p.ResetSums();
    for (const LatticeStep& to : steps) {
      const int other = index_.Neighbour(static_cast<int>(lens), to);
      if (other >= 0) AddEquations(Partner(lens, other, survey), &p);
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
  const LinearInZ& own = survey.defocus[array.lenses[lens].type];
  const LinearInZ& others = survey.defocus[array.lenses[other].type];
  OtherPatch partner = Partner(lens, other);
  partner.defocus[0] = others.offset - own.offset;
  partner.defocus[1] = others.slope - own.slope;
  partner.misfit = survey.misfit[TypePair(lens, other)];
  return partner;
}

/// Weighted means over the window of the depths that agree with the middle one: a blur that the
/// model misses displaces both flanks of an edge in opposite directions.
void DepthMatcher::Smooth(MatchScratch* s) const {
  TexturedPixels& p = s->pixels;
  const int n = patches_.size;
  // Rows of windows are read in blocks of eight.
  s->z.resize(patches_.Area() + kBlockTail);
  s->information.assign(patches_.Area() + kBlockTail, 0.f);
  for (size_t i = 0; i < p.x.size(); ++i) {
    s->z[p.at[i]] = p.z[i];
    s->information[p.at[i]] = p.sum_information[i];
  }
  for (size_t i = 0; i < p.x.size(); ++i) {
    if (!(p.sum_information[i] > 0)) continue;
    const int first = p.at[i] - kDepthWindow / 2 * (n + 1);
    const WindowSums sums = SumWindow(
        s->z.data() + first, s->information.data() + first, n, kDepthWindow, kSameSurface);
    const bool confirmed = sums.agreeing * 2 >= sums.all && sums.agreeing >= kFewestPartners;
    p.z[i] = sums.z / sums.information;
    p.sum_information[i] = confirmed ? sums.information / sums.agreeing : 0;
  }
}

}  // namespace plenocal::internal
