// SPDX-License-Identifier: Apache-2.0
#include "apps/observations.h"

#include <fmt/format.h>

#include "apps/image_module.h"
#include "calib/detections.h"
#include "calib/error.h"

namespace plenocal {
namespace {

size_t CountObservations(const std::vector<View>& views) {
  size_t count = 0;
  for (const View& view : views) count += view.observations.size();
  return count;
}

}  // namespace

SessionObservations CollectObservations(const Session& session,
                                        const Target& target,
                                        const ConsoleOptions& options,
                                        Console* console) {
  // Globs first: a wrong one should not show only after minutes of work on another camera.
  std::vector<std::vector<FrameImage>> images;
  for (const SessionCamera& camera : session.cameras) {
    images.push_back(camera.images.empty()
                         ? std::vector<FrameImage>()
                         : ExpandImages(camera.images, camera.name + ": images"));
  }

  SessionObservations collected;
  for (size_t c = 0; c < session.cameras.size(); ++c) {
    const SessionCamera& camera = session.cameras[c];
    CameraInput input{.name = camera.name,
                      .model = camera.model,
                      .config = camera.config,
                      .initial = camera.initial,
                      .fixed = camera.fixed,
                      .image_size = camera.image_size,
                      .views = {}};
    if (camera.images.empty()) {
      input.views = ReadDetections(camera.detections, *camera.model);
      console->Message(fmt::format("{}: {} frames, {} points from {}",
                                   camera.name,
                                   input.views.size(),
                                   CountObservations(input.views),
                                   camera.detections.string()));
    } else {
      DetectOptions detect{.threads = options.threads, .progress = [&](size_t done) {
                             console->Progress(camera.name + ": images", done, images[c].size());
                             return !Interrupted();
                           }};
      ImageDetections found;
      try {
        found = DetectImagesByModule(images[c], target, detect);
      } catch (const Error& error) {
        throw Error(error.kind(), fmt::format("{}: {}", camera.name, error.what()));
      }
      if (camera.image_size != ImageSize{} && camera.image_size != found.image_size) {
        throw Error(ErrorKind::kInput,
                    fmt::format("{}: the images are {} x {} pixels, but the session's image_size says "
                                "{} x {}",
                                camera.name,
                                found.image_size[0],
                                found.image_size[1],
                                camera.image_size[0],
                                camera.image_size[1]));
      }
      input.image_size = found.image_size;
      input.views = std::move(found.views);
      console->Message(fmt::format("{}: {} images, target found in {}, {} points",
                                   camera.name,
                                   images[c].size(),
                                   input.views.size(),
                                   CountObservations(input.views)));
      for (const LeftOut& item : found.left_out) {
        console->Message(fmt::format("  left out {}: {}", item.where, item.reason));
        collected.left_out.push_back(item);
      }
      if (input.views.empty()) {
        throw Error(ErrorKind::kJob,
                    fmt::format("{}: none of its {} images shows the target; the first: {}: {}",
                                camera.name,
                                images[c].size(),
                                found.left_out[0].where,
                                found.left_out[0].reason));
      }
    }
    collected.cameras.push_back(std::move(input));
  }
  return collected;
}

}  // namespace plenocal
