// SPDX-License-Identifier: Apache-2.0
#include "assess/causes/recording_causes.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <numeric>
#include <optional>
#include <span>

#include "assess/causes/view_rows.h"
#include "calib/base/statistics.h"
#include "calib/noise/camera_noise.h"

namespace plenocal {
namespace {

constexpr double kCauseLevel = 1e-3;  // false alarms of a test, a camera

// ---- the same image twice

// Sorted by marker and occurrence.
using Points = std::vector<std::pair<std::pair<int, int>, Eigen::Vector2d>>;

std::map<int, Points> PointsByFrame(const Bundle& bundle, size_t camera) {
  std::map<int, Points> frames;
  int occurrence = 0, last_marker = -1, last_frame = -1;
  for (const BundleObservation& observation : bundle.observations) {
    if (observation.camera != static_cast<int>(camera)) continue;
    const bool again = observation.marker == last_marker && observation.frame == last_frame;
    occurrence = again ? occurrence + 1 : 0;
    last_marker = observation.marker;
    last_frame = observation.frame;
    frames[observation.frame].push_back(
        {{observation.marker, occurrence},
         Eigen::Vector2d(observation.seen.values[0], observation.seen.values[1])});
  }
  return frames;
}

// Whether two images have the same points: the mean square of a coordinate's difference is at most
// `limit`, px^2.
bool AreSame(const Points& a, const Points& b, double limit) {
  constexpr size_t kLeast = 6;
  // Of equal images no single point is so far off; most pairs differ in their first one.
  constexpr double kFarOff = 100;
  double sum = 0;
  size_t count = 0;
  auto other = b.begin();
  for (const auto& [key, place] : a) {
    while (other != b.end() && other->first < key) ++other;
    if (other == b.end()) break;
    if (other->first != key) continue;
    const double square = (place - other->second).squaredNorm();
    if (square > kFarOff * limit) return false;
    sum += square;
    ++count;
  }
  return count >= kLeast && 2 * count >= std::max(a.size(), b.size()) &&
         sum <= limit * 2.0 * static_cast<double>(count);
}

// x of the target in the rig, m.
double TargetX(const Bundle& bundle, int frame) {
  return bundle.T_rig_target[static_cast<size_t>(frame)].t.x();
}

std::vector<int> SortedByTargetX(const std::map<int, Points>& frames, const Bundle& bundle) {
  std::vector<int> sorted;
  for (const auto& [frame, points] : frames) sorted.push_back(frame);
  std::ranges::stable_sort(sorted, {}, [&](int frame) { return TargetX(bundle, frame); });
  return sorted;
}

// Whether two frames may be the same image: whatever part of the points was found, the target is at
// one place. Only such frames are compared, since all pairs of a long recording take too long.
bool AreNear(const Bundle& bundle, int a, int b) {
  constexpr double kPart = 0.05;  // of the distance; poses are far more exact
  return std::abs(TargetX(bundle, b) - TargetX(bundle, a)) <=
         kPart * bundle.T_rig_target[static_cast<size_t>(a)].t.norm();
}

// Two exposures of a target at rest differ by the noise of both; the same image, even compressed
// twice, by much less.
std::vector<Finding> FindDuplicates(const Calibration& calibration, size_t c) {
  constexpr double kPartOfNoise = 0.5;
  const CameraFit& fit = calibration.fits[c];
  double noise = fit.noise_sigma;
  if (fit.detector_sigma > 0) noise = std::min(noise, fit.detector_sigma);
  const double limit = 2 * std::pow(kPartOfNoise * std::max(noise, kSmallestNoise), 2);
  const std::map<int, Points> frames = PointsByFrame(calibration.bundle, c);
  std::map<int, int> copies;  // frame to the next that is the same
  const std::vector<int> sorted = SortedByTargetX(frames, calibration.bundle);
  for (size_t i = 0; i < sorted.size(); ++i) {
    for (size_t j = i + 1; j < sorted.size(); ++j) {
      if (!AreNear(calibration.bundle, sorted[i], sorted[j])) break;
      const auto [a, b] = std::minmax(sorted[i], sorted[j]);
      const auto known = copies.find(a);
      if (known != copies.end() && known->second < b) continue;
      if (AreSame(frames.at(a), frames.at(b), limit)) copies[a] = b;
    }
  }
  if (copies.empty()) return {};
  std::vector<std::string> pairs;
  for (const auto& [a, b] : copies) {
    pairs.push_back(fmt::format("{} = {}",
                                calibration.frames[static_cast<size_t>(a)],
                                calibration.frames[static_cast<size_t>(b)]));
  }
  const std::string& name = calibration.bundle.cameras[c].name;
  constexpr size_t kShown = 5;
  const auto shown = std::span(pairs).first(std::min(kShown, pairs.size()));
  return {{.code = "duplicate_images",
           .grade = Grade::kUsable,
           .cameras = {name},
           .value = static_cast<double>(pairs.size()),
           .limit = 1,
           .what = fmt::format("{}: {} image{} the same as another: {}{}.",
                               name,
                               pairs.size(),
                               pairs.size() == 1 ? " is" : "s are",
                               fmt::join(shown, ", "),
                               pairs.size() > kShown ? ", ..." : ""),
           .remedy = "Remove the copies: they count as measurements of their own, so that standard "
                     "errors are too small."}};
}

// ---- focus or zoom that changed

/// Estimate of one view's own magnification.
struct Zoom {
  int frame = 0;
  double change = 0;       // relative to the camera's
  double information = 0;  // inverse of its variance
};

std::vector<Zoom> ZoomsOf(std::span<const ViewRows> views, ImageSize image_size) {
  std::vector<Zoom> zooms;
  const Eigen::RowVector2d middle((image_size[0] - 1) / 2.0, (image_size[1] - 1) / 2.0);
  for (const ViewRows& view : views) {
    Eigen::MatrixXd X(view.residual.size(), 1);
    for (Eigen::Index i = 0; i < view.noise.size(); ++i) {
      X.block<2, 1>(2 * i, 0) = (view.position.row(i) - middle).transpose() / view.noise[i];
    }
    const Regression regression = Regress(view, X);
    if (!(regression.information(0, 0) > 0)) continue;
    zooms.push_back({view.frame, regression.estimate[0], regression.information(0, 0)});
  }
  return zooms;
}

/// Weighted sums over zooms.
struct Segment {
  double information = 0, sum = 0, squares = 0;

  void Add(const Zoom& zoom) {
    information += zoom.information;
    sum += zoom.information * zoom.change;
    squares += zoom.information * zoom.change * zoom.change;
  }
  [[nodiscard]] Segment operator-(const Segment& other) const {
    return {information - other.information, sum - other.sum, squares - other.squares};
  }
  [[nodiscard]] double Mean() const { return sum / information; }
  [[nodiscard]] double SquaresAboutMean() const { return squares - sum * sum / information; }
};

// A step in the magnification between two parts of the recording: the largest F over all splits.
std::vector<Finding> FindFocusChange(const Calibration& calibration,
                                     size_t c,
                                     std::span<const ViewRows> views) {
  constexpr size_t kLeastPart = 3;  // views before and after
  const BundleCamera& camera = calibration.bundle.cameras[c];
  const std::vector<Zoom> zooms = ZoomsOf(views, camera.image_size);
  if (zooms.size() < 2 * kLeastPart + 2) return {};
  Segment all, before;
  for (const Zoom& zoom : zooms) all.Add(zoom);
  const double of_all = all.SquaresAboutMean();
  double best = 0, change = 0;
  size_t split = 0;
  for (size_t k = 1; k + kLeastPart <= zooms.size(); ++k) {
    before.Add(zooms[k - 1]);
    if (k < kLeastPart) continue;
    const Segment after = all - before;
    const double within = before.SquaresAboutMean() + after.SquaresAboutMean();
    const double degrees = static_cast<double>(zooms.size()) - 2;
    // Not below the noise of the points.
    const double F = (of_all - within) / std::max(1.0, within / degrees);
    if (F <= best) continue;
    best = F;
    change = after.Mean() - before.Mean();
    split = k;
  }
  const double tests = static_cast<double>(zooms.size() - 2 * kLeastPart + 1);
  if (FTail(best, 1, static_cast<double>(zooms.size()) - 2) * tests > kCauseLevel) return {};
  return {
      {.code = "focus_changed",
       .grade = Grade::kUsable,
       .cameras = {camera.name},
       .value = change,
       .limit = 0,
       .what = fmt::format("{}: focus or zoom changed during the recording: from frame {} on the "
                           "image is {:.2f} % {} than before.",
                           camera.name,
                           calibration.frames[static_cast<size_t>(zooms[split].frame)],
                           100 * std::abs(change),
                           change > 0 ? "larger" : "smaller"),
       .remedy = "Turn autofocus, zoom and image stabilisation off and record again, or calibrate "
                 "the two parts as sessions of their own."}};
}

// ---- rolling shutter

// The pose's derivatives times the row: motion of the target while rows are exposed one after the
// other.
Eigen::MatrixXd MotionByRow(const ViewRows& view, int height) {
  Eigen::MatrixXd X = view.pose;
  for (Eigen::Index i = 0; i < view.noise.size(); ++i) {
    X.middleRows<2>(2 * i) *= (view.position(i, 1) - (height - 1) / 2.0) / height;
  }
  return X;
}

std::vector<Finding> FindRollingShutter(const Calibration& calibration,
                                        size_t c,
                                        std::span<const ViewRows> views) {
  const BundleCamera& camera = calibration.bundle.cameras[c];
  double gain = 0, rest = 0, degrees = 0, squares = 0;
  int all = 0;
  for (const ViewRows& view : views) squares += view.residual.squaredNorm();
  // A bent board and a lens that the model does not describe are the same in all views.
  for (const ViewRows& view : WithoutCommonPart({views.begin(), views.end()}, camera.image_size)) {
    if (view.residual.size() < 36) continue;  // pose, motion and twice as many degrees again
    const Regression motion = Regress(view, MotionByRow(view, camera.image_size[1]));
    gain += motion.gain;
    rest += motion.rest;
    degrees += motion.degrees;
    ++all;
  }
  constexpr int kLeastViews = 4;
  if (all < kLeastViews || !(rest > 0)) return {};
  const double F = gain / (6.0 * all) / (rest / degrees);
  if (FTail(F, 6.0 * all, degrees) > kCauseLevel) return {};
  constexpr double kExplains = 0.5;  // part of all squares
  const double by_noise = 6.0 * all * rest / degrees;
  if (gain - by_noise < kExplains * squares) return {};
  const double moved = std::sqrt((gain - by_noise) / squares) * calibration.fits[c].rms;
  return {{.code = "rolling_shutter",
           .grade = Grade::kUsable,
           .cameras = {camera.name},
           .value = moved,
           .limit = 0,
           .what = fmt::format("{}: the residuals go with the image row and a motion in each frame "
                               "({:.2g} px RMS): a rolling shutter and a camera or target that "
                               "moved.",
                               camera.name,
                               moved),
           .remedy = "Hold camera and target still while an image is taken, or use a camera with a "
                     "global shutter."}};
}

// ---- single images

std::vector<Finding> FindFrameOutliers(const Calibration& calibration, size_t c) {
  const Bundle& bundle = calibration.bundle;
  std::map<int, std::vector<double>> lengths;  // by frame, px
  for (const BundleObservation& observation : bundle.observations) {
    if (observation.camera != static_cast<int>(c)) continue;
    double residual[kMaxObservationSize];
    if (!Residual(bundle, observation, residual)) continue;
    lengths[observation.frame].push_back(WeightedLength(bundle, observation, residual));
  }
  std::map<int, double> medians;
  std::vector<double> all;
  for (const auto& [frame, of_frame] : lengths) {
    all.push_back(medians[frame] = Median(of_frame));
  }
  constexpr size_t kLeastFrames = 6;
  if (all.size() < kLeastFrames) return {};
  const double typical = Median(all);
  for (double& value : all) value = std::abs(std::log(value / typical));
  // Medians of images scatter by their size alone; an image that disagrees is far beyond the
  // scatter.
  constexpr double kFactor = 3;
  const double limit = std::max(std::log(kFactor), 6 * 1.4826 * Median(all));
  std::vector<std::string> names;
  double worst = 1;
  for (const auto& [frame, median] : medians) {
    if (std::log(median / typical) < limit) continue;
    names.push_back(calibration.frames[static_cast<size_t>(frame)]);
    worst = std::max(worst, median / typical);
  }
  // Many are no exceptions.
  if (names.empty() || 4 * names.size() > all.size()) return {};
  const std::string& name = bundle.cameras[c].name;
  return {{.code = "frame_outlier",
           .grade = Grade::kUsable,
           .cameras = {name},
           .value = worst,
           .limit = std::exp(limit),
           .what = fmt::format("{}: {} with all others: {} (residuals {:.1f} times the typical "
                               "frame's).",
                               name,
                               names.size() == 1 ? "one frame disagrees" : "some frames disagree",
                               fmt::join(names, ", "),
                               worst),
           .remedy =
               "Look at these images (motion, a wrong detection, another zoom, rotated by the "
               "viewer); leave them out with 'exclude'."}};
}

}  // namespace

std::vector<Finding> FindRepeatedImages(const Calibration& calibration) {
  std::vector<Finding> findings;
  for (size_t c = 0; c < calibration.bundle.cameras.size(); ++c) {
    Append(FindDuplicates(calibration, c), &findings);
  }
  return findings;
}

std::vector<Finding> FindRecordingCauses(const Calibration& calibration) {
  std::vector<Finding> findings;
  for (size_t c = 0; c < calibration.bundle.cameras.size(); ++c) {
    Append(FindFrameOutliers(calibration, c), &findings);
    // Exact (simulated) points have no noise to compare with.
    if (calibration.fits[c].noise_sigma < kRoundingNoise) continue;
    const std::vector<ViewRows> views = RowsOfViews(calibration.bundle, c);
    Append(FindFocusChange(calibration, c, views), &findings);
    Append(FindRollingShutter(calibration, c, views), &findings);
  }
  return findings;
}

}  // namespace plenocal
