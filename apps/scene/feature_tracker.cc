// SPDX-License-Identifier: Apache-2.0
#include "apps/scene/feature_tracker.h"

#include <algorithm>
#include <cmath>
#include <memory>
#include <opencv2/features2d.hpp>
#include <opencv2/video/tracking.hpp>

#include "apps/scene/epipolar_search.h"

namespace plenocal {
namespace {

const cv::Size kWindow(21, 21);
constexpr int kLevels = 3;
// SIFT works on the image at twice its size, whose pixels lie a quarter of a pixel off; OpenCV
// divides by two only.
const cv::Point2f kUpscaled(0.25F, 0.25F);
constexpr double kContrast = 0.01;  // of SIFT: weak features serve as well
// There and back again, px.
constexpr float kRoundTrip = 0.5F;
// Between optical flow from the last image and from the one in which the point was found, px.
constexpr float kFromKey = 2;
// New points are found when so many of the wanted ones are left.
constexpr double kRefill = 0.7;
// Motion that optical flow has lost, as after a jerk: descriptors find the points again.
constexpr double kLost = 0.3;
constexpr float kRatio = 0.8F;

const cv::TermCriteria kPrecise(cv::TermCriteria::COUNT | cv::TermCriteria::EPS, 40, 0.003);

std::vector<cv::Mat> MakePyramid(const cv::Mat& image) {
  std::vector<cv::Mat> pyramid;
  if (!image.empty()) cv::buildOpticalFlowPyramid(image, pyramid, kWindow, kLevels);
  return pyramid;
}

// Points of one image in another; `found` false where the flow does not come back.
struct Flow {
  std::vector<cv::Point2f> points;
  std::vector<bool> found;
};

Flow FlowBetween(const std::vector<cv::Mat>& from,
                 const std::vector<cv::Mat>& to,
                 const std::vector<cv::Point2f>& points,
                 const std::vector<cv::Point2f>& guess,
                 int levels) {
  Flow flow{guess, std::vector<bool>(points.size(), false)};
  if (points.empty()) return flow;
  std::vector<unsigned char> there, back;
  std::vector<float> error;
  std::vector<cv::Point2f> again = points;
  constexpr int kGuess = cv::OPTFLOW_USE_INITIAL_FLOW;
  cv::calcOpticalFlowPyrLK(
      from, to, points, flow.points, there, error, kWindow, levels, kPrecise, kGuess);
  cv::calcOpticalFlowPyrLK(
      to, from, flow.points, again, back, error, kWindow, levels, kPrecise, kGuess);
  for (size_t i = 0; i < points.size(); ++i) {
    flow.found[i] = there[i] != 0 && back[i] != 0 && cv::norm(again[i] - points[i]) <= kRoundTrip;
  }
  return flow;
}

void MakeRoot(cv::Mat* descriptors) {
  for (int row = 0; row < descriptors->rows; ++row) {
    cv::Mat one = descriptors->row(row);
    one /= std::max(1e-12, cv::norm(one, cv::NORM_L1));
    cv::sqrt(one, one);
  }
}

// Strongest key points of each cell of a grid of `wanted` cells, about, away from `taken`.
std::vector<cv::KeyPoint> Spread(std::vector<cv::KeyPoint> keys,
                                 const cv::Size& size,
                                 int wanted,
                                 std::span<const cv::Point2f> taken,
                                 double apart) {
  const double cell = std::sqrt(static_cast<double>(size.area()) / std::max(1, wanted));
  const int columns = static_cast<int>(std::ceil(size.width / cell));
  const int rows = static_cast<int>(std::ceil(size.height / cell));
  std::vector<bool> full(static_cast<size_t>(columns) * static_cast<size_t>(rows), false);
  const auto cell_of = [&](const cv::Point2f& p) {
    const int x = std::clamp(static_cast<int>(p.x / cell), 0, columns - 1);
    const int y = std::clamp(static_cast<int>(p.y / cell), 0, rows - 1);
    return static_cast<size_t>(y) * static_cast<size_t>(columns) + static_cast<size_t>(x);
  };
  cv::Mat free(size, CV_8U, cv::Scalar(1));
  for (const cv::Point2f& p : taken) {
    full[cell_of(p)] = true;
    cv::circle(free, p, static_cast<int>(apart), cv::Scalar(0), cv::FILLED);
  }
  std::ranges::stable_sort(keys, std::greater<>(), &cv::KeyPoint::response);
  std::vector<cv::KeyPoint> chosen;
  for (const cv::KeyPoint& key : keys) {
    const size_t at = cell_of(key.pt);
    if (full[at] || free.at<unsigned char>(key.pt) == 0) continue;
    full[at] = true;
    chosen.push_back(key);
  }
  return chosen;
}

}  // namespace

ImageFeatures FindFeatures(const cv::Mat& image,
                           int wanted,
                           std::span<const cv::Point2f> taken,
                           double apart) {
  const cv::Ptr<cv::SIFT> sift = cv::SIFT::create(0, 3, kContrast);
  std::vector<cv::KeyPoint> keys;
  sift->detect(image, keys);
  keys = Spread(std::move(keys), image.size(), wanted, taken, apart);
  ImageFeatures features;
  if (keys.empty()) return features;
  sift->compute(image, keys, features.descriptors);
  MakeRoot(&features.descriptors);
  for (const cv::KeyPoint& key : keys) features.points.push_back(key.pt - kUpscaled);
  return features;
}

std::vector<std::pair<int, int>> MatchDescriptors(const cv::Mat& a, const cv::Mat& b) {
  std::vector<std::pair<int, int>> pairs;
  if (a.rows < 2 || b.rows < 2) return pairs;
  const cv::BFMatcher matcher(cv::NORM_L2);
  std::vector<std::vector<cv::DMatch>> forward, backward;
  matcher.knnMatch(a, b, forward, 2);
  matcher.knnMatch(b, a, backward, 1);
  for (const auto& best : forward) {
    if (best[0].distance > kRatio * best[1].distance) continue;
    const int back = backward[static_cast<size_t>(best[0].trainIdx)][0].trainIdx;
    if (back == best[0].queryIdx) pairs.emplace_back(best[0].queryIdx, best[0].trainIdx);
  }
  return pairs;
}

FeatureTracker::FeatureTracker(const std::vector<BundleCamera>& cameras,
                               const FeatureOptions& options,
                               int first_number)
    : cameras_(cameras),
      options_(options),
      first_number_(first_number),
      next_number_(first_number),
      last_(cameras.size()),
      views_(cameras.size()) {}

void FeatureTracker::AddFrame(const std::string& name, const std::vector<cv::Mat>& images) {
  std::vector<Pyramid> pyramids;
  for (const cv::Mat& image : images) pyramids.push_back(MakePyramid(image));
  const size_t before = tracks_.size();
  for (size_t c = 0; c < images.size(); ++c) {
    Follow(c, pyramids[c]);
    MeasureAgainstKeys(c, pyramids[c]);
  }
  DropLost();
  if (!images[0].empty()) {
    const size_t first_new = tracks_.size();
    const bool jerk = static_cast<double>(tracks_.size()) < kLost * static_cast<double>(before);
    if (jerk || static_cast<double>(tracks_.size()) < kRefill * options_.wanted) {
      FindNew(images, pyramids);
    }
    FindInOthers(first_new, images, pyramids);
  }
  for (size_t c = 0; c < images.size(); ++c) {
    View view{.frame = name, .observations = {}};
    for (const Track& track : tracks_) {
      if (!track.now[c]) continue;
      Observation seen{.marker = track.number};
      seen.values[0] = track.now[c]->x;
      seen.values[1] = track.now[c]->y;
      view.observations.push_back(seen);
    }
    if (!view.observations.empty()) views_[c].push_back(std::move(view));
  }
  last_ = std::move(pyramids);
}

// Optical flow from the last image of this camera.
void FeatureTracker::Follow(size_t camera, const Pyramid& pyramid) {
  std::vector<size_t> followed;
  std::vector<cv::Point2f> points;
  for (size_t i = 0; i < tracks_.size(); ++i) {
    std::optional<cv::Point2f>& now = tracks_[i].now[camera];
    if (!now) continue;
    followed.push_back(i);
    points.push_back(*now);
    now.reset();
  }
  if (pyramid.empty() || last_[camera].empty()) return;
  const Flow flow = FlowBetween(last_[camera], pyramid, points, points, kLevels);
  for (size_t i = 0; i < followed.size(); ++i) {
    if (flow.found[i]) tracks_[followed[i]].now[camera] = flow.points[i];
  }
}

// The same patch for all observations of a track: its errors do not add up.
void FeatureTracker::MeasureAgainstKeys(size_t camera, const Pyramid& pyramid) {
  std::map<const KeyImage*, std::vector<size_t>> by_key;
  for (size_t i = 0; i < tracks_.size(); ++i) {
    if (tracks_[i].now[camera]) by_key[tracks_[i].key.get()].push_back(i);
  }
  for (const auto& [key, indices] : by_key) {
    std::vector<cv::Point2f> from, guess;
    for (const size_t i : indices) {
      from.push_back(tracks_[i].in_key);
      guess.push_back(*tracks_[i].now[camera]);
    }
    const Flow flow = FlowBetween(key->pyramid, pyramid, from, guess, 0);
    for (size_t i = 0; i < indices.size(); ++i) {
      std::optional<cv::Point2f>& now = tracks_[indices[i]].now[camera];
      if (flow.found[i] && cv::norm(flow.points[i] - guess[i]) <= kFromKey) {
        now = flow.points[i];
      } else {
        now.reset();
      }
    }
  }
}

// A track lives in the first camera.
void FeatureTracker::DropLost() {
  std::erase_if(tracks_, [](const Track& track) { return !track.now[0]; });
}

void FeatureTracker::FindNew(const std::vector<cv::Mat>& images,
                             const std::vector<Pyramid>& pyramids) {
  constexpr double kApart = 5;  // px
  std::vector<cv::Point2f> taken;
  for (const Track& track : tracks_) taken.push_back(*track.now[0]);
  const ImageFeatures features = FindFeatures(images[0], options_.wanted, taken, kApart);
  const auto key = std::make_shared<const KeyImage>(KeyImage{images[0], pyramids[0]});
  for (const cv::Point2f& point : features.points) {
    Track track{.number = next_number_++,
                .key = key,
                .in_key = point,
                .now = std::vector<std::optional<cv::Point2f>>(images.size())};
    track.now[0] = point;
    tracks_.push_back(std::move(track));
  }
  if (!features.points.empty()) descriptors_.push_back(features.descriptors);
}

// Points that another camera does not show yet are searched along the epipolar curve.
void FeatureTracker::FindInOthers(size_t first_track,
                                  const std::vector<cv::Mat>& images,
                                  const std::vector<Pyramid>& pyramids) {
  for (size_t c = 1; c < images.size(); ++c) {
    if (images[c].empty()) continue;
    std::vector<size_t> indices;
    std::vector<cv::Point2f> from, guess;
    for (size_t i = first_track; i < tracks_.size(); ++i) {
      const std::optional<cv::Point2f> found = SearchEpipolarCurve(
          {&cameras_[0], images.data()}, *tracks_[i].now[0], {&cameras_[c], &images[c]});
      if (!found) continue;
      indices.push_back(i);
      from.push_back(tracks_[i].in_key);
      guess.push_back(*found);
    }
    const Flow flow = FlowBetween(pyramids[0], pyramids[c], from, guess, 0);
    for (size_t i = 0; i < indices.size(); ++i) {
      if (flow.found[i] && cv::norm(flow.points[i] - guess[i]) <= kFromKey) {
        tracks_[indices[i]].now[c] = flow.points[i];
      }
    }
  }
}

}  // namespace plenocal
