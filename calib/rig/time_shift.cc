// SPDX-License-Identifier: Apache-2.0
#include "calib/rig/time_shift.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <numeric>

#include "calib/base/statistics.h"
#include "calib/rig/local_polynomial.h"

namespace plenocal {
namespace {

constexpr size_t kFewestFrames = 5, kMostFrames = 13;

// Frames in the order of their times.
std::vector<size_t> InOrder(const RigTimes& times) {
  std::vector<size_t> order(times.frame.size());
  std::iota(order.begin(), order.end(), size_t{0});
  std::ranges::stable_sort(order,
                           [&](size_t a, size_t b) { return times.frame[a] < times.frame[b]; });
  return order;
}

Eigen::Vector3d MiddleOfMarkers(const Bundle& bundle) {
  Eigen::Vector3d middle = Eigen::Vector3d::Zero();
  for (const BundleMarker& marker : bundle.markers) middle += marker.nominal;
  return middle / std::max(1.0, static_cast<double>(bundle.markers.size()));
}

}  // namespace

std::optional<RigTimes> TimesOf(std::span<const CameraInput> cameras,
                                const std::vector<std::string>& frames) {
  if (cameras.size() < 2 || frames.size() < kFewestFrames) return std::nullopt;
  std::map<std::string, size_t> index;
  for (size_t f = 0; f < frames.size(); ++f) index[frames[f]] = f;
  constexpr double kNone = std::numeric_limits<double>::quiet_NaN();
  RigTimes times{.frame = std::vector<double>(frames.size(), kNone),
                 .after_frame = std::vector<double>(frames.size() * cameras.size(), 0.0)};
  for (size_t c = 0; c < cameras.size(); ++c) {
    for (const View& view : cameras[c].views) {
      const auto frame = index.find(view.frame);
      if (frame == index.end()) continue;
      const auto time = cameras[c].times.find(view.frame);
      if (time == cameras[c].times.end()) return std::nullopt;
      double& of_frame = times.frame[frame->second];
      if (std::isnan(of_frame)) of_frame = time->second;
      times.after_frame[frame->second * cameras.size() + c] = time->second - of_frame;
    }
  }
  std::vector<double> intervals;
  const std::vector<size_t> order = InOrder(times);
  for (size_t i = 1; i < order.size(); ++i) {
    intervals.push_back(times.frame[order[i]] - times.frame[order[i - 1]]);
    if (!(intervals.back() > 0)) return std::nullopt;  // one time twice, or none
  }
  times.interval = Median(intervals);
  return times;
}

namespace {

// Error of each frame's position as predicted from its neighbours.
struct Prediction {
  size_t window = kFewestFrames;                           // frames, that in the middle included
  double error = std::numeric_limits<double>::infinity();  // m, median
  double step = 0;                                         // m, median way to the frame before
};

Prediction PredictPlaces(const Bundle& bundle, const RigTimes& times, size_t window) {
  const std::vector<size_t> order = InOrder(times);
  const Eigen::Vector3d middle = MiddleOfMarkers(bundle);
  const auto place = [&](size_t i) -> Eigen::Vector3d {
    return bundle.T_rig_target[order[i]] * middle;
  };
  std::vector<double> errors, steps;
  for (size_t i = window / 2; i + window / 2 < order.size(); ++i) {
    std::vector<size_t> neighbours;
    std::vector<double> nodes;
    for (size_t k = i - window / 2; k <= i + window / 2; ++k) {
      if (k == i) continue;
      neighbours.push_back(k);
      nodes.push_back(times.frame[order[k]]);
    }
    const Eigen::VectorXd weights =
        WeightsAt(times.frame[order[i]], nodes, static_cast<int>(window) - 2).value;
    Eigen::Vector3d error = -place(i);
    for (size_t k = 0; k < nodes.size(); ++k) {
      error += weights[static_cast<Eigen::Index>(k)] * place(neighbours[k]);
    }
    errors.push_back(error.norm());
    steps.push_back((place(i) - place(i - 1)).norm());
  }
  if (errors.empty()) return {.window = window};
  return {.window = window, .error = Median(errors), .step = Median(steps)};
}

// With the number of neighbours that predicts best: few where poses are noisy, many where frames
// are far apart. The polynomial of degree n - 1 through n frames has a velocity in error by the
// part (w h)^(n - 1) ((n - 1)/2)!^2 / n! of a motion of angular frequency w sampled at intervals h.
Prediction BestPrediction(const Bundle& bundle, const RigTimes& times) {
  Prediction best;
  for (size_t window = kFewestFrames; window <= kMostFrames; window += 2) {
    const Prediction prediction = PredictPlaces(bundle, times, window);
    if (prediction.error < best.error) best = prediction;
  }
  return best;
}

}  // namespace

bool ShowsMotion(const Bundle& bundle, const RigTimes& times) {
  constexpr double kKnown = 1.0 / 3;
  const Prediction prediction = BestPrediction(bundle, times);
  return prediction.error < kKnown * prediction.step;
}

void AddTimeShifts(const RigTimes& times, Bundle* bundle) {
  for (size_t c = 1; c < bundle->cameras.size(); ++c) {
    AddNuisance(nuisances::kTimeShift, times.interval, &bundle->cameras[c]);
  }
  UpdateMotion(times, bundle);
}

void UpdateMotion(const RigTimes& times, Bundle* bundle) {
  const std::vector<size_t> order = InOrder(times);
  const size_t cameras = bundle->cameras.size();
  const size_t best = BestPrediction(*bundle, times).window;
  bundle->motion.assign(order.size() * cameras, {});
  for (size_t i = 0; i < order.size(); ++i) {
    const size_t frame = order[i];
    // Frames at both sides as far as possible: beyond them a polynomial multiplies the poses'
    // noise.
    const size_t beside = std::min(i, order.size() - 1 - i);
    const size_t window = std::clamp(2 * beside + 1, kFewestFrames, best);
    const size_t first = std::min(i < window / 2 ? 0 : i - window / 2, order.size() - window);
    std::vector<double> nodes;
    Eigen::Matrix<double, 6, Eigen::Dynamic> poses(6, window);
    for (size_t k = 0; k < window; ++k) {
      const size_t other = order[first + k];
      nodes.push_back(times.frame[other] - times.frame[frame]);
      poses.col(static_cast<Eigen::Index>(k)) =
          LocalCoordinates(bundle->T_rig_target[frame], bundle->T_rig_target[other]);
    }
    for (size_t c = 0; c < cameras; ++c) {
      const BundleCamera& camera = bundle->cameras[c];
      const std::optional<size_t> index = camera.Find(nuisances::kTimeShift);
      const double shift = index ? camera.params[*index] : 0;
      const double after = times.after_frame[bundle->View(frame, c)] + shift;
      const PolynomialWeights weights = WeightsAt(after, nodes, static_cast<int>(window) - 1);
      ViewMotion& motion = bundle->motion[bundle->View(frame, c)];
      motion.velocity = poses * weights.derivative;
      motion.at_zero_shift = poses * weights.value - shift * motion.velocity;
    }
  }
}

}  // namespace plenocal
