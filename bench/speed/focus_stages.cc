// SPDX-License-Identifier: Apache-2.0
//
// Stages of `plenocal focus` on a raw image of 2048 x 2048 pixels with some 10,000 micro lenses,
// beside cv::StereoSGBM on a pair of that size in the same run: CPU seconds, megapixels per CPU
// second, ratio.
#include <fmt/format.h>

#include <functional>
#include <opencv2/calib3d.hpp>
#include <opencv2/imgproc.hpp>
#include <optional>

#include "bench/speed/usage_seconds.h"
#include "detectors/plenoptic/depth/depth_survey.h"
#include "detectors/plenoptic/depth/image_synthesis.h"
#include "detectors/plenoptic/white/grid_mismatch.h"
#include "tests/detectors/plenoptic/plenoptic_scene.h"

int main() {
  using namespace plenocal;
  using namespace plenocal::internal;
  const PlenopticScene scene{
      .width = 2048, .height = 2048, .pitch = 21, .slope = {3e-4, -2e-4}, .detail = 28};
  const MicroLensArray array = scene.Array();
  const cv::Mat attenuation = scene.Attenuation(array);
  const cv::Mat raw = scene.Raw(array);
  const double megapixels = 1e-6 * static_cast<double>(raw.total());
  fmt::print("{} x {} px, {} micro lenses\n", raw.cols, raw.rows, array.lenses.size());

  const auto time = [&](const char* name, const std::function<void()>& stage) {
    const double start = bench::CpuSeconds();
    stage();
    const double seconds = bench::CpuSeconds() - start;
    fmt::print("{:<24} {:7.3f} s {:8.1f} Mpx/s\n", name, seconds, megapixels / seconds);
    return seconds;
  };
  constexpr double kScale = 2;
  constexpr int kThreads = 0;
  cv::Mat grey;
  std::optional<MicroLensIndex> index;
  LensPatches patches;
  SensorNoise noise;
  DepthSurvey survey;
  std::vector<LensDepth> pixels;
  VirtualDepth depth;
  double all = 0;
  all += time("check of the grid", [&] {
    raw.convertTo(grey, CV_32F);
    if (!GridMismatch(grey, attenuation, array).empty()) fmt::print("refused\n");
  });
  all += time("micro images", [&] {
    index.emplace(array);
    patches = CutPatches(grey, attenuation, array, std::nullopt, kThreads);
    noise = EstimateNoise(patches);
  });
  all += time("survey", [&] { survey = SurveyDepth(patches, *index, noise, kThreads); });
  all += time("depth of the pixels",
              [&] { pixels = MatchMicroImages(*index, noise, survey, kThreads, &patches); });
  all += time("fusion", [&] {
    depth = FuseDepth(std::move(pixels), array, patches.radius_px, kScale, kThreads);
  });
  all += time("focused image",
              [&] { SynthesiseFocusedImage(depth, patches, *index, noise, survey, kThreads); });
  fmt::print("{:<24} {:7.3f} s {:8.1f} Mpx/s\n", "focus", all, megapixels / all);

  cv::Mat left, right, disparity;
  raw.convertTo(left, CV_8U, 1.0 / 256);
  constexpr double kShift = -9;
  cv::warpAffine(left, right, cv::Matx23d(1, 0, kShift, 0, 1, 0), left.size());
  const double sgbm = time("cv::StereoSGBM, 64", [&] {
    cv::StereoSGBM::create(0, 64, 5)->compute(left, right, disparity);
  });
  fmt::print("focus / StereoSGBM: {:.2f}\n", all / sgbm);
}
