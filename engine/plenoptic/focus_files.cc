// SPDX-License-Identifier: Apache-2.0
#include "engine/plenoptic/focus_files.h"

#include <fmt/format.h>

#include <optional>

#include "calib/base/number_limits.h"
#include "calib/io/input_file.h"
#include "calib/io/output_folder.h"
#include "engine/images/image_folder.h"
#include "engine/recording/stores/image_lister.h"

namespace plenocal {

std::vector<FocusResult> FocusImages(const FocusFilesRequest& request, const Run& run) {
  const RunScope inputs;
  RequireWithin("scale", request.scale, 0.5, 16);
  FocusRequest focus;
  focus.raw_images = FindImageInputs(request.raw, "raw images");
  focus.camera = FindPlenopticSource(request.camera);
  focus.scale = request.scale;
  focus.threads = run.threads;
  std::optional<Target> target;
  if (!request.markers.empty()) target = ReadTarget(request.markers);
  focus.target = target ? &*target : nullptr;

  const bool many = focus.raw_images.size() > 1;
  const auto folder = [&](const std::string& frame) {
    return many ? request.out / frame : request.out;
  };
  CheckImageNames(focus.raw_images, "");
  const auto out = OpenOutput(request.out);
  std::vector<FocusResult> focused;
  focus.message = [&](const std::string& line) { run.Message(line); };
  std::string place;  // "2 of 7"
  focus.progress = [&](size_t done) {
    place = fmt::format("{} of {}", done + 1, focus.raw_images.size());
    return run.Progress(fmt::format("focus: image {}, {}", place, focus.raw_images[done].frame));
  };
  focus.result =
      [&](const std::string& frame, const FrameFiles& files, const std::string& summary) {
        focused.push_back({frame, out ? FrameFiles() : files, summary});
        if (out) {
          std::optional<OutputFolder> own;
          if (many) own.emplace(folder(frame));
          OutputFolder& to = many ? *own : *out;
          for (const auto& [name, content] : files) to.Write(name, content);
          to.Commit();
        }
        run.Message(fmt::format("image {}, {}: {}", place, frame, summary));
      };
  FocusImages(focus);
  return focused;
}

}  // namespace plenocal
