// SPDX-License-Identifier: Apache-2.0
//
// Matching of one micro image with its neighbours: an exhaustive search in whole steps of inverse
// virtual depth, then Gauss-Newton steps on all pixels with texture.
#pragma once

#include <span>
#include <vector>

#include "detectors/plenoptic/depth/depth_kernels.h"
#include "detectors/plenoptic/depth/depth_properties.h"
#include "detectors/plenoptic/depth/lens_patches.h"
#include "detectors/plenoptic/depth/micro_lens_index.h"

namespace plenocal::internal {

/// A squared gradient below this many times its variance is noise: the chi-square of two degrees of
/// freedom that noise exceeds in one of 10,000 pixels.
inline constexpr float kNoGradient = 18.42f;

/// Working memory of one thread.
struct MatchScratch {
  TexturedPixels pixels;
  std::vector<PatchBlock> blocks;  // of the windows of the pixels
  std::vector<OtherPatch> partners;
  std::vector<float> cost, count;     // patch
  std::vector<float> means;           // hypotheses x patch: mean difference in a window
  std::vector<float> mean;            // hypotheses: those of one pixel
  std::vector<int> textured;          // a row: 1 where there is texture
  std::vector<float> displaced;       // patch
  std::vector<float> z, information;  // patch: those of the pixels, information 0 for all others
};

/// A pixel whose depth a search found.
struct DepthStart {
  int at;  // in the patch
  float z;
};

/// Blocks that hold the 3 x 3 windows of `pixels`, their places in a patch with rows of `size`: all
/// that a search has to compute. None is empty.
void CoverWindows(std::span<const int> pixels, int size, std::vector<PatchBlock>* blocks);

class DepthMatcher {
 public:
  /// Keeps references to all of them.
  DepthMatcher(const LensPatches& patches, const MicroLensIndex& index, const SensorNoise& noise);

  /// Whole range of |z|: from one pixel of parallax between neighbours, and a step of the search
  /// below, to where a point is seen by two micro images on average.
  [[nodiscard]] ZRange Magnitudes() const;
  /// Step of the search in z.
  [[nodiscard]] float Step() const;

  /// Collects the pixels with texture.
  void Select(size_t lens, MatchScratch* scratch) const;
  /// Collects those of `starts` that have texture, at their depths.
  void Select(size_t lens, std::span<const DepthStart> starts, MatchScratch* scratch) const;
  /// Sets each pixel to the depth whose 3 x 3 window has the least mean difference. Drops pixels
  /// whose best depth is not clearly better than all depths that are not next to it.
  void Search(size_t lens, ZRange range, MatchScratch* scratch) const;
  /// Gauss-Newton steps, shortest baselines first. Sets the information to zero for pixels that
  /// leave their initial depth, agree with less than half of their partners or have fewer than two.
  void Refine(size_t lens, const DepthSurvey& survey, MatchScratch* scratch) const;

  [[nodiscard]] const LensPatches& Patches() const { return patches_; }
  [[nodiscard]] const MicroLensIndex& Index() const { return index_; }
  /// Baselines of the refinement.
  [[nodiscard]] std::span<const LatticeStep> RefineSteps() const { return refine_steps_; }
  /// Micro image `other` as a partner of `lens`.
  [[nodiscard]] OtherPatch Partner(size_t lens, size_t other, const DepthSurvey& survey) const;
  /// Place of the two lens types in `DepthSurvey::misfit`.
  [[nodiscard]] size_t TypePair(size_t lens, size_t other) const;

 private:
  /// Sets all but the depths of the pixels at `pixels->at`.
  void Describe(size_t lens, TexturedPixels* pixels) const;
  /// The same without defocus and misfit.
  [[nodiscard]] OtherPatch Partner(size_t lens, size_t other) const;
  [[nodiscard]] ShiftedPatches Shifted(size_t lens, const OtherPatch& other, float z) const;
  void MeanDifferences(size_t lens, ZRange range, int hypotheses, MatchScratch* scratch) const;
  void Smooth(MatchScratch* scratch) const;

  const LensPatches& patches_;
  const MicroLensIndex& index_;
  const SensorNoise& noise_;
  std::vector<LatticeStep> search_steps_, refine_steps_;
};

}  // namespace plenocal::internal
