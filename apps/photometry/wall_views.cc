// SPDX-License-Identifier: Apache-2.0
#include "apps/photometry/wall_views.h"

#include <fmt/format.h>

#include <algorithm>
#include <atomic>
#include <cmath>
#include <iterator>
#include <limits>
#include <opencv2/imgproc.hpp>
#include <optional>

#include "apps/photometry/images/exposed_images.h"
#include "apps/photometry/images/image_spline.h"
#include "calib/base/format_error.h"
#include "calib/base/number_text.h"
#include "calib/base/parallel.h"
#include "detectors/images/detector_pool.h"
#include "detectors/types/marker_detectors.h"
#include "engine/scene/locate_view.h"

namespace plenocal {
namespace {

constexpr double kWantedPixels = 80000;  // of a reduced image
constexpr std::uint8_t kSaturated = 255;

// Brightness of blocks of pixels. Blocks with saturated pixels, or beside them, have none: their
// mean would lack what is cut off.
void SetBrightness(const cv::Mat& grey,
                   const ResponseCurve& response,
                   int reduction,
                   WallView* view) {
  constexpr int kReach = 2;  // px, as far as charge of a full pixel flows
  cv::Mat saturated;
  cv::dilate(grey == kSaturated, saturated, cv::Mat::ones(2 * kReach + 1, 2 * kReach + 1, CV_8U));
  const cv::Size size(grey.cols / reduction, grey.rows / reduction);
  const cv::Rect whole(0, 0, size.width * reduction, size.height * reduction);
  cv::Mat part;
  cv::resize(LightOf(grey, response)(whole), view->light, size, 0, 0, cv::INTER_AREA);
  cv::Mat flagged;
  saturated(whole).convertTo(flagged, CV_32F);
  cv::resize(flagged, part, size, 0, 0, cv::INTER_AREA);
  // Light whose grey values are few has a rounding error that does not average out.
  constexpr size_t kDark = 5;
  const auto least = static_cast<float>(response.Light(kDark));
  view->brightness = MakeImage(size, 1, [&](int x, int y) {
    const float light = view->light.at<float>(y, x);
    return light > least && part.at<float>(y, x) == 0
               ? std::log(light / static_cast<float>(view->exposure))
               : std::numeric_limits<float>::quiet_NaN();
  });
}

// Why an image has no pose.
std::string ExplainNoPose(const cv::Mat& grey, const MarkerDetections& found) {
  constexpr double kMostSaturated = 0.3;  // white paper and the wall around it
  const double share = cv::countNonZero(grey == kSaturated) / static_cast<double>(grey.total());
  if (share > kMostSaturated) {
    return fmt::format("{:.0f} % of its pixels are saturated: expose it shorter", 100 * share);
  }
  return found.failure.empty() ? "the marker gives no pose" : found.failure;
}

void CheckFlat(const Target& target) {
  double size = 0, off = 0;
  for (const auto& [number, position] : target.markers) {
    size = std::max(size, position.head<2>().norm());
    off = std::max(off, std::abs(position.z()));
  }
  constexpr double kFlat = 0.01;  // of the size
  if (off <= kFlat * size) return;
  throw InputError(
      "the target's markers are up to {:.3g} m off its plane z = 0; a wall is "
      "flat: give a target.yaml with the markers that hang on it",
      off);
}

std::array<double, 4> MarkerArea(const Target& target) {
  constexpr double kInfinity = std::numeric_limits<double>::infinity();
  std::array<double, 4> area{kInfinity, kInfinity, -kInfinity, -kInfinity};
  for (const auto& [number, position] : target.markers) {
    area[0] = std::min(area[0], position.x());
    area[1] = std::min(area[1], position.y());
    area[2] = std::max(area[2], position.x());
    area[3] = std::max(area[3], position.y());
  }
  // A tag's white border and the rim of its paper.
  constexpr double kRim = 0.3;
  const double rim = kRim * std::max(area[2] - area[0], area[3] - area[1]);
  return {area[0] - rim, area[1] - rim, area[2] + rim, area[3] + rim};
}

}  // namespace

WallRecording ReadWall(const WallOptions& options) {
  const RecordedCamera& images = *options.images;
  const CalibratedCamera& camera = *options.camera;
  if (images.image_size != camera.image_size) {
    throw InputError(
        "{}: images of camera {} are {} x {} pixels, but the calibration is of "
        "{} x {}",
        options.recording->path.string(),
        images.name,
        images.image_size[0],
        images.image_size[1],
        camera.image_size[0],
        camera.image_size[1]);
  }
  CheckFlat(*options.target);
  WallRecording wall;
  wall.camera = &camera;
  wall.response = options.response;
  wall.marker = MarkerArea(*options.target);
  const double pixels = static_cast<double>(images.image_size[0]) * images.image_size[1];
  wall.reduction = std::max(1, static_cast<int>(std::lround(std::sqrt(pixels / kWantedPixels))));
  wall.exposures_known = std::ranges::all_of(
      images.images, [](const RecordedImage& image) { return image.exposure.has_value(); });

  const size_t count = images.images.size();
  std::vector<std::optional<WallView>> views(count);
  std::vector<std::string> reasons(count);
  DetectorPool detectors([&] { return MakeMarkerDetector(*options.target); });
  std::atomic<size_t> done = 0;
  ParallelFor(count, options.threads, [&](size_t i) {
    const RecordedImage& image = images.images[i];
    try {
      const cv::Mat grey = ReadExposed(images, i);
      const MarkerDetections found = detectors.Detect(grey);
      const std::optional<LocatedView> located = LocateView(
          camera, {image.frame, found.markers}, options.target->markers, Numbering::kByMarker);
      if (located) {
        WallView view{.frame = image.frame,
                      .exposure = wall.exposures_known ? *image.exposure : 1,
                      .T_camera_wall = located->T_map_camera.Inverse(),
                      .brightness = {},
                      .light = {}};
        SetBrightness(grey, wall.response, wall.reduction, &view);
        views[i] = std::move(view);
      } else {
        reasons[i] = ExplainNoPose(grey, found);
      }
    } catch (const Error& error) {
      if (error.kind() != ErrorKind::kInput) throw;
      reasons[i] = error.what();
    }
    if (!options.progress(++done, count)) throw Stopped();
  });
  for (size_t i = 0; i < count; ++i) {
    if (views[i]) {
      wall.views.push_back(std::move(*views[i]));
    } else {
      wall.left_out.push_back({.where = images.images[i].path.string(),
                               .reason = reasons[i],
                               .whole = true,
                               .camera = images.name,
                               .frame = images.images[i].frame});
    }
  }
  constexpr size_t kFewest = 10;
  if (wall.views.size() < kFewest) {
    throw JobError(
        "{}: camera {}: the marker was found in {} of {}{}; the wall must show the "
        "target of --target in every image, sharp and whole: at least {} images",
        options.recording->path.string(),
        images.name,
        wall.views.size(),
        Counted(count, "image"),
        wall.left_out.empty() ? "" : fmt::format(" (first failure: {})", wall.left_out[0].reason),
        kFewest);
  }
  std::ranges::move(LeftOutOf(*options.recording, images), std::back_inserter(wall.left_out));
  return wall;
}

}  // namespace plenocal
