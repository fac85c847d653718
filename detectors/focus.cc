// SPDX-License-Identifier: Apache-2.0
#include "detectors/focus.h"

#include <fmt/format.h>

#include <opencv2/imgproc.hpp>

#include "calib/error.h"
#include "detectors/focused_image.h"
#include "detectors/raw_check.h"

namespace plenocal {

cv::Mat GreyOf(const cv::Mat& raw) {
  cv::Mat grey = raw;
  if (raw.channels() != 1) cv::cvtColor(raw, grey, cv::COLOR_BGR2GRAY);
  cv::Mat exact;
  grey.convertTo(exact, CV_32F);
  return exact;
}

FocusedView Focus(cv::Mat raw, const PlenopticCamera& camera, const FocusOptions& options) {
  using namespace internal;
  if (raw.size() != camera.attenuation.size()) {
    throw Error(
        ErrorKind::kInput,
        fmt::format(
            "is {} x {} pixels, but the white images or the vignetting file are {} x {}; use those "
            "of this camera",
            raw.cols,
            raw.rows,
            camera.attenuation.cols,
            camera.attenuation.rows));
  }
  if (camera.bayer && raw.channels() != 1) {
    throw Error(ErrorKind::kInput,
                "has colours already, so it is no raw mosaic; leave --bayer out");
  }
  cv::Mat grey = GreyOf(raw);
  raw.release();
  const std::string wrong = WhyNotOfThisGrid(grey, camera.attenuation, camera.array);
  if (!wrong.empty()) throw Error(ErrorKind::kJob, wrong);

  const int threads = options.threads;
  const MicroLensArray& array = camera.array;
  const MicroLensIndex index(array);
  FocusedView view;
  view.patches = CutPatches(grey, camera.attenuation, array, camera.bayer, threads);
  grey.release();  // the patches have all that is needed of it
  view.noise = EstimateNoise(view.patches);
  const LensPatches& patches = view.patches;
  const SensorNoise& noise = view.noise;
  const DepthSurvey survey = SurveyDepth(patches, array, index, noise, threads);
  view.keplerian = survey.range.highest < 0;
  view.depth = FuseDepth(MatchMicroImages(array, index, noise, survey, threads, &view.patches),
                         array,
                         patches.radius_px,
                         options.scale,
                         threads);
  if (cv::countNonZero(view.depth.known) == 0) {
    throw Error(ErrorKind::kJob,
                "has no detail that several micro images show, so no depth can be found; light the "
                "scene or focus the "
                "main lens");
  }
  const auto synthesise = [&] {
    return SynthesiseFocused(view.depth, patches, array, index, noise, survey, threads);
  };
  view.image = synthesise();
  if (options.find_flat_parts) {
    view.flat_parts = FlattenParts(options.find_flat_parts(view.image), &view.depth);
    if (view.flat_parts > 0) view.image = synthesise();
  }
  return view;
}

}  // namespace plenocal
