// SPDX-License-Identifier: Apache-2.0
#include "engine/scene/track/follow_points.h"

#include <algorithm>
#include <optional>

#include "calib/base/error.h"

namespace plenocal {
namespace {

// Positions of the tracks in one frame of a group's first camera, px of the image in which
// features are found.
using SeenPoints = std::map<int, cv::Point2f>;

std::map<std::string, SeenPoints> PointsByFrame(const std::vector<View>& views) {
  std::map<std::string, SeenPoints> frames;
  for (const View& view : views) {
    SeenPoints& points = frames[view.frame];
    for (const Observation& seen : view.observations) {
      points[seen.marker] =
          cv::Point2f(static_cast<float>(seen.values[0]), static_cast<float>(seen.values[1]));
    }
  }
  return frames;
}

class PointFollower {
 public:
  PointFollower(const RigImages& images,
                const std::vector<size_t>& frames,
                const FeatureOptions& options,
                int first_number,
                const std::function<void(size_t, size_t)>& done)
      : images_(images),
        frames_(frames),
        options_(options),
        first_number_(first_number),
        report_(done) {
    options_.threads = images.threads;
    result_.views.resize(images.cameras->size());
    for (size_t c = 0; c < images.cameras->size(); ++c) {
      if (!images.optics.contains(c)) ordinary_.push_back(c);
    }
    groups_ = images.optics.size() + (ordinary_.empty() ? 0 : 1);
  }

  FollowedPoints Run() {
    if (!ordinary_.empty()) FollowOrdinary();
    for (const auto& [camera, optics] : images_.optics) FollowPlenoptic(camera, optics);
    for (size_t group = 1; group < seen_.size(); ++group) FindAlike(group);
    return std::move(result_);
  }

 private:
  [[nodiscard]] int NextNumber() const { return first_number_ + result_.descriptors.rows; }

  void Report(size_t frame) const {
    if (report_) report_(seen_.size() * frames_.size() + frame, groups_ * frames_.size());
  }

  void LeaveOut(size_t camera, size_t frame, const Error& error) {
    const std::string& name = (*images_.cameras)[camera].name;
    result_.left_out.push_back({.where = name + " " + images_.frames[frame],
                                .reason = error.what(),
                                .whole = true,
                                .camera = name,
                                .frame = images_.frames[frame]});
  }

  cv::Mat Read(size_t camera, size_t frame) {
    try {
      return images_.read(camera, frame);
    } catch (const Error& error) {
      LeaveOut(camera, frame, error);
      return {};
    }
  }

  void FollowOrdinary() {
    std::vector<BundleCamera> cameras;
    for (const size_t c : ordinary_) cameras.push_back((*images_.cameras)[c]);
    FeatureTracker tracker(cameras, options_, NextNumber());
    for (size_t i = 0; i < frames_.size(); ++i) {
      Report(i);
      std::vector<cv::Mat> read;
      for (const size_t c : ordinary_) read.push_back(Read(c, frames_[i]));
      tracker.AddFrame(images_.frames[frames_[i]], read);
    }
    std::vector<std::vector<View>> views = tracker.Views();
    AddGroup(tracker.Descriptors(), views[0]);
    for (size_t i = 0; i < ordinary_.size(); ++i) {
      result_.views[ordinary_[i]] = std::move(views[i]);
    }
  }

  void FollowPlenoptic(size_t camera, const PlenopticCamera& optics) {
    PlenopticTracker tracker(
        (*images_.cameras)[camera], optics, options_, NextNumber(), images_.threads);
    for (size_t i = 0; i < frames_.size(); ++i) {
      Report(i);
      const cv::Mat raw = Read(camera, frames_[i]);
      if (raw.empty()) continue;
      try {
        tracker.AddFrame(images_.frames[frames_[i]], raw);
      } catch (const Error& error) {
        LeaveOut(camera, frames_[i], error);
      }
    }
    result_.views[camera] = tracker.Views();
    AddGroup(tracker.Descriptors(), tracker.FocusedViews());
  }

  void AddGroup(const cv::Mat& descriptors, const std::vector<View>& first_camera) {
    result_.group.insert(
        result_.group.end(), static_cast<size_t>(descriptors.rows), static_cast<int>(seen_.size()));
    if (!descriptors.empty()) result_.descriptors.push_back(descriptors);
    seen_.push_back(PointsByFrame(first_camera));
  }

  [[nodiscard]] cv::Mat DescriptorsOf(const SeenPoints& points) const {
    cv::Mat rows;
    for (const auto& [number, point] : points) {
      rows.push_back(result_.descriptors.row(number - first_number_));
    }
    return rows;
  }

  // Tracks that the first group and this one show in one frame, in some frames.
  void FindAlike(size_t group) {
    constexpr size_t kCompared = 20;
    const size_t step = std::max<size_t>(1, frames_.size() / kCompared);
    std::map<int, int> of_second;
    for (size_t i = 0; i < frames_.size(); i += step) {
      const std::string& name = images_.frames[frames_[i]];
      const auto first = seen_[0].find(name), second = seen_[group].find(name);
      if (first == seen_[0].end() || second == seen_[group].end()) continue;
      const std::vector<SeenPoints::value_type> a(first->second.begin(), first->second.end());
      const std::vector<SeenPoints::value_type> b(second->second.begin(), second->second.end());
      std::vector<std::pair<int, int>> pairs;
      std::vector<cv::Point2f> in_a, in_b;
      for (const auto& [row, other] :
           MatchDescriptors(DescriptorsOf(first->second), DescriptorsOf(second->second))) {
        pairs.emplace_back(a[static_cast<size_t>(row)].first, b[static_cast<size_t>(other)].first);
        in_a.push_back(a[static_cast<size_t>(row)].second);
        in_b.push_back(b[static_cast<size_t>(other)].second);
      }
      const std::vector<bool> agrees = OnOneEpipolarGeometry(in_a, in_b);
      for (size_t k = 0; k < pairs.size(); ++k) {
        if (agrees[k]) of_second.emplace(pairs[k].second, pairs[k].first);
      }
    }
    for (const auto& [second, first] : of_second) result_.alike.emplace_back(second, first);
  }

  const RigImages& images_;
  const std::vector<size_t>& frames_;
  FeatureOptions options_;
  int first_number_;
  const std::function<void(size_t, size_t)>& report_;
  std::vector<size_t> ordinary_;
  size_t groups_ = 0;
  std::vector<std::map<std::string, SeenPoints>> seen_;  // per group so far
  FollowedPoints result_;
};

}  // namespace

FollowedPoints FollowPoints(const RigImages& images,
                            const std::vector<size_t>& frames,
                            const FeatureOptions& options,
                            int first_number,
                            const std::function<void(size_t done, size_t total)>& done) {
  return PointFollower(images, frames, options, first_number, done).Run();
}

}  // namespace plenocal
