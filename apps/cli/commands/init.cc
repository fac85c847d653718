// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>

#include "apps/cli/options.h"
#include "engine/init_session.h"
#include "engine/session/proposal_text.h"

namespace plenocal {
namespace {

size_t CommonFrames(const std::vector<InitCamera>& cameras) {
  return static_cast<size_t>(
      std::ranges::count_if(cameras[0].frames, [&](const std::string& frame) {
        return std::ranges::all_of(
            cameras, [&](const InitCamera& camera) { return camera.frames.contains(frame); });
      }));
}

void PrintFound(const std::vector<InitCamera>& cameras, const TargetProposals& proposals) {
  for (const InitCamera& camera : cameras) {
    fmt::print("{}: {} images, {}{}\n",
               camera.name,
               camera.frames.size(),
               camera.images.size() == 1 ? camera.images[0] : "listed one by one",
               camera.white.empty() ? std::string()
                                    : fmt::format("; {} white images{}",
                                                  camera.white_count,
                                                  camera.plenoptic ? " with micro lenses" : ""));
  }
  if (cameras.size() > 1 && !cameras[0].recorded) {
    fmt::print("{} frames that all cameras have\n", CommonFrames(cameras));
  }
  for (const TargetProposal& proposal : proposals.found) {
    fmt::print("{} in {}\n", proposal.what, OfImages(proposal.images, proposals.looked_at));
  }
  if (proposals.found.empty()) fmt::print("no target found in the images\n");
}

void RunInit(const InitRequest& arguments, Console* console) {
  const FoundSession found = InitSession(arguments, console->NewRun());
  PrintFound(found.cameras, found.proposals);
  std::vector<std::string> open;
  if (found.proposals.found.empty() || found.proposals.found[0].keys.empty()) {
    open.emplace_back("the target");
  } else {
    for (const MeasuredKey& key : found.proposals.found[0].measure) open.push_back(key.name);
  }
  if (std::ranges::any_of(found.cameras, &InitCamera::plenoptic)) open.emplace_back("pixel_size");
  fmt::print("written to {} and {}; state {} there, then\n  plenocal calibrate {} -o OUT\n",
             arguments.session.string(),
             found.target.string(),
             fmt::join(open, ", "),
             arguments.session.string());
}

constexpr const char* kInitHelp =
    "Finds cameras, white images and target in a folder of images or a recording, and writes session and target files to be completed.\n\n"
    "  plenocal init FOLDER -o session.yaml\n"
    "  plenocal init drive.mcap\n\n"
    "Cameras are subfolders, or images of one folder whose names differ as left01.jpg and right01.jpg do; topics of recordings; videos. Images in <camera>_white are white images.";

void DeclareInit(CLI::App* app, InitRequest* arguments, ConsoleOptions* shared) {
  app->add_option("place",
                  arguments->place,
                  "folder with images, in it or below; MCAP file, bag, video, zip archive, or a "
                  "folder of them")
      ->required();
  app->add_option(
         "-o,--out", arguments->session, "the session file; the target file is written beside it")
      ->capture_default_str();
  AddThreadsAndQuiet(app, shared);
}

}  // namespace

Command InitCommand() { return MakeCommand("init", kInitHelp, DeclareInit, RunInit); }

}  // namespace plenocal
