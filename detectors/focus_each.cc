// SPDX-License-Identifier: Apache-2.0
#include "detectors/focus_each.h"

#include <fmt/format.h>

#include <optional>

#include "calib/error.h"
#include "detectors/image.h"

namespace plenocal {

size_t FocusEach(
    const std::vector<FrameImage>& images,
    const PlenopticCamera& camera,
    const FocusEachOptions& options,
    const std::function<void(const FrameImage& raw, const FocusedView& view, int depth)>& take) {
  std::optional<Error> first;
  size_t taken = 0;
  for (size_t i = 0; i < images.size(); ++i) {
    const FrameImage& raw = images[i];
    if (!options.progress(i)) throw Stopped();
    try {
      cv::Mat image = ReadImage(raw.path);
      const int depth = image.depth();
      FocusedView view;
      try {
        view = Focus(std::move(image), camera, options.focus);
      } catch (const Error& error) {
        throw Error(error.kind(), fmt::format("{}: {}", raw.path.string(), error.what()));
      }
      take(raw, view, depth);
      ++taken;
    } catch (const Error& error) {
      if (images.size() > 1) options.message(fmt::format("  left out {}", error.what()));
      if (!first) first = error;
    }
  }
  if (taken == 0) throw Error(*first);
  return taken;
}

}  // namespace plenocal
