// SPDX-License-Identifier: Apache-2.0
#include "engine/session/image_session.h"

#include <fmt/format.h>

#include "calib/base/format_error.h"
#include "calib/base/quoted_text.h"
#include "calib/io/input_file.h"
#include "calib/io/output_folder.h"
#include "engine/recording/find_cameras.h"
#include "engine/recording/image_names.h"
#include "engine/session/proposal_text.h"
#include "engine/session/session_targets.h"
#include "models/registry.h"

namespace plenocal {
namespace {

namespace fs = std::filesystem;

constexpr std::string_view kMark = "# Written by 'plenocal calibrate' from images";

void CheckReplaceable(const fs::path& session) {
  CompleteResults(session);
  if (!fs::exists(session) || ReadEarlierResult(session).starts_with(kMark)) return;
  throw InputError(
      "{}: was not written from images on the command line and would be "
      "replaced; give another folder with -o",
      session.string());
}

}  // namespace

ImageSession::ImageSession(const ImageArguments& arguments, const fs::path& out, const Run& run)
    : out_(out) {
  if (!arguments.cameras.empty() && !(arguments.images.empty() && arguments.right.empty())) {
    throw InputError("--camera: names all cameras; give their images by --camera NAME=GLOB alone");
  }
  std::vector<std::string> names;
  std::vector<std::vector<std::string>> images;
  const bool folder = arguments.images.size() == 1 && fs::is_directory(arguments.images[0]);
  if (const auto found = folder ? CamerasInFolder(arguments.images[0]) : std::vector<FoundCamera>();
      found.size() > 1 && arguments.right.empty()) {
    for (const FoundCamera& camera : found) {
      names.push_back(camera.name);
      images.push_back(camera.images);
      run.Message(fmt::format("camera {}: {}", camera.name, camera.images[0]));
    }
  } else if (!arguments.images.empty()) {
    names.emplace_back(arguments.right.empty() ? "cam" : "left");
    images.push_back(AsGlobs(arguments.images, "images"));
  }
  if (!arguments.right.empty()) {
    names.emplace_back("right");
    images.push_back(AsGlobs(arguments.right, "--right"));
  }
  for (const std::string& camera : arguments.cameras) {
    const size_t equal = camera.find('=');
    if (equal == std::string::npos || equal == 0 || equal + 1 == camera.size()) {
      throw InputError("--camera {}: expected NAME=GLOB", camera);
    }
    names.push_back(camera.substr(0, equal));
    images.push_back(AsGlobs({camera.substr(equal + 1)}, "--camera " + camera));
  }
  ShareFrames(names, &images);
  for (size_t c = 0; c < names.size(); ++c) cameras_.push_back({names[c], images[c]});
  if (!out.empty()) CheckReplaceable(out / kSessionName);
  if (arguments.target.empty()) FailWithProposal(names, images, run);
  source_ = TargetNamed(arguments.target);
  target_ = ReadTarget(source_);
  target_text_ = source_.Text();
}

std::string ImageSession::Text(std::string_view model, std::string_view refine_target) const {
  std::string text = fmt::format(
      "{}; the next run with images replaces it.\n"
      "# Copy it before you change it. All keys: docs/formats.md\n"
      "plenocal: 1\n"
      "target: {}\n"
      "cameras:{}\n",
      kMark,
      kTargetName,
      cameras_.size() > 1 ? "  # the first is the rig's master" : "");
  for (const Camera& camera : cameras_) {
    text += fmt::format("  {}:\n    model: {}\n    images: {}\n",
                        YamlText(camera.name),
                        model,
                        PathsYaml(camera.images, out_));
  }
  if (!refine_target.empty()) text += fmt::format("options:\n  refine_target: {}\n", refine_target);
  return text;
}

Session ImageSession::With(std::string_view model, std::string_view refine_target) const {
  Session session = ParseSession(Text(model, refine_target), out_ / kSessionName, CameraModels());
  // The files are not there yet; and paths as the user wrote them make better messages.
  session.target = source_;
  for (size_t c = 0; c < cameras_.size(); ++c) session.cameras[c].images = cameras_[c].images;
  return session;
}

}  // namespace plenocal
