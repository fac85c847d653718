// SPDX-License-Identifier: Apache-2.0
#include "engine/detect_session.h"

#include <fmt/format.h>

#include "calib/base/quoted_text.h"
#include "calib/io/input_file.h"
#include "detectors/detect.h"
#include "engine/recording/frames/session_frames.h"
#include "engine/recording/stores/image_lister.h"
#include "engine/session/session_targets.h"

namespace plenocal {

DetectedSession DetectSession(const Session& session,
                              const SessionOptions& options,
                              const Run& run) {
  const RunScope inputs;
  DetectedSession detected;
  detected.session = session;
  UseOptions(options, &detected.session);
  const SessionTargets targets = ReadSessionTargets(detected.session);
  detected.folders =
      std::make_unique<RunFolders>(options, detected.session, std::vector<std::string>());
  OutputFolder* const out = detected.folders->out();
  detected.observations = CollectObservations(
      detected.session, targets, run, {detected.folders->cache(), options.keep ? out : nullptr});
  if (out != nullptr) WriteDetections(detected.session, detected.observations, options.out, out);
  return detected;
}

void DetectShard(Session session,
                 const SessionOptions& options,
                 const Shard& shard,
                 const Run& run) {
  const RunScope inputs;
  UseOptions(options, &session);
  RefuseSeveralTargets(session, "detect --shard");
  const Target target = ReadTarget(session.target);
  OutputFolder out(options.out);
  DetectionCache cache = OpenDetectionCache(options.cache, session, EarlierDetections::kReuse);
  std::vector<std::string> notes;
  const std::vector<std::vector<FrameImage>> all = ListSessionImages(session, &notes);
  std::string table = "camera,frame,points\n";
  for (size_t c = 0; c < all.size(); ++c) {
    const SessionCamera& camera = session.cameras[c];
    std::vector<FrameImage> images;
    for (size_t i = shard.number - 1; i < all[c].size(); i += shard.count) {
      images.push_back(all[c][i]);
    }
    if (images.empty()) continue;
    const DetectOptions detect{
        .white_images = camera.white_images.empty()
                            ? std::vector<FrameImage>()
                            : ListImages(camera.white_images, camera.name + ": white_images"),
        .bayer = camera.bayer,
        .threads = run.threads,
        .cache = &cache,
        .report =
            [&](const ImageReport& report) {
              table += fmt::format("{},{},{}\n", camera.name, CsvCell(report.frame), report.points);
            },
        .progress =
            [&](size_t done) {
              return run.Progress(camera.name + ": images", done, images.size());
            }};
    if (camera.model->plenoptic) {
      static_cast<void>(DetectImages(images, target, CameraOptics::kPlenoptic, detect));
    } else {
      static_cast<void>(SketchImages(images, target, detect));
    }
  }
  out.Write("shard.csv", table);
  out.Commit();
}

}  // namespace plenocal
