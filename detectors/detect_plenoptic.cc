// SPDX-License-Identifier: Apache-2.0
#include "detectors/detect_plenoptic.h"

#include <fmt/format.h>

#include <memory>
#include <utility>

#include "calib/error.h"
#include "detectors/focus.h"
#include "detectors/focused_markers.h"
#include "detectors/image.h"
#include "detectors/marker_looks.h"
#include "detectors/micro_image_markers.h"
#include "detectors/white_measurement.h"

namespace plenocal {
namespace {

struct RawDetections {
  internal::MicroView markers;
  std::vector<std::string> left_out;
  std::string failure;
};

/// The markers of one raw image, measured in its micro images.
RawDetections DetectInRaw(cv::Mat raw,
                          const Target& target,
                          const internal::FocusedMarkers& markers,
                          const PlenopticCamera& camera,
                          int threads) {
  FocusOptions focus{.threads = threads, .find_flat_parts = {}};
  focus.find_flat_parts = [&](const cv::Mat& image) { return markers.FlatParts(image); };
  const FocusedView view = Focus(std::move(raw), camera, focus);
  const MarkerDetections found = markers.Detect(view.image);
  std::vector<internal::MarkerLook> looks = internal::LooksOf(target, found.markers);
  // From pixels of the focused image to raw pixels.
  const double scale = view.depth.scale;
  for (internal::MarkerLook& look : looks) {
    look.place *= scale;
    look.cells_by_image.leftCols<2>() /= scale;
  }
  RawDetections result{.markers = internal::MeasureInMicroImages(
                           looks, view.depth, view.patches, camera.array, view.noise, threads),
                       .left_out = found.left_out,
                       .failure = found.failure};
  if (result.markers.empty() && result.failure.empty()) {
    result.failure = "the target is in the focused image, but no micro image shows a marker well";
  }
  return result;
}

}  // namespace

ImageDetections DetectPlenopticImages(const std::vector<FrameImage>& images,
                                      const Target& target,
                                      const DetectOptions& options) {
  if (options.white_images.empty()) {
    throw Error(ErrorKind::kInput,
                "a plenoptic camera needs white_images: the micro-image centres come from them");
  }
  if (std::holds_alternative<CirclesLayout>(target.layout)) {
    throw Error(ErrorKind::kInput,
                "circle grids cannot be measured in micro images; use tags, a chessboard or a "
                "ChArUco board");
  }
  internal::WhiteMeasurement white = internal::MeasureWhite(options.white_images,
                                                            {.plenoptic = true,
                                                             .bayer = options.bayer,
                                                             .grid_file = std::nullopt,
                                                             .raw_image = {},
                                                             .threads = options.threads});
  const PlenopticCamera camera{white.camera.grid->array, white.attenuation, options.bayer};
  ImageDetections detections;
  detections.image_size = white.camera.image_size;
  detections.left_out = std::move(white.camera.left_out);
  detections.micro_lenses = FormatMicroLenses(camera.array);
  detections.vignetting = EncodeImage(".tiff", white.attenuation);

  const internal::FocusedMarkers markers(target);
  std::vector<std::string> frames;
  std::vector<internal::MicroView> views;
  for (size_t i = 0; i < images.size(); ++i) {
    const std::string path = images[i].path.string();
    try {
      RawDetections found =
          DetectInRaw(ReadImage(images[i].path), target, markers, camera, options.threads);
      for (const std::string& reason : found.left_out)
        detections.left_out.push_back({path, reason});
      if (found.markers.empty()) {
        detections.left_out.push_back({path, found.failure});
      } else {
        frames.push_back(images[i].frame);
        views.push_back(std::move(found.markers));
      }
    } catch (const Error& error) {
      detections.left_out.push_back({path, WithoutPath(error.what(), path)});
    }
    if (options.progress && !options.progress(i + 1)) throw Stopped();
  }
  internal::RemoveDefocusShifts(camera.array.types, &views);
  for (size_t i = 0; i < views.size(); ++i) {
    View view{frames[i], {}};
    for (const internal::MicroObservation& o : views[i]) view.observations.push_back(o.seen);
    detections.views.push_back(std::move(view));
  }
  return detections;
}

}  // namespace plenocal
