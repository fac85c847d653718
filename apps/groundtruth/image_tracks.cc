// SPDX-License-Identifier: Apache-2.0
#include "apps/groundtruth/image_tracks.h"

#include <fmt/format.h>

#include <algorithm>

#include "calib/base/format_error.h"
#include "calib/base/number_text.h"
#include "detectors/images/opencv_threads.h"
#include "engine/scene/track/follow_points.h"

namespace plenocal {
namespace {

// Index in the recording of each camera. Throws for one that is missing or does not fit.
std::vector<size_t> FindCameras(const Recording& recording,
                                const std::vector<BundleCamera>& cameras) {
  std::vector<size_t> indices;
  for (const BundleCamera& camera : cameras) {
    const auto same = [&](const RecordedCamera& recorded) { return recorded.name == camera.name; };
    const auto found = std::ranges::find_if(recording.cameras, same);
    if (found == recording.cameras.end()) {
      throw InputError("{}: has no camera '{}' of the calibration; choose by --cameras",
                       recording.path.string(),
                       camera.name);
    }
    if (found->image_size != camera.image_size) {
      throw InputError(
          "{}: images of camera '{}' have {} x {} px, the calibration is for "
          "{} x {}",
          recording.path.string(),
          camera.name,
          found->image_size[0],
          found->image_size[1],
          camera.image_size[0],
          camera.image_size[1]);
    }
    indices.push_back(static_cast<size_t>(found - recording.cameras.begin()));
  }
  return indices;
}

cv::Mat EightBits(const cv::Mat& image) {
  if (image.depth() == CV_8U) return image;
  double largest = 0;
  cv::minMaxLoc(image, nullptr, &largest);
  cv::Mat grey;
  image.convertTo(grey, CV_8U, 255 / std::max(1.0, largest));
  return grey;
}

// Features that the first camera shows in some frames of the start, to recognise its scene.
class Recogniser {
 public:
  void Add(const cv::Mat& image) { known_.push_back(FindFeatures(image, kFeatures, {}, 0)); }

  // Largest number of features that an image has in common with one of those added, on one epipolar
  // geometry.
  [[nodiscard]] size_t CountCommon(const cv::Mat& image) const {
    const ImageFeatures features = FindFeatures(image, kFeatures, {}, 0);
    size_t most = 0;
    for (const ImageFeatures& known : known_) {
      const auto pairs = MatchDescriptors(features.descriptors, known.descriptors);
      if (pairs.size() <= std::max(most, kFewestCommon)) continue;
      std::vector<cv::Point2f> a, b;
      for (const auto& [i, j] : pairs) {
        a.push_back(features.points[static_cast<size_t>(i)]);
        b.push_back(known.points[static_cast<size_t>(j)]);
      }
      const std::vector<bool> agrees = OnOneEpipolarGeometry(a, b);
      most = std::max(most, static_cast<size_t>(std::ranges::count(agrees, true)));
    }
    return most;
  }

 private:
  static constexpr int kFeatures = 800;
  std::vector<ImageFeatures> known_;
};

// Micro lenses of the plenoptic cameras, by index, from the recording's white images.
std::map<size_t, PlenopticCamera> MeasureOptics(const Recording& recording,
                                                const std::vector<BundleCamera>& cameras,
                                                int threads,
                                                std::vector<LeftOut>* left_out) {
  std::map<size_t, PlenopticCamera> optics;
  for (size_t c = 0; c < cameras.size(); ++c) {
    if (!cameras[c].model->plenoptic) continue;
    const RecordedCamera& recorded = *recording.FindCamera(cameras[c].name);
    if (recorded.white_images.empty()) {
      throw InputError(
          "{}: camera '{}' is plenoptic and has no white_images, from which the "
          "micro-image centres come",
          recording.path.string(),
          recorded.name);
    }
    optics.emplace(
        c, MeasurePlenopticCamera(recorded.white_images, recorded.bayer, threads, left_out));
  }
  return optics;
}

class LoopTracker {
 public:
  LoopTracker(const Recording& recording,
              const std::vector<BundleCamera>& cameras,
              const ImageTrackOptions& options)
      : recording_(recording),
        cameras_(cameras),
        options_(options),
        indices_(FindCameras(recording, cameras)),
        images_{.cameras = &cameras,
                .optics = MeasureOptics(recording, cameras, options.threads, &result_.left_out),
                .frames = {},
                .read = [this](size_t camera, size_t frame) { return ReadImage(camera, frame); },
                .threads = options.threads} {
    UseNoOpenCvThreads();
    for (const RecordedFrame& frame : recording.frames) {
      result_.tracks.frames.push_back(frame.name);
      if (recording.HasTimes()) result_.tracks.times.push_back(frame.time);
    }
    images_.frames = result_.tracks.frames;
    result_.tracks.views.resize(cameras.size());
  }

  LoopTracks Run() {
    result_.segments =
        ChooseSegments(result_.tracks, options_.segments, [this](const std::vector<size_t>& first) {
          return FramesThatSeeAgain(first);
        });
    const FollowedPoints start = Follow(result_.segments.start, "start", 0);
    const FollowedPoints end = Follow(result_.segments.end, "end", start.descriptors.rows);
    for (const FollowedPoints* segment : {&start, &end}) {
      for (size_t c = 0; c < cameras_.size(); ++c) {
        std::vector<View>& views = result_.tracks.views[c];
        views.insert(views.end(), segment->views[c].begin(), segment->views[c].end());
      }
      result_.left_out.insert(
          result_.left_out.end(), segment->left_out.begin(), segment->left_out.end());
    }
    for (const auto& [i, j] : MatchDescriptors(end.descriptors, start.descriptors)) {
      if (end.group[static_cast<size_t>(i)] != start.group[static_cast<size_t>(j)]) continue;
      result_.tracks.matches.emplace_back(start.descriptors.rows + i, j);
    }
    cv::vconcat(start.descriptors, end.descriptors, result_.descriptors);
    return std::move(result_);
  }

 private:
  void Report(const std::string& stage, size_t done, size_t total) const {
    if (options_.progress && !options_.progress(stage, done, total)) throw Stopped();
  }

  [[nodiscard]] cv::Mat ReadImage(size_t camera, size_t frame) const {
    const std::optional<size_t> image = recording_.frames[frame].image[indices_[camera]];
    if (!image) return {};
    const cv::Mat read = recording_.cameras[indices_[camera]].Read(*image);
    return images_.optics.contains(camera) ? read : EightBits(read);
  }

  // As features are found in it.
  [[nodiscard]] cv::Mat ReadGrey(size_t camera, size_t frame) const {
    cv::Mat image = ReadImage(camera, frame);
    const auto optics = images_.optics.find(camera);
    if (image.empty() || optics == images_.optics.end()) return image;
    return FocusedImage(image, optics->second, options_.threads);
  }

  [[nodiscard]] std::vector<size_t> FramesThatSeeAgain(const std::vector<size_t>& start) const {
    constexpr size_t kOfStart = 12, kTried = 60;
    Recogniser recogniser;
    for (size_t i = 0; i < kOfStart; ++i) {
      Report("look at the start", i, kOfStart);
      const cv::Mat image = ReadGrey(0, start[i * start.size() / kOfStart]);
      if (!image.empty()) recogniser.Add(image);
    }
    const size_t count = recording_.frames.size(), first = std::max(count / 2, start.back() + 1);
    const size_t step = std::max<size_t>(1, (count - std::min(first, count)) / kTried);
    size_t before = count;  // a frame that has seen the start again
    size_t most = 0;
    for (size_t frame = first; frame < count; frame += step) {
      Report("look for the end", frame - first, count - first);
      const cv::Mat image = ReadGrey(0, frame);
      const size_t common = image.empty() ? 0 : recogniser.CountCommon(image);
      most = std::max(most, common);
      // Twice in a row: once may be chance.
      if (common < kFewestCommon) {
        before = count;
      } else if (before < count) {
        return FramesFrom(before, count);
      } else {
        before = frame;
      }
    }
    throw JobError(
        "start and end do not see the same scene: {} in common at most; give "
        "--start and --end",
        Counted(most, "point"));
  }

  FollowedPoints Follow(const std::vector<size_t>& frames,
                        const char* name,
                        int first_number) const {
    return FollowPoints(
        images_, frames, options_.features, first_number, [&](size_t done, size_t total) {
          Report(fmt::format("follow points of the {}", name), done, total);
        });
  }

  const Recording& recording_;
  const std::vector<BundleCamera>& cameras_;
  const ImageTrackOptions& options_;
  std::vector<size_t> indices_;  // in the recording
  LoopTracks result_;
  RigImages images_;
};

}  // namespace

LoopTracks TrackLoop(const Recording& recording,
                     const std::vector<BundleCamera>& cameras,
                     const ImageTrackOptions& options) {
  return LoopTracker(recording, cameras, options).Run();
}

}  // namespace plenocal
