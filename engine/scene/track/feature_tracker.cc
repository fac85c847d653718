// SPDX-License-Identifier: Apache-2.0
#include "engine/scene/track/feature_tracker.h"

#include <algorithm>
#include <cmath>
#include <memory>
#include <opencv2/calib3d.hpp>
#include <opencv2/features2d.hpp>
#include <opencv2/video/tracking.hpp>

#include "calib/base/parallel.h"
#include "engine/scene/track/epipolar_search.h"

namespace plenocal {
namespace {

const cv::Size kWindow(2 * kPatchRadius + 1, 2 * kPatchRadius + 1);
constexpr int kLevels = 3;
// SIFT works on the image at twice its size, whose pixels lie a quarter of a pixel off; OpenCV
// divides by two only.
const cv::Point2f kUpscaled(0.25F, 0.25F);
constexpr double kContrast = 0.01;  // of SIFT: weak features serve as well
// There and back again, px.
constexpr float kRoundTrip = 0.5F;
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
                 int levels) {
  Flow flow{points, std::vector<bool>(points.size(), false)};
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

std::vector<bool> OnOneEpipolarGeometry(const std::vector<cv::Point2f>& a,
                                        const std::vector<cv::Point2f>& b) {
  constexpr double kFromEpipolarLine = 2;  // px
  constexpr size_t kFewestPairs = 15;      // eight always fit
  std::vector<bool> agrees(a.size(), false);
  if (a.size() < kFewestPairs) return agrees;
  std::vector<unsigned char> inlier;
  cv::findFundamentalMat(a, b, inlier, cv::FM_RANSAC, kFromEpipolarLine, 0.99);
  for (size_t i = 0; i < inlier.size(); ++i) agrees[i] = inlier[i] != 0;
  return agrees;
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
  std::vector<Pyramid> pyramids(images.size());
  ParallelFor(images.size(), options_.threads, [&](size_t c) {
    pyramids[c] = MakePyramid(images[c]);
    MeasureAgainstKeys(c, images[c], Follow(c, pyramids[c]));
  });
  if (!images[0].empty()) {
    const auto has_place = [](const Track& track) { return track.now[0].has_value(); };
    const auto found = static_cast<double>(std::ranges::count_if(tracks_, has_place));
    const bool jerk = found < kLost * static_cast<double>(tracks_.size());
    if (jerk) FindAgain(images[0]);
    DropLost();
    const size_t first_new = tracks_.size();
    if (jerk || static_cast<double>(tracks_.size()) < kRefill * options_.wanted) {
      FindNew(images[0]);
    }
    FindInOthers(jerk ? 0 : first_new, images);
  }
  for (size_t c = 0; c < images.size(); ++c) {
    View view{.frame = name, .observations = {}};
    for (const Track& track : tracks_) {
      if (!track.now[c]) continue;
      Observation seen{.marker = track.number};
      seen.values[0] = track.now[c]->point.x;
      seen.values[1] = track.now[c]->point.y;
      seen.detector_sigma = track.now[c]->sigma;
      view.observations.push_back(seen);
    }
    if (!view.observations.empty()) views_[c].push_back(std::move(view));
  }
  last_ = std::move(pyramids);
}

// Optical flow from the last image of this camera. Returns the tracks that it finds.
std::vector<size_t> FeatureTracker::Follow(size_t camera, const Pyramid& pyramid) {
  std::vector<size_t> followed, found;
  std::vector<PatchPlace> last;
  std::vector<cv::Point2f> points;
  for (size_t i = 0; i < tracks_.size(); ++i) {
    std::optional<PatchPlace>& now = tracks_[i].now[camera];
    if (!now) continue;
    followed.push_back(i);
    last.push_back(*now);
    points.push_back(now->point);
    now.reset();
  }
  if (pyramid.empty() || last_[camera].empty()) return found;
  const Flow flow = FlowBetween(last_[camera], pyramid, points, kLevels);
  for (size_t i = 0; i < followed.size(); ++i) {
    if (!flow.found[i]) continue;
    last[i].point = flow.points[i];
    tracks_[followed[i]].now[camera] = last[i];
    found.push_back(followed[i]);
  }
  return found;
}

// The same patch for all observations of a track: its errors do not add up.
void FeatureTracker::MeasureAgainstKeys(size_t camera,
                                        const cv::Mat& image,
                                        const std::vector<size_t>& found) {
  ParallelFor(found.size(), options_.threads, [&](size_t k) {
    Track& track = tracks_[found[k]];
    std::optional<PatchPlace>& now = track.now[camera];
    now = FitPatch(*track.key, track.in_key, image, *now);
  });
}

// Tracks that optical flow has lost, by their descriptors.
void FeatureTracker::FindAgain(const cv::Mat& image) {
  const std::map<size_t, cv::Point2f> guesses = GuessByDescriptors(0, 0, image);
  std::vector<size_t> found;
  for (const auto& [i, place] : guesses) {
    tracks_[i].now[0] = PatchPlace{.point = place};
    found.push_back(i);
  }
  MeasureAgainstKeys(0, image, found);
}

// A track lives in the first camera.
void FeatureTracker::DropLost() {
  std::erase_if(tracks_, [](const Track& track) { return !track.now[0]; });
}

void FeatureTracker::FindNew(const cv::Mat& image) {
  constexpr double kApart = 5;  // px
  std::vector<cv::Point2f> taken;
  for (const Track& track : tracks_) taken.push_back(track.now[0]->point);
  const ImageFeatures features = FindFeatures(image, options_.wanted, taken, kApart);
  const auto key = std::make_shared<const cv::Mat>(image);
  for (size_t i = 0; i < features.points.size(); ++i) {
    Track track{.number = next_number_++,
                .key = key,
                .in_key = features.points[i],
                .now = std::vector<std::optional<PatchPlace>>(views_.size())};
    // The fit to itself shows whether the patch can be fitted; its residuals are none.
    track.now[0] = FitPatch(image, track.in_key, image, {.point = track.in_key});
    descriptors_.push_back(features.descriptors.row(static_cast<int>(i)));
    if (!track.now[0]) continue;
    track.now[0]->sigma = 0;
    tracks_.push_back(std::move(track));
  }
}

std::map<size_t, cv::Point2f> FeatureTracker::GuessAlongCurves(
    size_t camera, size_t first_track, const std::vector<cv::Mat>& images) const {
  std::vector<std::optional<cv::Point2f>> found(tracks_.size() - first_track);
  ParallelFor(found.size(), options_.threads, [&](size_t k) {
    const Track& track = tracks_[first_track + k];
    if (track.now[camera]) return;
    found[k] = SearchEpipolarCurve(
        {&cameras_[0], images.data()}, track.now[0]->point, {&cameras_[camera], &images[camera]});
  });
  std::map<size_t, cv::Point2f> guesses;
  for (size_t k = 0; k < found.size(); ++k) {
    if (found[k]) guesses.emplace(first_track + k, *found[k]);
  }
  return guesses;
}

std::map<size_t, cv::Point2f> FeatureTracker::GuessByDescriptors(size_t camera,
                                                                 size_t first_track,
                                                                 const cv::Mat& image) const {
  std::vector<size_t> searched;
  cv::Mat descriptors;
  for (size_t i = first_track; i < tracks_.size(); ++i) {
    if (tracks_[i].now[camera]) continue;
    searched.push_back(i);
    descriptors.push_back(descriptors_.row(tracks_[i].number - first_number_));
  }
  if (searched.empty()) return {};
  const ImageFeatures features = FindFeatures(image, 2 * options_.wanted, {}, 0);
  std::map<size_t, cv::Point2f> guesses;
  for (const auto& [i, j] : MatchDescriptors(descriptors, features.descriptors)) {
    guesses.emplace(searched[static_cast<size_t>(i)], features.points[static_cast<size_t>(j)]);
  }
  return guesses;
}

// Tracks from `first_track` on that other cameras do not show yet.
void FeatureTracker::FindInOthers(size_t first_track, const std::vector<cv::Mat>& images) {
  for (size_t c = 1; c < images.size(); ++c) {
    if (images[c].empty()) continue;
    std::vector<size_t> found;
    for (const auto& [i, place] : options_.calibrated
                                      ? GuessAlongCurves(c, first_track, images)
                                      : GuessByDescriptors(c, first_track, images[c])) {
      tracks_[i].now[c] = PatchPlace{.point = place};
      found.push_back(i);
    }
    MeasureAgainstKeys(c, images[c], found);
  }
}

// A fit has the noise of two images, of its own and of the key image. The point that the noisy
// patch of the key image shows is the landmark, so that its place there has as much noise as all
// others.
std::vector<std::vector<View>> FeatureTracker::Views() const {
  struct Fits {
    double variance = 0;  // sum over the fits to other images
    int count = 0;
  };
  std::map<int, Fits> fits;
  for (const std::vector<View>& views : views_) {
    for (const View& view : views) {
      for (const Observation& seen : view.observations) {
        if (seen.detector_sigma == 0) continue;
        fits[seen.marker].variance += std::pow(seen.detector_sigma, 2);
        ++fits[seen.marker].count;
      }
    }
  }
  std::vector<std::vector<View>> all = views_;
  for (std::vector<View>& views : all) {
    for (View& view : views) {
      std::erase_if(view.observations,
                    [&](const Observation& seen) { return !fits.contains(seen.marker); });
      for (Observation& seen : view.observations) {
        const Fits& of_track = fits.at(seen.marker);
        const double variance = seen.detector_sigma > 0 ? std::pow(seen.detector_sigma, 2)
                                                        : of_track.variance / of_track.count;
        seen.detector_sigma = std::sqrt(variance / 2);
      }
    }
    std::erase_if(views, [](const View& view) { return view.observations.empty(); });
  }
  return all;
}

std::vector<FeatureTracker::Followed> FeatureTracker::FollowedNow() const {
  std::vector<Followed> followed;
  for (const Track& track : tracks_) {
    if (!track.now[0]) continue;
    followed.push_back({track.number, track.key.get(), track.in_key, *track.now[0]});
  }
  return followed;
}

}  // namespace plenocal
