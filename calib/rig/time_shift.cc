// SPDX-License-Identifier: Apache-2.0
#include "calib/rig/time_shift.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <map>
#include <numeric>

#include "calib/base/statistics.h"

namespace plenocal {
namespace {

// Frames through which a polynomial of the fourth degree is laid: its velocity at the middle one is
// in error by (w h)^4 / 30 of a motion of angular frequency w, sampled at intervals h.
constexpr size_t kWindow = 5;

// Frames in the order of their times.
std::vector<size_t> InOrder(const RigTimes& times) {
  std::vector<size_t> order(times.frame.size());
  std::iota(order.begin(), order.end(), size_t{0});
  std::ranges::stable_sort(order,
                           [&](size_t a, size_t b) { return times.frame[a] < times.frame[b]; });
  return order;
}

// Weights of the values at `nodes` in the polynomial through them, at x, and in its derivative
// (Lagrange).
struct Weights {
  std::vector<double> value, derivative;
};

Weights WeightsAt(double x, std::span<const double> nodes) {
  Weights weights;
  for (size_t i = 0; i < nodes.size(); ++i) {
    double value = 1, derivative = 0;
    for (size_t j = 0; j < nodes.size(); ++j) {
      if (j == i) continue;
      const double factor = 1 / (nodes[i] - nodes[j]);
      derivative = (derivative * (x - nodes[j]) + value) * factor;
      value *= (x - nodes[j]) * factor;
    }
    weights.value.push_back(value);
    weights.derivative.push_back(derivative);
  }
  return weights;
}

// Where `to` is in the chart about `from`.
Vector6d ChartOf(const RigidTransform& to, const RigidTransform& from) {
  Vector6d delta;
  delta << to.t - from.t, LogRotation(to.R * from.R.transpose());
  return delta;
}

Eigen::Vector3d MiddleOfMarkers(const Bundle& bundle) {
  Eigen::Vector3d middle = Eigen::Vector3d::Zero();
  for (const BundleMarker& marker : bundle.markers) middle += marker.nominal;
  return middle / std::max(1.0, static_cast<double>(bundle.markers.size()));
}

}  // namespace

std::optional<RigTimes> TimesOf(std::span<const CameraInput> cameras,
                                const std::vector<std::string>& frames) {
  if (cameras.size() < 2 || frames.size() < kWindow) return std::nullopt;
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

bool ShowsMotion(const Bundle& bundle, const RigTimes& times) {
  constexpr double kKnown = 1.0 / 3;
  const std::vector<size_t> order = InOrder(times);
  const Eigen::Vector3d middle = MiddleOfMarkers(bundle);
  std::vector<double> errors, steps;
  for (size_t i = 2; i + 2 < order.size(); ++i) {
    const std::array neighbours{order[i - 2], order[i - 1], order[i + 1], order[i + 2]};
    std::array<double, 4> nodes;
    for (size_t k = 0; k < nodes.size(); ++k) nodes[k] = times.frame[neighbours[k]];
    const std::vector<double> weights = WeightsAt(times.frame[order[i]], nodes).value;
    const auto place = [&](size_t frame) -> Eigen::Vector3d {
      return bundle.T_rig_target[frame] * middle;
    };
    Eigen::Vector3d error = -place(order[i]);
    for (size_t k = 0; k < nodes.size(); ++k) error += weights[k] * place(neighbours[k]);
    errors.push_back(error.norm());
    steps.push_back((place(order[i]) - place(order[i - 1])).norm());
  }
  return !errors.empty() && Median(errors) < kKnown * Median(steps);
}

void AddTimeShifts(const RigTimes& times, Bundle* bundle) {
  for (size_t c = 1; c < bundle->cameras.size(); ++c) {
    BundleCamera& camera = bundle->cameras[c];
    camera.at_bound.clear();  // of the adjustment before
    camera.rules.resize(camera.params.size());
    camera.rules.push_back({.prior = ParamRule::Prior{.value = 0, .sigma = times.interval}});
    camera.time_shift = camera.params.size();
    camera.params.push_back(0);
    camera.fixed.push_back(false);
  }
  UpdateMotion(times, bundle);
}

void UpdateMotion(const RigTimes& times, Bundle* bundle) {
  const std::vector<size_t> order = InOrder(times);
  const size_t cameras = bundle->cameras.size();
  bundle->motion.assign(order.size() * cameras, {});
  for (size_t i = 0; i < order.size(); ++i) {
    const size_t frame = order[i];
    const size_t first = std::min(i < kWindow / 2 ? 0 : i - kWindow / 2, order.size() - kWindow);
    std::array<double, kWindow> nodes;
    std::array<Vector6d, kWindow> poses;
    for (size_t k = 0; k < kWindow; ++k) {
      const size_t other = order[first + k];
      nodes[k] = times.frame[other] - times.frame[frame];
      poses[k] = ChartOf(bundle->T_rig_target[other], bundle->T_rig_target[frame]);
    }
    for (size_t c = 0; c < cameras; ++c) {
      const BundleCamera& camera = bundle->cameras[c];
      const double shift = camera.time_shift ? camera.params[*camera.time_shift] : 0;
      const double after = times.after_frame[bundle->View(frame, c)] + shift;
      const Weights weights = WeightsAt(after, nodes);
      ViewMotion& motion = bundle->motion[bundle->View(frame, c)];
      Vector6d way = Vector6d::Zero();
      for (size_t k = 0; k < kWindow; ++k) {
        way += weights.value[k] * poses[k];
        motion.velocity += weights.derivative[k] * poses[k];
      }
      motion.at_zero_shift = way - shift * motion.velocity;
    }
  }
}

}  // namespace plenocal
