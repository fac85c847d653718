// SPDX-License-Identifier: Apache-2.0
#include "engine/init_session.h"

#include <fmt/format.h>

#include <algorithm>

#include "calib/base/format_error.h"
#include "calib/base/quoted_text.h"
#include "calib/files/frame_images.h"
#include "calib/io/input_file.h"
#include "calib/io/output_folder.h"
#include "detectors/plenoptic/white/white_camera.h"
#include "engine/recording/image_names.h"
#include "engine/recording/layouts.h"
#include "engine/recording/stores/image_lister.h"
#include "engine/session/proposal_text.h"

namespace plenocal {
namespace {

namespace fs = std::filesystem;

// White images of a plenoptic camera show the lattice of its micro images.
bool ShowsMicroLenses(const FoundCamera& camera, int threads) {
  if (camera.white.empty()) return false;
  std::vector<FrameImage> images = ExpandImages(camera.white, camera.name + ": white images");
  images.resize(1);
  try {
    return MeasureWhiteImages(images, {.plenoptic = true, .threads = threads}).grid.has_value();
  } catch (const Error&) {
    return false;
  }
}

// Recordings, videos and archives: the place itself, or those in a folder.
std::vector<fs::path> StoresIn(const fs::path& place) {
  if (!SplitStorePattern(place).file.empty()) return {place};
  std::vector<fs::path> stores;
  std::error_code error;
  for (const auto& entry : fs::directory_iterator(place, error)) {
    if (!SplitStorePattern(entry.path()).file.empty()) stores.push_back(entry.path());
  }
  std::ranges::sort(stores);
  return stores;
}

// Their cameras. One that several of them have is one camera.
std::vector<InitCamera> RecordedCameras(const std::vector<fs::path>& stores) {
  std::vector<InitCamera> cameras;
  for (const fs::path& store : stores) {
    for (const RecordedFiles& found : FindRecordingFile(store).cameras) {
      auto camera = std::ranges::find(cameras, found.name, &InitCamera::name);
      if (camera == cameras.end()) {
        camera = cameras.insert(camera, InitCamera());
        camera->name = found.name;
        camera->recorded = true;
      }
      camera->images.insert(camera->images.end(), found.images.begin(), found.images.end());
    }
  }
  for (InitCamera& camera : cameras) {
    for (const FrameImage& image : ListImages(camera.images, camera.name)) {
      camera.frames.insert(image.frame);
    }
  }
  return cameras;
}

// Gives cameras of a rig globs by which they share frames, where their names allow it.
void NameFrames(std::vector<InitCamera>* cameras, const Run& run) {
  std::vector<std::string> names;
  std::vector<std::vector<std::string>> images;
  for (const InitCamera& camera : *cameras) {
    names.push_back(camera.name);
    images.push_back(camera.images);
  }
  try {
    ShareFrames(names, &images);
  } catch (const Error& error) {
    run.Message(error.what());
  }
  for (size_t c = 0; c < cameras->size(); ++c) {
    InitCamera& camera = (*cameras)[c];
    camera.images = images[c];
    for (const FrameImage& image : ExpandImages(camera.images, camera.name)) {
      camera.frames.insert(image.frame);
    }
  }
}

std::vector<InitCamera> CamerasOf(const InitRequest& request, const Run& run) {
  const fs::path& place = request.place;
  if (!fs::exists(place)) {
    throw InputError("{}: no such folder or recording; check the path", place.string());
  }
  const std::vector<fs::path> stores = StoresIn(place);
  if (!fs::is_directory(place) && stores.empty()) {
    throw InputError("{}: is no folder, recording, video or archive of images", place.string());
  }
  std::vector<InitCamera> cameras;
  std::vector<FoundCamera> in_folder;
  try {
    if (stores != std::vector{place}) in_folder = FindCameras(place);
  } catch (const Error&) {
    if (stores.empty()) throw;
  }
  if (in_folder.empty()) return RecordedCameras(stores);
  for (const FoundCamera& found : in_folder) {
    InitCamera& camera = cameras.emplace_back();
    static_cast<FoundCamera&>(camera) = found;
    if (!found.white.empty()) run.Progress(found.name + ": white images");
    camera.plenoptic = ShowsMicroLenses(found, run.threads);
    if (run.stop.stop_requested()) throw Stopped();
  }
  NameFrames(&cameras, run);
  return cameras;
}

TargetProposals LookAtAll(const std::vector<InitCamera>& cameras, const Run& run) {
  std::vector<FrameImage> images;
  for (const InitCamera& camera : cameras) {
    if (camera.plenoptic) continue;  // its raw images show a target in pieces
    const auto found = ListImages(camera.images, camera.name + ": images");
    images.insert(images.end(), found.begin(), found.end());
  }
  return images.empty() ? TargetProposals() : LookForTargets(images, run);
}

std::string SessionText(const std::vector<InitCamera>& cameras,
                        const std::filesystem::path& folder,
                        const std::string& target) {
  std::string text = fmt::format(
      "# What to calibrate, found by 'plenocal init'. All keys: docs/formats.md\n"
      "plenocal: 1\ntarget: {}\ncameras:{}\n",
      target,
      cameras.size() > 1
          ? "  # on one rig; the first is its master. A camera that is not on it needs a session of its own"
          : "");
  for (const InitCamera& camera : cameras) {
    text += fmt::format("  {}:  # {} images\n", YamlText(camera.name), camera.frames.size());
    text += camera.plenoptic
                ? "    model: focused-plenoptic\n"
                  "    pixel_size:  # state it, from the data sheet: 5.5 um\n"
                  "    # bayer: RGGB  # of single-channel raw mosaics\n"
                : "    model: auto  # chosen by held-out frames, as 'plenocal try' does\n";
    text += fmt::format("    images: {}\n", PathsYaml(camera.images, folder));
    if (camera.white.empty()) continue;
    text += fmt::format(
        "    white_images: {}  # {} images\n", PathsYaml(camera.white, folder), camera.white_count);
  }
  if (std::ranges::none_of(cameras, &InitCamera::plenoptic)) {
    text += "options:\n  refine_target: auto  # the same, of a rigid target and one that is bent\n";
  }
  return text +
         "# exclude:  # what is not to be used, with the reason\n"
         "#   - {frame: '01', note: blurred}\n";
}

std::string TargetText(const TargetProposals& proposals) {
  std::string text = "# The target. All types and keys: docs/formats.md\nplenocal: 1\n";
  if (proposals.found.empty() || proposals.found[0].keys.empty()) {
    return text +
           "type:  # state it: chessboard, charuco, circles, aprilgrid or apriltag\n"
           "# Of a chessboard:\n"
           "# columns: 9      # inner corners\n"
           "# rows: 6\n"
           "# square: 25 mm\n";
  }
  const TargetProposal& best = proposals.found[0];
  text += fmt::format(
      "# Found: {} in {}\n{}", best.what, OfImages(best.images, proposals.looked_at), best.keys);
  for (const MeasuredKey& key : best.measure) {
    text += fmt::format("{}:  # measure and state it: {}\n", key.name, key.what);
  }
  return text + "# tolerance: 0.2 mm  # how well it was made; then its points are refined\n";
}

// The session and the target are the user's: nothing is replaced.
void RefuseExisting(const std::filesystem::path& file) {
  if (!std::filesystem::exists(file)) return;
  throw InputError("{}: exists and is not replaced; give another file with -o", file.string());
}

}  // namespace

FoundSession InitSession(const InitRequest& request, const Run& run) {
  const RunScope inputs;
  const std::filesystem::path folder = std::filesystem::absolute(request.session).parent_path();
  const std::string session = request.session.filename().string();
  // Beside a session of another name its target has that name too.
  const std::string target = session == "session.yaml"
                                 ? std::string("target.yaml")
                                 : request.session.stem().string() + "_target.yaml";
  RefuseExisting(folder / session);
  RefuseExisting(folder / target);
  FoundSession found{.cameras = CamerasOf(request, run)};
  found.proposals = LookAtAll(found.cameras, run);
  found.target = request.session.parent_path() / target;
  OutputFolder out(folder);
  out.Write(session, SessionText(found.cameras, folder, target));
  out.Write(target, TargetText(found.proposals));
  out.Commit();
  return found;
}

}  // namespace plenocal
