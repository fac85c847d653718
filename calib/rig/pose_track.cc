// SPDX-License-Identifier: Apache-2.0
#include "calib/rig/pose_track.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "calib/base/statistics.h"

namespace plenocal {
namespace {

constexpr double kLongestShift = 1;  // s

// Minus the logarithm of the likelihood of the frames' poses at a shift, but for a constant.
class ShiftCost {
 public:
  ShiftCost(const PoseTrack& track,
            std::span<const TimedFrame> frames,
            const OutsideOptions& options)
      : track_(track), frames_(frames), options_(options) {}

  double operator()(double shift) const {
    const TrackMatch match = MatchTrack(track_, frames_, shift);
    // Frames at the ends of the track come and go with the shift: the cost is that of all of them.
    if (2 * match.poses.size() < frames_.size()) return kNone;
    const auto fit = FitOutsidePoses(match.poses, options_);
    if (!fit || !(fit->translation_sigma > 0) || !(fit->rotation_sigma > 0)) return kNone;
    const auto used = static_cast<double>(std::ranges::count(fit->used, true));
    const double part = std::max(0.1, used / static_cast<double>(fit->used.size()));
    return 3 * static_cast<double>(frames_.size()) *
           std::log(fit->translation_sigma / part * fit->rotation_sigma / part);
  }

  static constexpr double kNone = std::numeric_limits<double>::infinity();

 private:
  const PoseTrack& track_;
  std::span<const TimedFrame> frames_;
  OutsideOptions options_;
};

// The least cost between `low` and `high`, by golden sections.
double Minimise(const ShiftCost& cost, double low, double high) {
  constexpr int kSteps = 18;  // to a 1e-4 of the interval
  const double ratio = (std::sqrt(5.0) - 1) / 2;
  double a = high - ratio * (high - low), b = low + ratio * (high - low);
  double at_a = cost(a), at_b = cost(b);
  for (int step = 0; step < kSteps; ++step) {
    if (at_a < at_b) {
      high = b;
      b = a;
      at_b = at_a;
      a = high - ratio * (high - low);
      at_a = cost(a);
    } else {
      low = a;
      a = b;
      at_a = at_b;
      b = low + ratio * (high - low);
      at_b = cost(b);
    }
  }
  return (low + high) / 2;
}

}  // namespace

PoseTrack::PoseTrack(std::vector<double> times, std::vector<RigidTransform> poses)
    : times_(std::move(times)), poses_(std::move(poses)) {
  constexpr double kGap = 3;  // usual intervals
  std::vector<double> intervals;
  for (size_t i = 1; i < times_.size(); ++i) intervals.push_back(times_[i] - times_[i - 1]);
  longest_gap_ = kGap * Median(intervals);
}

std::optional<RigidTransform> PoseTrack::At(double time) const {
  const auto after = std::ranges::lower_bound(times_, time);
  if (after == times_.end()) return std::nullopt;
  const auto next = static_cast<size_t>(after - times_.begin());
  if (times_[next] == time) return poses_[next];
  if (next == 0 || times_[next] - times_[next - 1] > longest_gap_) return std::nullopt;
  const double part = (time - times_[next - 1]) / (times_[next] - times_[next - 1]);
  const RigidTransform &a = poses_[next - 1], &b = poses_[next];
  return RigidTransform{ExpRotation(part * LogRotation(b.R * a.R.transpose())) * a.R,
                        a.t + part * (b.t - a.t)};
}

TrackMatch MatchTrack(const PoseTrack& track, std::span<const TimedFrame> frames, double shift) {
  TrackMatch match;
  for (size_t f = 0; f < frames.size(); ++f) {
    const auto pose = track.At(frames[f].time + shift);
    if (!pose) continue;
    match.poses.push_back({*pose, frames[f].T_rig_target});
    match.frames.push_back(f);
  }
  return match;
}

std::optional<TrackShift> FindTrackShift(const PoseTrack& track,
                                         std::span<const TimedFrame> frames,
                                         const OutsideOptions& options) {
  constexpr int kCoarse = 50;  // steps each way
  constexpr double kStep = kLongestShift / kCoarse;
  constexpr size_t kFew = 20;  // frames, for the coarse search
  std::vector<TimedFrame> few;
  for (size_t f = 0; f < frames.size(); f += frames.size() / kFew + 1) few.push_back(frames[f]);
  const ShiftCost coarse_cost(track, few, options);
  double best = 0, least = coarse_cost(0);
  for (int i = -kCoarse; i <= kCoarse; ++i) {
    const double at = coarse_cost(i * kStep);
    if (!(at < least)) continue;
    least = at;
    best = i * kStep;
  }
  const ShiftCost cost(track, frames, options);
  best = Minimise(cost, best - kStep, best + kStep);
  const double without = cost(0);
  least = cost(best);
  if (!std::isfinite(least)) return std::nullopt;
  // Twice the gain is chi-square with one degree of freedom when there is no shift.
  constexpr double kLevel = 1e-4;
  if (2 * (without - least) < ChiSquareQuantile(1, kLevel)) return std::nullopt;
  // From the cost's curvature, over a distance at which it rises by about one.
  double distance = kStep / 10;
  double rise = 0;
  for (int i = 0; i < 5; ++i) {
    rise = (cost(best + distance) + cost(best - distance)) / 2 - least;
    if (!(rise > 0) || !std::isfinite(rise)) return std::nullopt;
    if (std::abs(std::log(rise)) < 1) break;
    distance /= std::sqrt(rise);
  }
  return TrackShift{.value = best, .sigma = distance / std::sqrt(2 * rise)};
}

}  // namespace plenocal
