// SPDX-License-Identifier: Apache-2.0
#include "detectors/plenoptic/depth/depth_survey.h"

#include <Eigen/Dense>
#include <algorithm>
#include <array>
#include <cmath>
#include <vector>

#include "calib/base/linear_algebra.h"
#include "calib/base/parallel.h"
#include "calib/base/robust.h"
#include "calib/base/statistics.h"
#include "detectors/plenoptic/depth/depth_matcher.h"

namespace plenocal::internal {
namespace {

/// Unknowns of a survey: defocus offset and slope, vignetting offset and slope of each lens type.
constexpr int kPerType = 4;
/// Fixed, so that the vectors of single pixels stay on the stack.
constexpr int kMostUnknowns = kMostLensTypes * kPerType;
using SurveyVector = Eigen::Matrix<double, Eigen::Dynamic, 1, 0, kMostUnknowns, 1>;

/// Noise of a Laplacian v_left + v_right + v_above + v_below - 4 v: of the middle pixel's value in
/// it, and its variance over that of a pixel.
constexpr double kMiddleOfLaplacian = 4, kLaplacianPower = 20;
/// Median of a chi-square of one degree of freedom.
constexpr float kMedianChiSquare = 0.4549f;

/// One comparison of a survey: the difference of the two micro images is
/// e = f Laplacian + k grad I . grad ln V, of the other micro image less the own, + slope dz.
struct Comparison {
  int own_type, other_type;
  float z, laplacian;
  float own_vignetting, other_vignetting;  // grad I . grad ln V
  float slope;
  float error, weight;
  float variance;  // noise of one grey value
};

/// Normal equations of a survey.
struct SurveyEquations {
  explicit SurveyEquations(int types)
      : normal(Eigen::MatrixXd::Zero(kPerType * types, kPerType * types)),
        right(Eigen::VectorXd::Zero(kPerType * types)) {}

  Eigen::MatrixXd normal;
  Eigen::VectorXd right;
};

/// What the depth of one pixel, which is an unknown too, has in the normal equations.
class PixelSums {
 public:
  explicit PixelSums(int types) : coupling_(SurveyVector::Zero(kPerType * types)) {}

  /// Adds a comparison here and to the equations of all pixels. The noise of the middle pixel is in
  /// the error and in the Laplacian; its expectation is taken off both sides of the equations.
  void Add(const Comparison& c, SurveyEquations* equations) {
    const double w = c.weight;
    const int own = kPerType * c.own_type, other = kPerType * c.other_type;
    const std::array<int, 8> at{
        other, other + 1, other + 2, other + 3, own, own + 1, own + 2, own + 3};
    const double f = c.laplacian, in = c.other_vignetting, out = -c.own_vignetting, z = c.z;
    const std::array<double, 8> factor{f, f * z, in, in * z, -f, -f * z, out, out * z};
    // Change with the Laplacian; between lenses of one type it cancels.
    const double by = own == other ? 0 : 1;
    const std::array<double, 8> noisy{by, by * z, 0, 0, -by, -by * z, 0, 0};
    const double noise = w * c.variance;
    for (size_t i = 0; i < at.size(); ++i) {
      equations->right[at[i]] += w * c.error * factor[i] - kMiddleOfLaplacian * noise * noisy[i];
      coupling_[at[i]] += w * c.slope * factor[i];
      for (size_t j = 0; j < at.size(); ++j) {
        equations->normal(at[i], at[j]) +=
            w * factor[i] * factor[j] - kLaplacianPower * noise * noisy[i] * noisy[j];
      }
    }
    depth_ += w * c.slope * c.slope;
    depth_right_ += w * c.slope * c.error;
  }

  /// Eliminates the pixel's depth.
  void Eliminate(SurveyEquations* equations) const {
    if (!(depth_ > 0)) return;
    equations->normal -= coupling_.lazyProduct(coupling_.transpose() / depth_);
    equations->right -= coupling_ * (depth_right_ / depth_);
  }

 private:
  SurveyVector coupling_;
  double depth_ = 0, depth_right_ = 0;
};

/// Sums over the comparisons of a survey.
struct SurveySums {
  explicit SurveySums(int lens_types)
      : types(lens_types),
        equations(lens_types),
        misfits(static_cast<size_t>(lens_types) * lens_types) {}

  void Add(const SurveySums& part) {
    equations.normal += part.equations.normal;
    equations.right += part.equations.right;
    depths.insert(depths.end(), part.depths.begin(), part.depths.end());
    for (size_t pair = 0; pair < misfits.size(); ++pair) {
      misfits[pair].insert(
          misfits[pair].end(), part.misfits[pair].begin(), part.misfits[pair].end());
    }
  }

  /// Updates the survey by the solution. A prior of one px^2 decides what the comparisons do not
  /// determine, such as a defocus that all types share.
  void Apply(DepthSurvey* survey) const {
    constexpr double kPriorPrecision = 1;  // px^-4
    Eigen::MatrixXd sum = equations.normal;
    sum.diagonal().array() += kPriorPrecision;
    const Eigen::VectorXd step = SolveSymmetric(sum, equations.right);
    for (int type = 0; type < types; ++type) {
      const auto own = step.segment<kPerType>(kPerType * type);
      survey->defocus[type].offset += static_cast<float>(own[0]);
      survey->defocus[type].slope += static_cast<float>(own[1]);
      survey->vignetting[type].offset += static_cast<float>(own[2]);
      survey->vignetting[type].slope += static_cast<float>(own[3]);
    }
    for (size_t pair = 0; pair < misfits.size(); ++pair) {
      const std::vector<float>& values = misfits[pair];
      if (values.empty()) continue;
      survey->misfit[pair] = std::max(0.f, Median(values) / kMedianChiSquare);
    }
  }

  int types;
  SurveyEquations equations;
  std::vector<std::vector<float>> misfits;
  std::vector<float> depths;  // z of all pixels that matched
};

/// grad I . grad ln V at (x, y) in the patch of a micro lens, for the gradient of pixel i.
float Vignetting(
    const LensPatches& patches, const TexturedPixels& p, size_t i, size_t lens, float x, float y) {
  return patches
      .LogAttenuationGradient(
          lens, static_cast<int>(std::lround(x)), static_cast<int>(std::lround(y)))
      .dot(Eigen::Vector2f(p.gradient_x[i], p.gradient_y[i]));
}

/// Comparisons of one micro image with its neighbours at the depths of its pixels.
class LensComparison {
 public:
  LensComparison(const DepthMatcher& matcher,
                 const DepthSurvey& survey,
                 size_t lens,
                 TexturedPixels* pixels)
      : matcher_(matcher),
        survey_(survey),
        without_misfit_(survey),
        lens_(lens),
        pixels_(pixels),
        information_(pixels->sum_information),
        sums_(pixels->x.size(), PixelSums(matcher.Index().Array().types)) {
    std::fill(without_misfit_.misfit.begin(), without_misfit_.misfit.end(), 0.f);
    const TexturedPixels& p = *pixels_;
    own_vignetting_.resize(p.x.size());
    for (size_t i = 0; i < p.x.size(); ++i) {
      own_vignetting_[i] = Vignetting(matcher.Patches(), p, i, lens, p.x[i], p.y[i]);
    }
  }

  /// Adds the comparisons with all neighbours.
  void AddTo(SurveySums* sums) {
    for (const LatticeStep& to : matcher_.RefineSteps()) {
      const int other = matcher_.Index().Neighbour(static_cast<int>(lens_), to);
      if (other >= 0) Compare(other, sums);
    }
    for (const PixelSums& pixel : sums_) pixel.Eliminate(&sums->equations);
    pixels_->sum_information = information_;
  }

 private:
  void Compare(size_t other, SurveySums* sums) {
    TexturedPixels& p = *pixels_;
    const MicroLensArray& array = matcher_.Index().Array();
    const int type = array.lenses[lens_].type, other_type = array.lenses[other].type;
    const size_t pair = matcher_.TypePair(lens_, other);
    const OtherPatch patch = matcher_.Partner(lens_, other, without_misfit_);
    p.ResetSums();
    AddEquations(patch, &p);
    const float length = std::hypot(patch.baseline_x, patch.baseline_y);
    for (size_t i = 0; i < p.x.size(); ++i) {
      const float slope =
          -(patch.baseline_x * p.gradient_x[i] + patch.baseline_y * p.gradient_y[i]);
      if (information_[i] <= 0 || p.sum_count[i] == 0 || slope == 0) continue;
      const float z = p.z[i];
      const float other_vignetting = Vignetting(matcher_.Patches(),
                                                p,
                                                i,
                                                other,
                                                p.x[i] + patch.offset_x - patch.baseline_x * z,
                                                p.y[i] + patch.offset_y - patch.baseline_y * z);
      // Back from the sums of a single comparison: gradient = w J e, agreement = w * variance.
      const float variance = 2 * p.variance[i];
      const float error = p.sum_gradient[i] * variance / (p.sum_agreement[i] * slope) -
                          survey_.vignetting[other_type].At(z) * other_vignetting +
                          survey_.vignetting[type].At(z) * own_vignetting_[i];
      const float along = slope * slope / (length * length);
      const float expected = variance + survey_.misfit[pair] * along;
      sums_[i].Add({.own_type = type,
                    .other_type = other_type,
                    .z = z,
                    .laplacian = p.laplacian[i],
                    .own_vignetting = own_vignetting_[i],
                    .other_vignetting = other_vignetting,
                    .slope = slope,
                    .error = error,
                    .weight = 1 / (expected + error * error / kCauchyWidthSquared<float>),
                    .variance = p.variance[i]},
                   &sums->equations);
      if (along < kNoGradient * p.variance[i]) continue;
      sums->misfits[pair].push_back((error * error - variance) / along);
    }
  }

  const DepthMatcher& matcher_;
  const DepthSurvey& survey_;
  DepthSurvey without_misfit_;
  size_t lens_;
  TexturedPixels* pixels_;
  std::vector<float> information_;
  std::vector<PixelSums> sums_;
  std::vector<float> own_vignetting_;
};

/// Range of nearly all depths, half as much again on either side and at least a few steps of the
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

/// Matches the micro images of the sample and sums their comparisons.
SurveySums MatchSample(const DepthMatcher& matcher, const DepthSurvey& survey, int threads) {
  constexpr size_t kSample = 400;  // micro images: some ten thousand pixels with texture
  const MicroLensArray& array = matcher.Index().Array();
  const size_t stride = std::max<size_t>(1, array.lenses.size() / kSample);
  std::vector<SurveySums> parts(array.lenses.size() / stride, SurveySums(array.types));
  ParallelFor(parts.size(), threads, [&](size_t task) {
    const size_t lens = task * stride;
    MatchScratch scratch;
    SurveySums& own = parts[task];
    matcher.Select(lens, &scratch);
    matcher.Search(lens, survey.likely, &scratch);
    matcher.Refine(lens, survey, &scratch);
    for (size_t i = 0; i < scratch.pixels.z.size(); ++i) {
      if (scratch.pixels.sum_information[i] > 0) own.depths.push_back(scratch.pixels.z[i]);
    }
    LensComparison(matcher, survey, lens, &scratch.pixels).AddTo(&own);
  });
  // In a fixed order: sums are rounded, and the order of threads differs from run to run.
  SurveySums sums(array.types);
  for (const SurveySums& part : parts) sums.Add(part);
  return sums;
}

}  // namespace

DepthSurvey SurveyDepth(const LensPatches& patches,
                        const MicroLensIndex& index,
                        const SensorNoise& noise,
                        int threads) {
  // Before anything is known: matches are right to within rounding to whole pixels, px^2.
  constexpr float kRounding = 1.f / 12;
  const DepthMatcher matcher(patches, index, noise);
  const size_t types = static_cast<size_t>(index.Array().types);
  const ZRange magnitudes = matcher.Magnitudes();
  DepthSurvey galilean{.range = magnitudes,
                       .likely = magnitudes,
                       .defocus = std::vector<LinearInZ>(types),
                       .vignetting = std::vector<LinearInZ>(types),
                       .misfit = std::vector(types * types, kRounding)};
  DepthSurvey keplerian = galilean;
  keplerian.range = {-magnitudes.highest, -magnitudes.lowest};
  keplerian.likely = keplerian.range;
  const SurveySums as_galilean = MatchSample(matcher, galilean, threads);
  const SurveySums as_keplerian = MatchSample(matcher, keplerian, threads);
  const bool is_galilean = as_galilean.depths.size() >= as_keplerian.depths.size();
  const SurveySums& first = is_galilean ? as_galilean : as_keplerian;
  DepthSurvey survey = is_galilean ? galilean : keplerian;
  first.Apply(&survey);
  // Again with these properties.
  survey.likely = LikelyRange(first.depths, survey.range, matcher.Step());
  const SurveySums again = MatchSample(matcher, survey, threads);
  again.Apply(&survey);
  survey.likely = LikelyRange(again.depths, survey.range, matcher.Step());
  return survey;
}

}  // namespace plenocal::internal
