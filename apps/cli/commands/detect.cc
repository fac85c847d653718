// SPDX-License-Identifier: Apache-2.0
#include "detectors/detect.h"

#include <fmt/format.h>

#include <charconv>
#include <memory>

#include "apps/cli/command.h"
#include "apps/cli/options.h"
#include "calib/base/format_error.h"
#include "calib/base/number_text.h"
#include "calib/base/quoted_text.h"
#include "calib/files/detections.h"
#include "calib/io/output_folder.h"
#include "engine/detect_session.h"
#include "engine/observe/session_observations.h"
#include "engine/recording/frames/session_images.h"
#include "engine/recording/stores/image_lister.h"
#include "engine/session/open_session.h"

namespace plenocal {
namespace {

struct DetectArguments : SessionOptions {
  std::filesystem::path session;
  std::string shard;  ///< "1/4"; empty: all images
};

/// Images number i with i % count = number - 1.
struct Shard {
  size_t number = 1, count = 1;
};

Shard ParseShard(const std::string& text) {
  Shard shard;
  const char* const end = text.data() + text.size();
  const auto number = std::from_chars(text.data(), end, shard.number);
  if (number.ec == std::errc() && number.ptr != end && *number.ptr == '/') {
    const auto count = std::from_chars(number.ptr + 1, end, shard.count);
    const bool fits = shard.number >= 1 && shard.number <= shard.count;
    if (count.ec == std::errc() && count.ptr == end && fits) return shard;
  }
  throw InputError("--shard {}: expected K/N, part K of N, such as 1/4", text);
}

/// Detects in every N-th image, for the cache alone, and writes how many points there are.
void RunShard(const DetectArguments& options, const ConsoleOptions& shared) {
  Session session = OpenSession(options.session);
  UseOptions(options, &session);
  RefuseSeveralTargets(session, "detect --shard");
  const Shard shard = ParseShard(options.shard);
  const Target target = ReadTarget(session.target);
  OutputFolder out(options.out);
  Console console(shared);
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
    DetectOptions detect{
        .white_images = camera.white_images.empty()
                            ? std::vector<FrameImage>()
                            : ListImages(camera.white_images, camera.name + ": white_images"),
        .bayer = camera.bayer,
        .threads = shared.threads,
        .cache = &cache,
        .report =
            [&](const ImageReport& report) {
              table += fmt::format("{},{},{}\n", camera.name, CsvCell(report.frame), report.points);
            },
        .progress =
            [&](size_t done) {
              return console.Progress(camera.name + ": images", done, images.size());
            }};
    if (camera.model->plenoptic) {
      static_cast<void>(DetectImages(images, target, CameraOptics::kPlenoptic, detect));
    } else {
      static_cast<void>(SketchImages(images, target, detect));
    }
  }
  out.Write("shard.csv", table);
  out.Commit();
  console.Print(fmt::format("written to {}\n", (options.out / "shard.csv").string()));
}

void RunDetect(const DetectArguments& options, const ConsoleOptions& shared) {
  if (!options.shard.empty()) return RunShard(options, shared);
  Console console(shared);
  const DetectedSession detected =
      DetectSession(OpenSession(options.session), options, console.NewRun());
  detected.folders->Commit();
  for (const CameraInput& camera : detected.observations.cameras) {
    console.Print(fmt::format("{}: {}, {} -> {}\n",
                              camera.name,
                              Counted(camera.views.size(), "frame"),
                              Counted(CountObservations(camera.views), "point"),
                              (options.out / DetectionsName(camera.name)).string()));
  }
}

RunCommand DeclareDetect(CLI::App* app, ConsoleOptions* shared) {
  const auto options = std::make_shared<DetectArguments>();
  AddSessionOptions(app, &options->session, options.get(), shared);
  app->add_option(
         "--shard",
         options->shard,
         "K/N: only part K of N of the images, into --cache alone, from which calibrate takes them: for several machines")
      ->needs("--cache");
  return [options, shared] { RunDetect(*options, *shared); };
}

}  // namespace

Command DetectCommand() {
  return {"detect", "Only find the markers: writes OUT/detections_<camera>.csv.", DeclareDetect};
}

}  // namespace plenocal
