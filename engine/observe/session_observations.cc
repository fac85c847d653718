// SPDX-License-Identifier: Apache-2.0
#include "engine/observe/session_observations.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <iterator>
#include <set>
#include <span>
#include <utility>

#include "assess/causes/cause.h"
#include "calib/base/format_error.h"
#include "calib/base/number_text.h"
#include "calib/camera/micro_lens_array.h"
#include "calib/files/detections.h"
#include "calib/files/exclusion.h"
#include "calib/files/frame_images.h"
#include "calib/files/session.h"
#include "detectors/detect.h"
#include "engine/observe/choose_frames.h"
#include "engine/observe/left_out.h"
#include "engine/recording/frames/session_frames.h"
#include "engine/recording/frames/session_times.h"
#include "engine/recording/stores/image_lister.h"
#include "engine/session/calibration_input.h"
#include "engine/session/look_alikes.h"
#include "engine/session/proposal_text.h"

namespace plenocal {
namespace {

// True when both paths lead to one existing file.
bool IsSameFile(const std::filesystem::path& a, const std::filesystem::path& b) {
  std::error_code error;
  return !a.empty() && std::filesystem::equivalent(a, b, error);
}

std::vector<CameraImages> ListCameraImages(const Session& session, const Run& run) {
  std::vector<std::string> notes;
  std::vector<std::vector<FrameImage>> images = ListSessionImages(session, &notes);
  for (const std::string& note : notes) run.Message(note);
  std::vector<CameraImages> lists;
  for (size_t c = 0; c < images.size(); ++c) {
    const SessionCamera& camera = session.cameras[c];
    lists.push_back({.images = std::move(images[c]), .white = {}});
    if (camera.white_images.empty()) continue;
    lists.back().white = ListImages(camera.white_images, camera.name + ": white_images");
  }
  return lists;
}

/// Adds one camera of a session after the other to its `SessionObservations`.
class Collector {
 public:
  Collector(const Session& session,
            std::span<const Target> targets,
            const Run& run,
            const DetectionPlaces& places)
      : targets_(targets), places_(places), run_(run), exclusion_(session.exclude) {}

  void AddGiven(const SessionCamera& camera) {
    CameraInput input = InputWithoutViews(camera);
    input.views = camera.detections.empty() ? camera.given_views
                                            : ReadDetections(camera.detections, *camera.model);
    const std::filesystem::path lattice =
        camera.detections.parent_path() / fmt::format("lattice_{}.yaml", camera.name);
    if (camera.model->plenoptic && !camera.detections.empty() && exists(lattice)) {
      input.lattice_errors = ReadLatticeErrors(lattice, camera.image_size);
      run_.Message(
          fmt::format("{}: errors of micro-image centres from {}", camera.name, lattice.string()));
    }
    std::vector<LeftOut> left_out;
    exclusion_.RemoveViews(camera.name, {}, &input.views, &left_out);
    if (camera.model->assign_lens_types != nullptr) camera.model->assign_lens_types(&input.views);
    if (!camera.times.empty()) {
      std::vector<std::string> frames;
      for (const View& view : input.views) frames.push_back(view.frame);
      input.times = TimesOfFrames(camera.times, "camera " + camera.name, frames);
    }
    run_.Message(fmt::format("{}: {}, {} from {}",
                             camera.name,
                             Counted(input.views.size(), "frame"),
                             Counted(CountObservations(input.views), "point"),
                             camera.detections.empty() ? "memory" : camera.detections.string()));
    PrintLeftOut(left_out);
    AddLeftOut(std::move(left_out));
    collected_.sample_frames.emplace_back();
    collected_.traits.emplace_back();
    collected_.blurs.emplace_back();
    collected_.cameras.push_back(std::move(input));
  }

  void AddDetected(const SessionCamera& camera, CameraImages images) {
    std::vector<LeftOut> excluded;
    exclusion_.RemoveImages(camera.name, &images.images, &excluded);
    if (images.images.empty()) {
      throw InputError("{}: the session's 'exclude' leaves out all images; take back a rule",
                       camera.name);
    }
    ImageDetections found = Detect(camera, images);
    CheckImageSize(camera, found.image_size);
    for (LeftOut& item : found.left_out) Locate(camera.name, images.images, &item);
    exclusion_.RemoveViews(camera.name, images.images, &found.views, &excluded);
    found.left_out.insert(found.left_out.begin(), excluded.begin(), excluded.end());
    Report(camera, images, found);
    CameraInput input = InputWithoutViews(camera);
    input.image_size = found.image_size;
    if (!input.image_circle) input.image_circle = found.image_circle;
    input.views = std::move(found.views);
    input.lattice_errors = found.lattice_errors;
    for (const FrameImage& image : images.images) {
      if (image.time) input.times[image.frame] = *image.time;
    }
    AddLeftOut(std::move(found.left_out));
    collected_.sample_frames.push_back(found.sample.frame);
    collected_.traits.push_back(std::move(found.traits));
    collected_.blurs.push_back(std::move(found.blur));
    AddFiles(camera.name, &found);
    collected_.cameras.push_back(std::move(input));
  }

  SessionObservations Take() {
    for (const std::string& rule : exclusion_.Unused()) run_.Message(rule);
    return std::move(collected_);
  }

 private:
  ImageDetections Detect(const SessionCamera& camera, const CameraImages& images) {
    // Observations of plenoptic models have a context, their micro lens.
    const CameraOptics optics =
        camera.model->plenoptic ? CameraOptics::kPlenoptic : CameraOptics::kOrdinary;
    DetectOptions detect{.white_images = images.white,
                         .bayer = camera.bayer,
                         .tilted_array = HasTilt(*camera.model),
                         .threads = run_.threads,
                         .cache = places_.cache,
                         .report =
                             [&](const ImageReport& report) {
                               run_.Detection(camera.name, report.frame, report.points, report.why);
                             },
                         .progress =
                             [&](size_t done) {
                               return run_.Progress(
                                   camera.name + ": images", done, images.images.size());
                             }};
    if (places_.pictures != nullptr) {
      detect.keep = [&](const std::string& name, const std::string& content) {
        places_.pictures->Write(fmt::format("images/{}/{}", camera.name, name), content);
      };
    }
    try {
      if (targets_.size() == 1) return DetectImages(images.images, targets_[0], optics, detect);
      detect.cache = nullptr;
      return DetectSeveral(images.images, optics, detect);
    } catch (const Error& error) {
      throw Error(error.kind(), fmt::format("{}: {}", camera.name, error.what()));
    }
  }

  /// Each target in turn; an image is left out where it shows none. Of targets that share numbers
  /// of tags also the tags that are left out.
  ImageDetections DetectSeveral(const std::vector<FrameImage>& images,
                                CameraOptics optics,
                                const DetectOptions& options) const {
    std::vector<std::vector<View>> views;
    std::vector<LeftOut> left_out, tags;
    ImageDetections all;
    for (size_t k = 0; k < targets_.size(); ++k) {
      const OtherTargets others = OtherTargetsOf(targets_, k);
      ImageDetections found = DetectImages(images, targets_[k], optics, options, others);
      views.push_back(std::move(found.views));
      if (!others.targets.empty()) {
        std::ranges::copy_if(found.left_out, std::back_inserter(tags), [](const LeftOut& item) {
          return !item.whole;
        });
      }
      left_out.insert(left_out.end(), found.left_out.begin(), found.left_out.end());
      if (k == 0) all = std::move(found);
    }
    all.views = JoinViews(std::move(views));
    all.left_out.clear();
    std::set<std::string> shown, listed;
    for (const FrameImage& image : images) {
      const bool shows = std::ranges::any_of(
          all.views, [&](const View& view) { return view.frame == image.frame; });
      if (shows) shown.insert(image.path.string());
    }
    for (LeftOut& item : left_out) {
      if (shown.contains(item.where)) continue;
      if (listed.insert(item.where).second) all.left_out.push_back(std::move(item));
    }
    // The detectors of several targets leave out a tag that fits all of them.
    std::set<std::pair<std::string, std::string>> reasons;
    for (LeftOut& item : tags) {
      if (!shown.contains(item.where) || !reasons.emplace(item.where, item.reason).second) continue;
      all.left_out.push_back(std::move(item));
    }
    return all;
  }

  /// Prints what was found; throws when that is nothing.
  void Report(const SessionCamera& camera,
              const CameraImages& images,
              const ImageDetections& found) {
    const size_t count = images.images.size();
    run_.Message(fmt::format("{}: {}, target found in {}, {}",
                             camera.name,
                             Counted(count, "image"),
                             found.views.size(),
                             Counted(CountObservations(found.views), "point")));
    if (found.reused > 0) {
      run_.Message(
          fmt::format("{}: detections of {} reused", camera.name, Counted(found.reused, "image")));
    }
    for (const Finding& note :
         FindCauses(CauseStage::kImageFile, {.name = camera.name, .traits = &found.traits})) {
      run_.Message(fmt::format("{} {}", note.what, note.remedy));
    }
    for (const std::string& line : found.warnings) run_.Warning(camera.name + ": " + line);
    PrintLeftOut(found.left_out);
    if (!found.views.empty()) return;
    const std::string mend = Mend(camera, images.images);
    const LeftOut& first = found.left_out[0];
    throw JobError(
        "{}: none of its {} images shows the target; {}",
        camera.name,
        count,
        mend.empty() ? fmt::format("the first: {}: {}", first.where, first.reason) : mend);
  }

  /// How the target must be changed to be the one in the images; empty when they show none.
  std::string Mend(const SessionCamera& camera, const std::vector<FrameImage>& images) {
    if (camera.model->plenoptic) return {};
    return MendOf(LookForTargets(images, run_), targets_[0]);
  }

  void PrintLeftOut(const std::vector<LeftOut>& items) {
    for (const std::string& line : GroupedByReason(items)) run_.Message("  " + line);
  }

  void AddLeftOut(std::vector<LeftOut> items) {
    collected_.left_out.insert(collected_.left_out.end(), items.begin(), items.end());
  }

  /// Camera and frame of what detection has left out.
  static void Locate(const std::string& camera,
                     const std::vector<FrameImage>& images,
                     LeftOut* item) {
    item->camera = camera;
    const auto image = std::ranges::find_if(
        images, [&](const FrameImage& each) { return each.path.string() == item->where; });
    if (image != images.end()) item->frame = image->frame;
  }

  void AddFiles(const std::string& camera, ImageDetections* found) {
    const auto add = [&](const char* key, std::string name, std::string* content) {
      if (content->empty()) return;
      collected_.files.push_back(
          {collected_.cameras.size(), key, std::move(name), std::move(*content)});
    };
    add("micro_lenses", fmt::format("micro_lenses_{}.csv", camera), &found->micro_lenses);
    std::string lattice = FormatLatticeErrors(found->lattice_errors);
    add("lattice", fmt::format("lattice_{}.yaml", camera), &lattice);
    add("vignetting", fmt::format("vignetting_{}.tiff", camera), &found->vignetting);
    add("sample", fmt::format("sample_{}.jpg", camera), &found->sample.picture);
    add("sample_depth", fmt::format("virtual_depth_{}.jpg", camera), &found->sample.depth);
  }

  std::span<const Target> targets_;
  const DetectionPlaces& places_;
  const Run& run_;
  Exclusion exclusion_;
  SessionObservations collected_;
};

SessionObservations Collect(const Session& session,
                            std::span<const Target> targets,
                            const Run& run,
                            const DetectionPlaces& places) {
  // All globs first: a wrong one should not show only after minutes of work on another camera.
  std::vector<CameraImages> images = ListCameraImages(session, run);
  FrameChoice choice;
  if (targets.size() == 1) {
    choice = ChooseFrames(session, targets[0], places.cache, run, &images);
  }
  Collector collector(session, targets, run, places);
  for (size_t c = 0; c < session.cameras.size(); ++c) {
    const SessionCamera& camera = session.cameras[c];
    if (!HasImages(camera)) {
      collector.AddGiven(camera);
    } else {
      collector.AddDetected(camera, images[c]);
    }
  }
  SessionObservations observations = collector.Take();
  std::ranges::move(choice.left_out, std::back_inserter(observations.left_out));
  if (!choice.table.empty()) {
    observations.files.push_back({0, "frames", "chosen_frames.csv", std::move(choice.table)});
  }
  return observations;
}

}  // namespace

SessionObservations CollectObservations(const Session& session,
                                        const Target& target,
                                        const Run& run,
                                        const DetectionPlaces& places) {
  return Collect(session, std::span(&target, 1), run, places);
}

SessionObservations CollectObservations(const Session& session,
                                        const SessionTargets& targets,
                                        const Run& run,
                                        const DetectionPlaces& places) {
  SessionObservations observations =
      Collect(session,
              targets.several.empty() ? std::span(&targets.all, 1) : std::span(targets.several),
              run,
              places);
  for (const IdenticalBoards& prints : targets.identical_boards) {
    std::vector<LeftOut> left_out = TellApart(prints, targets.all.markers, &observations.cameras);
    for (const std::string& line : GroupedByReason(left_out)) run.Message("  " + line);
    std::ranges::move(left_out, std::back_inserter(observations.left_out));
  }
  return observations;
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
