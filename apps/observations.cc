// SPDX-License-Identifier: Apache-2.0
#include "apps/observations.h"

#include <fmt/format.h>

#include <algorithm>

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

std::string DetectionsName(const std::string& camera) {
  return fmt::format("detections_{}.csv", camera);
}

// Whether both are one existing file, by whatever path.
bool IsSameFile(const std::filesystem::path& a, const std::filesystem::path& b) {
  std::error_code error;
  return !a.empty() && std::filesystem::equivalent(a, b, error);
}

}  // namespace

StageStore OpenStageStore(const std::filesystem::path& out, const Session& session, bool fresh) {
  // Detections that are given are not kept again, and hashing the module takes as long as solving a
  // small session.
  const bool detects = std::any_of(
      session.cameras.begin(), session.cameras.end(), [](auto& c) { return !c.images.empty(); });
  const std::string program =
      detects
          ? fmt::format(
                "plenocal {} {} {}", PLENOCAL_VERSION, ImageModuleHash(), HashFile(session.target))
          : std::string();
  return {out / ".cache", program, fresh};
}

SessionObservations CollectObservations(const Session& session,
                                        const Target& target,
                                        const ConsoleOptions& options,
                                        const DetectionPlaces& places,
                                        Console* console) {
  // Globs first: a wrong one should not show only after minutes of work on another camera.
  std::vector<std::vector<FrameImage>> images, white_images;
  for (const SessionCamera& camera : session.cameras) {
    images.push_back(camera.images.empty() ? std::vector<FrameImage>()
                                           : ExpandImages(camera.images, camera.name + ": images"));
    white_images.push_back(camera.white_images.empty()
                               ? std::vector<FrameImage>()
                               : ExpandImages(camera.white_images, camera.name + ": white_images"));
  }

  SessionObservations collected;
  for (size_t c = 0; c < session.cameras.size(); ++c) {
    const SessionCamera& camera = session.cameras[c];
    CameraInput input{.name = camera.name,
                      .model = camera.model,
                      .config = camera.config,
                      .initial = camera.initial,
                      .fixed = camera.fixed,
                      .rules = camera.rules,
                      .image_size = camera.image_size,
                      .views = {}};
    collected.sample_frames.emplace_back();
    if (camera.images.empty()) {
      input.views = ReadDetections(camera.detections, *camera.model);
      if (camera.model->tell_kinds != nullptr) {
        camera.model->tell_kinds(&input.views);
      }
      console->Message(fmt::format("{}: {} frames, {} points from {}",
                                   camera.name,
                                   input.views.size(),
                                   CountObservations(input.views),
                                   camera.detections.string()));
    } else {
      // A model whose points are seen through something looks through micro lenses.
      DetectOptions detect{.plenoptic = !camera.model->context.empty(),
                           .white_images = white_images[c],
                           .bayer = camera.bayer,
                           .threads = options.threads,
                           .store = places.store,
                           .progress = [&](size_t done) {
                             console->Progress(camera.name + ": images", done, images[c].size());
                             return !Interrupted();
                           }};
      if (places.pictures != nullptr) {
        detect.keep = [&](const std::string& name, const std::string& content) {
          places.pictures->Write(fmt::format("images/{}/{}", camera.name, name), content);
        };
      }
      ImageDetections found;
      try {
        found = DetectImagesByModule(images[c], target, detect);
      } catch (const Error& error) {
        throw Error(error.kind(), fmt::format("{}: {}", camera.name, error.what()));
      }
      if (camera.image_size != ImageSize{} && camera.image_size != found.image_size) {
        throw Error(
            ErrorKind::kInput,
            fmt::format("{}: the images are {} x {} pixels, but the session's image_size says "
                        "{} x {}",
                        camera.name,
                        found.image_size[0],
                        found.image_size[1],
                        camera.image_size[0],
                        camera.image_size[1]));
      }
      input.image_size = found.image_size;
      if (!found.micro_lenses.empty()) {
        collected.files.push_back({c,
                                   "micro_lenses",
                                   fmt::format("micro_lenses_{}.csv", camera.name),
                                   std::move(found.micro_lenses)});
      }
      if (!found.vignetting.empty()) {
        collected.files.push_back({c,
                                   "vignetting",
                                   fmt::format("vignetting_{}.tiff", camera.name),
                                   std::move(found.vignetting)});
      }
      if (!found.sample.frame.empty()) {
        collected.sample_frames.back() = found.sample.frame;
        collected.files.push_back({c,
                                   "sample",
                                   fmt::format("sample_{}.jpg", camera.name),
                                   std::move(found.sample.picture)});
      }
      if (!found.sample.depth.empty()) {
        collected.files.push_back({c,
                                   "sample_depth",
                                   fmt::format("virtual_depth_{}.jpg", camera.name),
                                   std::move(found.sample.depth)});
      }
      input.views = std::move(found.views);
      console->Message(fmt::format("{}: {} images, target found in {}, {} points",
                                   camera.name,
                                   images[c].size(),
                                   input.views.size(),
                                   CountObservations(input.views)));
      if (found.reused > 0) {
        console->Message(
            fmt::format("{}: detections of {} images reused", camera.name, found.reused));
      }
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

void RefuseToReplaceInputs(const Session& session,
                           const std::filesystem::path& out,
                           std::vector<std::string> results) {
  for (const SessionCamera& camera : session.cameras)
    results.push_back(DetectionsName(camera.name));
  const auto refuse = [](const std::filesystem::path& input) {
    throw Error(ErrorKind::kInput,
                fmt::format("{}: the results would replace this input; give another folder with -o",
                            input.string()));
  };
  for (const std::string& result : results) {
    for (const auto& input : {session.path, session.target}) {
      if (IsSameFile(input, out / result)) refuse(input);
    }
    for (const SessionCamera& camera : session.cameras) {
      if (IsSameFile(camera.detections, out / result) && result != DetectionsName(camera.name)) {
        refuse(camera.detections);
      }
    }
  }
}

void WriteDetections(const Session& session,
                     const SessionObservations& observations,
                     const std::filesystem::path& folder,
                     OutputFolder* out) {
  const std::vector<CameraInput>& cameras = observations.cameras;
  for (const CameraFile& file : observations.files) out->Write(file.name, file.content);
  for (size_t c = 0; c < cameras.size(); ++c) {
    const std::string name = DetectionsName(cameras[c].name);
    if (IsSameFile(session.cameras[c].detections, folder / name)) continue;
    out->Write(name, DetectionsCsv(cameras[c].views, *cameras[c].model));
  }
}

}  // namespace plenocal
