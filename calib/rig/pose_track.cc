// SPDX-License-Identifier: Apache-2.0
#include "calib/rig/pose_track.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <utility>

#include "calib/base/statistics.h"
#include "calib/rig/local_polynomial.h"

namespace plenocal {
namespace {

constexpr int kCoarse = 50;              // steps each way
constexpr double kStep = 1.0 / kCoarse;  // s

// Minus the logarithm of the likelihood of the frames' poses at a shift, but for a constant.
class ShiftCost {
 public:
  ShiftCost(const PoseTrack& track,
            std::span<const TimedFrame> frames,
            const OutsideOptions& options)
      : track_(track), frames_(frames), options_(options) {
    options_.standard_errors = false;
  }

  double operator()(double shift) const {
    TrackMatch match = MatchTrack(track_, frames_, shift);
    for (OutsidePose& pose : match.poses) pose.errors = {};  // within the scatter
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

// The shift within a second at which the poses' scatter is most likely; 0 where that explains no
// more than the least of the scatters of so many other poses does.
double SearchShift(const PoseTrack& track,
                   std::span<const TimedFrame> frames,
                   const OutsideOptions& options) {
  constexpr size_t kFew = 20;  // frames
  std::vector<TimedFrame> few;
  for (size_t f = 0; f < frames.size(); f += frames.size() / kFew + 1) few.push_back(frames[f]);
  const ShiftCost cost(track, few, options);
  const double without = cost(0);
  double best = 0, least = without;
  for (int i = -kCoarse; i <= kCoarse; ++i) {
    const double at = cost(i * kStep);
    if (!(at < least)) continue;
    least = at;
    best = i * kStep;
  }
  // The logarithm of a scatter of k numbers has the variance 1 / (2 k): here four times 3 n
  // numbers.
  const double chance_sigma = std::sqrt(6 * static_cast<double>(few.size()));
  constexpr double kSigmas = 5;  // in a hundred scatters
  return without - least > kSigmas * chance_sigma ? best : 0;
}

}  // namespace

// Indices of poses and their weights at one time.
struct PoseTrack::Neighbours {
  std::vector<size_t> poses;
  size_t middle = 0;  // the pose about whose chart they are averaged
  PolynomialWeights weights;
};

PoseTrack::PoseTrack(std::vector<double> times,
                     std::vector<RigidTransform> poses,
                     double frame_interval)
    : times_(std::move(times)), poses_(std::move(poses)) {
  constexpr double kGap = 3;  // usual intervals
  std::vector<double> intervals;
  for (size_t i = 1; i < times_.size(); ++i) intervals.push_back(times_[i] - times_[i - 1]);
  interval_ = Median(intervals);
  const auto is_gap = [&](size_t before) { return intervals[before] > kGap * interval_; };
  first_.resize(times_.size(), 0);
  end_.resize(times_.size(), times_.size());
  for (size_t i = 1; i < times_.size(); ++i) first_[i] = is_gap(i - 1) ? i : first_[i - 1];
  for (size_t i = times_.size(); i-- > 1;) end_[i - 1] = is_gap(i - 1) ? i : end_[i];
  Choose(frame_interval);
  if (frame_interval > 0) {
    errors_.frames = std::max(1.0, interval_ * window_.Length() / frame_interval);
  }
}

PoseTrack::Neighbours PoseTrack::Around(double time,
                                        const Window& window,
                                        bool without_nearest) const {
  const auto after = std::ranges::lower_bound(times_, time);
  const auto next = std::min(static_cast<size_t>(after - times_.begin()), times_.size() - 1);
  size_t first = next, end = next + 1;
  double reach = window.reach * interval_;
  while (first > first_[next] && time - times_[first - 1] < reach) --first;
  while (end < end_[next] && times_[end] - time < reach) ++end;
  const size_t spare = without_nearest ? 1 : 0;
  if (end - first < window.poses + spare || reach == 0 || times_[next] - time >= reach) {
    const size_t count = std::min(window.poses + spare, end_[next] - first_[next]);
    first = std::clamp(next - std::min(next, count / 2), first_[next], end_[next] - count);
    end = first + count;
    reach = std::numeric_limits<double>::infinity();
  }
  Neighbours neighbours{.poses = {}, .middle = (first + end) / 2, .weights = {}};
  std::vector<double> nodes;
  for (size_t i = first; i < end; ++i) {
    if (without_nearest && i == next) continue;
    neighbours.poses.push_back(i);
    nodes.push_back(times_[i]);
  }
  const int degree = std::min(window.degree, static_cast<int>(nodes.size()) - 1);
  neighbours.weights = WeightsAt(time, nodes, degree, reach);
  return neighbours;
}

PoseTrack::Moving PoseTrack::PoseOf(const Neighbours& neighbours) const {
  const RigidTransform& middle = poses_[neighbours.middle];
  Vector6d change = Vector6d::Zero(), velocity = Vector6d::Zero();
  for (size_t k = 0; k < neighbours.poses.size(); ++k) {
    const Vector6d away = LocalCoordinates(middle, poses_[neighbours.poses[k]]);
    change += neighbours.weights.value[static_cast<Eigen::Index>(k)] * away;
    velocity += neighbours.weights.derivative[static_cast<Eigen::Index>(k)] * away;
  }
  return {Retract(middle, change), velocity};
}

void PoseTrack::Choose(double longest) {
  constexpr size_t kMostPredicted = 1000, kFewestPredicted = 20;
  constexpr double kOutlier = 10;  // times the median square
  constexpr std::array<Window, 9> kWindows{{{1, 2, 0},
                                            {3, 4, 0},
                                            {3, 4, 3},
                                            {3, 4, 4},
                                            {3, 4, 6},
                                            {3, 4, 8},
                                            {3, 4, 12},
                                            {3, 4, 16},
                                            {3, 4, 24}}};
  double least = std::numeric_limits<double>::infinity();
  const size_t stride = times_.size() / kMostPredicted + 1;
  for (const Window& window : kWindows) {
    if (window.reach > 0 && interval_ * window.Length() > longest) break;
    std::vector<double> positions, angles;  // squares
    double of_others = 0, of_value = 0, of_derivative = 0;
    for (size_t i = 0; i < times_.size(); i += stride) {
      const auto half = static_cast<size_t>(window.Length() / 2) + 1;
      if (i < first_[i] + half || i + half >= end_[i]) continue;
      const Neighbours others = Around(times_[i], window, true);
      const Vector6d error = LocalCoordinates(PoseOf(others).pose, poses_[i]);
      positions.push_back(error.head<3>().squaredNorm());
      angles.push_back(error.tail<3>().squaredNorm());
      of_others += others.weights.value.squaredNorm();
      // Frames are anywhere between two poses: the fractions of the golden section.
      const double part = std::fmod(0.618 * static_cast<double>(positions.size()), 1.0);
      const Neighbours between =
          Around(times_[i] + part * (times_[i + 1] - times_[i]), window, false);
      of_value += between.weights.value.squaredNorm();
      of_derivative += between.weights.derivative.squaredNorm();
    }
    const auto count = static_cast<double>(positions.size());
    if (positions.size() < kFewestPredicted) continue;
    // Variance of a coordinate; single outliers count little.
    const auto variance = [&](const std::vector<double>& squares) {
      const double most = kOutlier * Median(squares);
      double sum = 0;
      for (const double square : squares) sum += std::min(square, most);
      return sum / (3 * count);
    };
    const double position = variance(positions), angle = variance(angles);
    if (!(position * angle < least)) continue;
    least = position * angle;
    window_ = window;
    // A prediction has the errors of the others beside those of the pose itself.
    const double share = 1 / (1 + of_others / count);
    errors_ = {.single_position = std::sqrt(share * position),
               .single_angle = std::sqrt(share * angle),
               .position = std::sqrt(share * position * of_value / count),
               .angle = std::sqrt(share * angle * of_value / count),
               .velocity = std::sqrt(share * position * of_derivative / count),
               .angular_velocity = std::sqrt(share * angle * of_derivative / count)};
  }
}

std::optional<PoseTrack::Moving> PoseTrack::At(double time) const {
  const auto after = std::ranges::lower_bound(times_, time);
  if (after == times_.end()) return std::nullopt;
  const auto next = static_cast<size_t>(after - times_.begin());
  const bool between = next > 0 && first_[next] == first_[next - 1];
  if (times_[next] != time && !between) return std::nullopt;
  const Neighbours neighbours = Around(time, window_, false);
  Moving moving = PoseOf(neighbours);
  const PolynomialWeights& weights = neighbours.weights;
  const Eigen::Vector2d variance(errors_.single_position * errors_.single_position,
                                 errors_.single_angle * errors_.single_angle);
  moving.covariance << Eigen::Vector3d::Constant(variance[0]),
      Eigen::Vector3d::Constant(variance[1]);
  moving.covariance *= weights.value.dot(weights.derivative);
  return moving;
}

TrackMatch MatchTrack(const PoseTrack& track, std::span<const TimedFrame> frames, double shift) {
  TrackMatch match;
  for (size_t f = 0; f < frames.size(); ++f) {
    const auto at = track.At(frames[f].time + shift);
    if (!at) continue;
    match.poses.push_back(
        {at->pose, frames[f].T_rig_target, frames[f].errors, at->velocity, at->covariance});
    match.frames.push_back(f);
  }
  return match;
}

double FindTrackShift(const PoseTrack& track,
                      std::span<const TimedFrame> frames,
                      OutsideOptions* options) {
  const double found = SearchShift(track, frames, *options);
  // Errors larger than all scatter are not of single poses: motion between few.
  const TrackErrors& errors = track.Errors();
  const auto set_errors = [&](const OutsideFit& fit) {
    options->time_shift =
        FreeTimeShift{errors.velocity * std::min(1.0, fit.translation_sigma / errors.position),
                      errors.angular_velocity * std::min(1.0, fit.rotation_sigma / errors.angle)};
  };
  constexpr int kRounds = 10;
  constexpr double kSettled = 1e-6;  // s
  const bool standard_errors = std::exchange(options->standard_errors, false);
  double shift = found;
  for (int round = 0; round < kRounds; ++round) {
    const auto fit = FitOutsidePoses(MatchTrack(track, frames, shift).poses, *options);
    if (!fit) break;
    shift += fit->time_shift;
    if (options->time_shift && std::abs(fit->time_shift) < kSettled) break;
    set_errors(*fit);
  }
  options->standard_errors = standard_errors;
  return std::abs(shift - found) < kStep ? shift : found;
}

}  // namespace plenocal
