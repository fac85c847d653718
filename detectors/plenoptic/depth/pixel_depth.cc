// SPDX-License-Identifier: Apache-2.0
#include "detectors/plenoptic/depth/pixel_depth.h"

#include <algorithm>
#include <cmath>
#include <functional>
#include <span>

#include "calib/base/parallel.h"
#include "detectors/plenoptic/depth/depth_matcher.h"

namespace plenocal::internal {
namespace {

constexpr size_t kLensesPerTask = 32;

/// Removes the displacement near the edge from one micro image, for the depths of its pixels.
void RemoveDisplacement(std::span<const DepthStart> starts,
                        const LinearInZ& vignetting,
                        float usual_z,
                        size_t lens,
                        MatchScratch* s,
                        LensPatches* patches) {
  const int n = patches->size;
  float* value = patches->value.data() + lens * patches->Area();
  s->displaced.assign(value, value + patches->Area());
  s->z.assign(patches->Area(), usual_z);
  for (const DepthStart& start : starts) s->z[start.at] = start.z;
  // At the edge of the image the attenuation's gradient is taken to be zero.
  const PatchBox box = patches->Inside(lens, 1);
  const cv::Mat& attenuation = patches->attenuation;
  for (int y = box.top; y < box.bottom; ++y) {
    const int at = y * n + box.left;
    RemoveDisplacement(s->displaced.data() + at,
                       n,
                       attenuation.ptr<float>(patches->origin[lens].y() + y) +
                           patches->origin[lens].x() + box.left,
                       static_cast<std::ptrdiff_t>(attenuation.step1()),
                       s->z.data() + at,
                       vignetting,
                       box.right - box.left,
                       value + at);
  }
}

/// The depths that a search found.
std::vector<DepthStart> Starts(const TexturedPixels& pixels) {
  std::vector<DepthStart> starts;
  starts.reserve(pixels.x.size());
  for (size_t i = 0; i < pixels.x.size(); ++i) starts.push_back({pixels.at[i], pixels.z[i]});
  return starts;
}

/// The depths that the refinement kept.
LensDepth Results(const TexturedPixels& p, const Eigen::Vector2f& centre) {
  LensDepth depth;
  depth.reserve(static_cast<size_t>(std::count_if(
      p.sum_information.begin(), p.sum_information.end(), [](float i) { return i > 0; })));
  for (size_t i = 0; i < p.x.size(); ++i) {
    if (!(p.sum_information[i] > 0)) continue;
    depth.push_back({p.x[i] - centre.x(), p.y[i] - centre.y(), p.z[i], 1 / p.sum_information[i]});
  }
  return depth;
}

}  // namespace

std::vector<LensDepth> MatchMicroImages(const MicroLensIndex& index,
                                        const SensorNoise& noise,
                                        const DepthSurvey& survey,
                                        int threads,
                                        LensPatches* patches) {
  const DepthMatcher matcher(*patches, index, noise);
  const MicroLensArray& array = index.Array();
  const size_t lenses = array.lenses.size();
  const auto for_each_lens = [&](const std::function<void(size_t, MatchScratch*)>& use) {
    ParallelFor((lenses + kLensesPerTask - 1) / kLensesPerTask, threads, [&](size_t task) {
      MatchScratch scratch;
      const size_t end = std::min(lenses, (task + 1) * kLensesPerTask);
      for (size_t lens = task * kLensesPerTask; lens < end; ++lens) use(lens, &scratch);
    });
  };

  std::vector<std::vector<DepthStart>> starts(lenses);
  for_each_lens([&](size_t lens, MatchScratch* scratch) {
    matcher.Select(lens, scratch);
    const size_t textured = scratch->pixels.x.size();
    if (textured == 0) return;
    matcher.Search(lens, survey.likely, scratch);
    if (scratch->pixels.x.size() < textured / 2) {
      // Perhaps a surface outside of the depths of the survey.
      matcher.Select(lens, scratch);
      matcher.Search(lens, survey.range, scratch);
    }
    starts[lens] = Starts(scratch->pixels);
  });
  const float usual_z = (survey.likely.lowest + survey.likely.highest) / 2;
  for_each_lens([&](size_t lens, MatchScratch* scratch) {
    RemoveDisplacement(
        starts[lens], survey.vignetting[array.lenses[lens].type], usual_z, lens, scratch, patches);
  });
  std::vector<LensDepth> depths(lenses);
  for_each_lens([&](size_t lens, MatchScratch* scratch) {
    if (starts[lens].empty()) return;
    matcher.Select(lens, starts[lens], scratch);
    starts[lens] = {};
    matcher.Refine(lens, survey, scratch);
    depths[lens] = Results(scratch->pixels, patches->centre[lens]);
  });
  return depths;
}

}  // namespace plenocal::internal
