// SPDX-License-Identifier: Apache-2.0
#include "apps/scene/loop/image_tracks.h"

#include <fmt/format.h>

#include <algorithm>
#include <opencv2/calib3d.hpp>
#include <opencv2/imgproc.hpp>

#include "calib/base/error.h"
#include "calib/base/number_text.h"

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
      throw Error(ErrorKind::kInput,
                  fmt::format("{}: has no camera '{}' of the calibration; choose by --cameras",
                              recording.path.string(),
                              camera.name));
    }
    if (found->image_size != camera.image_size) {
      throw Error(ErrorKind::kInput,
                  fmt::format("{}: images of camera '{}' have {} x {} px, the calibration is for "
                              "{} x {}",
                              recording.path.string(),
                              camera.name,
                              found->image_size[0],
                              found->image_size[1],
                              camera.image_size[0],
                              camera.image_size[1]));
    }
    if (camera.model->plenoptic) {
      throw Error(ErrorKind::kInput,
                  fmt::format("{}: camera '{}' is plenoptic: its scene points are not followed in "
                              "raw images; choose others by --cameras, or supply its tracks",
                              recording.path.string(),
                              camera.name));
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
      std::vector<unsigned char> inlier;
      cv::findFundamentalMat(a, b, inlier, cv::FM_RANSAC, kEpipolarError, 0.99);
      most = std::max(most, static_cast<size_t>(std::ranges::count(inlier, 1)));
    }
    return most;
  }

 private:
  static constexpr int kFeatures = 800;
  static constexpr double kEpipolarError = 2;  // px
  std::vector<ImageFeatures> known_;
};

class LoopTracker {
 public:
  LoopTracker(const Recording& recording,
              const std::vector<BundleCamera>& cameras,
              const ImageTrackOptions& options)
      : recording_(recording),
        cameras_(cameras),
        options_(options),
        indices_(FindCameras(recording, cameras)) {
    cv::setNumThreads(0);  // the same bytes for any number of threads
    for (const RecordedFrame& frame : recording.frames) {
      result_.tracks.frames.push_back(frame.name);
      if (recording.HasTimes()) result_.tracks.times.push_back(frame.time);
    }
    result_.tracks.views.resize(cameras.size());
  }

  LoopTracks Run() {
    ChooseFrames();
    const FeatureTracker start = Track(result_.segments.start, "start", 0);
    const FeatureTracker end = Track(result_.segments.end, "end", start.Descriptors().rows);
    for (const FeatureTracker* segment : {&start, &end}) {
      for (size_t c = 0; c < cameras_.size(); ++c) {
        std::vector<View>& views = result_.tracks.views[c];
        views.insert(views.end(), segment->Views()[c].begin(), segment->Views()[c].end());
      }
    }
    for (const auto& [i, j] : MatchDescriptors(end.Descriptors(), start.Descriptors())) {
      result_.tracks.matches.emplace_back(start.Descriptors().rows + i, j);
    }
    cv::vconcat(start.Descriptors(), end.Descriptors(), result_.descriptors);
    return std::move(result_);
  }

 private:
  void Report(const std::string& stage, size_t done, size_t total) const {
    if (options_.progress && !options_.progress(stage, done, total)) throw Stopped();
  }

  [[nodiscard]] cv::Mat ReadImage(size_t camera, size_t frame) const {
    const std::optional<size_t> image = recording_.frames[frame].image[indices_[camera]];
    if (!image) return {};
    return EightBits(recording_.cameras[indices_[camera]].Read(*image));
  }

  void ChooseFrames() {
    const SceneTracks& tracks = result_.tracks;
    if (options_.segments.start.empty() && options_.segments.end.empty()) {
      if (const auto split = SplitAtGap(tracks)) {
        result_.segments = *split;
        return;
      }
    }
    result_.segments.start = StartFrames(tracks, options_.segments.start);
    result_.segments.end = options_.segments.end.empty() ? FramesThatSeeAgain()
                                                         : EndFrames(tracks, options_.segments.end);
    CheckOrder(result_.segments);
  }

  [[nodiscard]] std::vector<size_t> FramesThatSeeAgain() const {
    constexpr size_t kOfStart = 12, kTried = 60;
    const std::vector<size_t>& start = result_.segments.start;
    Recogniser recogniser;
    for (size_t i = 0; i < kOfStart; ++i) {
      Report("look at the start", i, kOfStart);
      const cv::Mat image = ReadImage(0, start[i * start.size() / kOfStart]);
      if (!image.empty()) recogniser.Add(image);
    }
    const size_t count = recording_.frames.size(), first = std::max(count / 2, start.back() + 1);
    const size_t step = std::max<size_t>(1, (count - std::min(first, count)) / kTried);
    size_t before = count;  // a frame that has seen the start again
    size_t most = 0;
    for (size_t frame = first; frame < count; frame += step) {
      Report("look for the end", frame - first, count - first);
      const cv::Mat image = ReadImage(0, frame);
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
    throw Error(ErrorKind::kJob,
                fmt::format("start and end do not see the same scene: {} in common at most; give "
                            "--start and --end",
                            Counted(most, "point")));
  }

  FeatureTracker Track(const std::vector<size_t>& frames,
                       const char* name,
                       int first_number) const {
    FeatureTracker tracker(cameras_, options_.features, first_number);
    for (size_t i = 0; i < frames.size(); ++i) {
      Report(fmt::format("follow points of the {}", name), i, frames.size());
      std::vector<cv::Mat> images;
      for (size_t c = 0; c < cameras_.size(); ++c) images.push_back(ReadImage(c, frames[i]));
      tracker.AddFrame(result_.tracks.frames[frames[i]], images);
    }
    return tracker;
  }

  const Recording& recording_;
  const std::vector<BundleCamera>& cameras_;
  const ImageTrackOptions& options_;
  std::vector<size_t> indices_;  // in the recording
  LoopTracks result_;
};

}  // namespace

LoopTracks TrackLoop(const Recording& recording,
                     const std::vector<BundleCamera>& cameras,
                     const ImageTrackOptions& options) {
  return LoopTracker(recording, cameras, options).Run();
}

}  // namespace plenocal
