// SPDX-License-Identifier: Apache-2.0
#include "apps/evaluate/trajectory_metrics.h"

#include <fmt/format.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <numbers>

#include "calib/base/error.h"
#include "calib/base/linear_algebra.h"
#include "calib/base/number_text.h"
#include "calib/camera/rigid_transform.h"

namespace plenocal {
namespace {

constexpr double kDegrees = 180 / std::numbers::pi;

using Points = Eigen::Matrix3Xd;

/// For each time of `from` the index of the nearest in `to`, the earlier one of two.
std::vector<size_t> NearestInTime(const std::vector<double>& from, const std::vector<double>& to) {
  std::vector<size_t> nearest;
  nearest.reserve(from.size());
  size_t at = 0;
  for (const double time : from) {
    while (at + 1 < to.size() && std::abs(to[at + 1] - time) < std::abs(to[at] - time)) ++at;
    nearest.push_back(at);
  }
  return nearest;
}

/// The poses that are paired, column by column.
struct Matched {
  Points estimate;
  Points truth;
};

Matched MatchPoints(const Trajectory& estimate, const Trajectory& truth, const PosePairs& pairs) {
  Matched matched{Points(3, pairs.size()), Points(3, pairs.size())};
  for (size_t i = 0; i < pairs.size(); ++i) {
    const auto column = static_cast<Eigen::Index>(i);
    matched.estimate.col(column) = estimate.positions[pairs[i].first];
    matched.truth.col(column) = truth.positions[pairs[i].second];
  }
  return matched;
}

enum class Scale { kFixed, kEstimated };

Similarity Umeyama(const Matched& matched, Scale scale) {
  const bool with_scale = scale == Scale::kEstimated;
  const Eigen::Matrix4d T = Eigen::umeyama(matched.estimate, matched.truth, with_scale);
  Similarity similarity;
  similarity.s = with_scale ? std::cbrt(T.topLeftCorner<3, 3>().determinant()) : 1;
  similarity.R = T.topLeftCorner<3, 3>() / similarity.s;
  similarity.t = T.topRightCorner<3, 1>();
  return similarity;
}

/// Variances along the principal axes, ascending.
Eigen::Vector3d Spread(const Points& points) {
  const Points centred = points.colwise() - points.rowwise().mean();
  const Eigen::Matrix3d covariance =
      centred * centred.transpose() / static_cast<double>(points.cols());
  return DecomposeSymmetric(covariance).values.cwiseMax(0);
}

[[noreturn]] void Fail(const std::string& what, const std::string& message) {
  throw Error(ErrorKind::kJob, what + ": " + message);
}

constexpr const char* kOpenRotation =
    "so that the rotation about it is not determined; take a longer or winding segment";

/// The alignment with scale; throws when the pairs determine none. `what` begins the message.
Similarity AlignOrFail(const Matched& matched, const std::string& what) {
  const Eigen::Index count = matched.truth.cols();
  if (count < 3) {
    Fail(what,
         fmt::format("{} of the estimate found in the truth, at least 3 are needed",
                     Counted(static_cast<size_t>(count), "pose")));
  }
  for (const auto& [whose, points] :
       {std::pair("the truth", &matched.truth), std::pair("the estimate", &matched.estimate)}) {
    // Rounding of coordinates, and of the eigenvalues made from their squares.
    const double rounding = 1e-14 * points->squaredNorm() / static_cast<double>(count);
    const Eigen::Vector3d spread = Spread(*points);
    if (!(spread[2] > rounding)) Fail(what, fmt::format("{} does not move", whose));
    if (!(spread[1] > rounding)) {
      Fail(what, fmt::format("{} moves along a straight line, {}", whose, kOpenRotation));
    }
  }
  return Umeyama(matched, Scale::kEstimated);
}

/// The same for a short segment: what lies off a line must be explained by the estimate for the
/// most part, or the rotation found is that of its errors.
Similarity AlignSegmentOrFail(const Matched& matched, const std::string& what) {
  Similarity T = AlignOrFail(matched, what);
  const double error =
      ((T.s * T.R * matched.estimate).colwise() + T.t - matched.truth).squaredNorm() /
      static_cast<double>(matched.truth.cols());
  const double off_line = Spread(matched.truth).head<2>().sum();
  if (error > 0.5 * off_line) {
    Fail(what,
         fmt::format("up to the estimate's errors ({:.3g}) the truth moves along a straight line "
                     "({:.3g} off it), {}",
                     std::sqrt(error),
                     std::sqrt(off_line),
                     kOpenRotation));
  }
  return T;
}

std::string Range(const Trajectory& trajectory) {
  return fmt::format("{:.3f} to {:.3f} s", trajectory.times.front(), trajectory.times.back());
}

/// Pairs with a part of the truth; throws when there is none.
PosePairs AssociateOrFail(const Trajectory& estimate,
                          const Trajectory& truth,
                          double tolerance,
                          const std::string& what) {
  PosePairs pairs = Associate(estimate, truth, tolerance);
  if (pairs.empty()) {
    Fail(estimate.path + ": " + what,
         fmt::format("no pose of the estimate ({}) lies within {:g} s of one of the truth ({}); "
                     "see --tolerance",
                     Range(estimate),
                     tolerance,
                     Range(truth)));
  }
  return pairs;
}

Trajectory Part(const Trajectory& whole, size_t begin, size_t end) {
  const auto cut = [&](const auto& values) {
    return std::decay_t<decltype(values)>(values.begin() + static_cast<std::ptrdiff_t>(begin),
                                          values.begin() + static_cast<std::ptrdiff_t>(end));
  };
  Trajectory part;
  part.path = whole.path;
  part.has_times = whole.has_times;
  part.times = cut(whole.times);
  part.positions = cut(whole.positions);
  part.orientations = cut(whole.orientations);
  return part;
}

double Angle(const Eigen::Quaterniond& q) {
  return 2 * std::atan2(q.vec().norm(), std::abs(q.w())) * kDegrees;
}

ErrorStatistics Summarise(std::vector<double> errors) {
  const auto count = static_cast<double>(errors.size());
  ErrorStatistics statistics{};
  const auto [min, max] = std::minmax_element(errors.begin(), errors.end());
  statistics.min = *min;
  statistics.max = *max;
  double sum = 0;
  for (const double error : errors) {
    sum += error;
    statistics.sse += error * error;
  }
  statistics.mean = sum / count;
  statistics.rmse = std::sqrt(statistics.sse / count);
  double deviation = 0;
  for (const double error : errors) deviation += std::pow(error - statistics.mean, 2);
  statistics.std = std::sqrt(deviation / count);
  // For an even number the mean of the middle two, as the reference tools have it.
  const auto middle = errors.begin() + static_cast<std::ptrdiff_t>(errors.size() / 2);
  std::nth_element(errors.begin(), middle, errors.end());
  statistics.median = *middle;
  if (errors.size() % 2 == 0) {
    statistics.median = (statistics.median + *std::max_element(errors.begin(), middle)) / 2;
  }
  return statistics;
}

ErrorStatistics AbsoluteErrors(const Matched& matched, const Similarity& T) {
  std::vector<double> errors(static_cast<size_t>(matched.truth.cols()));
  for (size_t i = 0; i < errors.size(); ++i) {
    const auto column = static_cast<Eigen::Index>(i);
    errors[i] = (T * matched.estimate.col(column) - matched.truth.col(column)).norm();
  }
  return Summarise(std::move(errors));
}

}  // namespace

Eigen::Matrix4d Similarity::Matrix() const {
  Eigen::Matrix4d T = Eigen::Matrix4d::Identity();
  T.topLeftCorner<3, 3>() = s * R;
  T.topRightCorner<3, 1>() = t;
  return T;
}

double Folded(double scale) { return std::max(scale, 1 / scale); }

double LoopMetrics::ScaleMin() const { return absolute_scale / std::sqrt(Folded(ScaleDrift())); }
double LoopMetrics::ScaleMax() const { return absolute_scale * std::sqrt(Folded(ScaleDrift())); }

PosePairs Associate(const Trajectory& estimate, const Trajectory& truth, double tolerance) {
  const std::vector<size_t> in_truth = NearestInTime(estimate.times, truth.times);
  const std::vector<size_t> in_estimate = NearestInTime(truth.times, estimate.times);
  PosePairs pairs;
  for (size_t e = 0; e < in_truth.size(); ++e) {
    const size_t t = in_truth[e];
    if (in_estimate[t] != e || !(std::abs(estimate.times[e] - truth.times[t]) <= tolerance)) {
      continue;
    }
    pairs.emplace_back(e, t);
  }
  return pairs;
}

std::optional<LoopTruth> SplitAtLargestGap(const Trajectory& truth) {
  const std::vector<double>& times = truth.times;
  size_t after = 0;  // first pose after the largest gap
  double largest = 0, next = 0;
  for (size_t i = 1; i < times.size(); ++i) {
    const double gap = times[i] - times[i - 1];
    if (gap > largest) {
      next = std::exchange(largest, gap);
      after = i;
    } else {
      next = std::max(next, gap);
    }
  }
  if (after == 0 || largest < 2 * next || largest < 0.1 * (times.back() - times.front())) {
    return std::nullopt;
  }
  return LoopTruth{Part(truth, 0, after), Part(truth, after, times.size())};
}

LoopMetrics MeasureLoop(const Trajectory& estimate, const LoopTruth& truth, double tolerance) {
  const auto align = [&](const Trajectory& segment, const std::string& what) {
    const PosePairs pairs = AssociateOrFail(estimate, segment, tolerance, what);
    return AlignSegmentOrFail(MatchPoints(estimate, segment, pairs), estimate.path + ": " + what);
  };
  const Similarity T_s_gt = align(truth.start, "start segment");
  return MeasureDrift(estimate, T_s_gt, align(truth.end, "end segment"));
}

LoopMetrics MeasureDrift(const Trajectory& estimate,
                         const Similarity& T_s_gt,
                         const Similarity& T_e_gt) {
  LoopMetrics metrics{};
  metrics.T_s_gt = T_s_gt;
  metrics.T_e_gt = T_e_gt;
  metrics.T_drift = metrics.T_e_gt * metrics.T_s_gt.Inverse();
  metrics.rotation_drift_deg = LogRotation(metrics.T_drift.R).norm() * kDegrees;
  metrics.translation_drift = metrics.T_drift.t.norm();
  metrics.absolute_scale = std::sqrt(metrics.T_s_gt.s * metrics.T_e_gt.s);
  metrics.frames = estimate.Size();
  double squared = 0, length = 0;
  for (size_t i = 0; i < estimate.Size(); ++i) {
    const Eigen::Vector3d& p = estimate.positions[i];
    squared += (metrics.T_s_gt * p - metrics.T_e_gt * p).squaredNorm();
    if (i > 0) length += (p - estimate.positions[i - 1]).norm();
  }
  metrics.alignment_error = std::sqrt(squared / static_cast<double>(estimate.Size()));
  metrics.path_length = metrics.absolute_scale * length;
  return metrics;
}

PathErrors MeasurePath(const Trajectory& estimate,
                       const Trajectory& truth,
                       double tolerance,
                       size_t delta) {
  const PosePairs pairs = AssociateOrFail(estimate, truth, tolerance, "truth");
  if (pairs.size() <= delta) {
    Fail(estimate.path,
         fmt::format("{} poses found in the truth, too few for --delta {}", pairs.size(), delta));
  }
  const Matched matched = MatchPoints(estimate, truth, pairs);
  const Similarity sim3 = AlignOrFail(matched, estimate.path + ": truth");
  const Similarity se3 = Umeyama(matched, Scale::kFixed);

  PathErrors errors{};
  errors.pairs = pairs.size();
  errors.scale = sim3.s;
  errors.ate_unaligned = AbsoluteErrors(matched, {});
  errors.ate_se3 = AbsoluteErrors(matched, se3);
  errors.ate_sim3 = AbsoluteErrors(matched, sim3);
  const Eigen::Quaterniond turn(se3.R);
  std::vector<double> angles;
  angles.reserve(pairs.size());
  for (const auto& [e, t] : pairs) {
    angles.push_back(Angle(truth.orientations[t].conjugate() * (turn * estimate.orientations[e])));
  }
  errors.ate_rotation = Summarise(std::move(angles));

  std::vector<double> rigid, scaled, turned;
  for (auto* list : {&rigid, &scaled, &turned}) list->reserve(pairs.size() - delta);
  for (size_t i = 0; i + delta < pairs.size(); ++i) {
    const auto [e_0, t_0] = pairs[i];
    const auto [e_1, t_1] = pairs[i + delta];
    const Eigen::Vector3d in_estimate = estimate.orientations[e_0].conjugate() *
                                        (estimate.positions[e_1] - estimate.positions[e_0]);
    const Eigen::Vector3d in_truth =
        truth.orientations[t_0].conjugate() * (truth.positions[t_1] - truth.positions[t_0]);
    rigid.push_back((in_estimate - in_truth).norm());
    scaled.push_back((sim3.s * in_estimate - in_truth).norm());
    turned.push_back(
        Angle((truth.orientations[t_0].conjugate() * truth.orientations[t_1]).conjugate() *
              (estimate.orientations[e_0].conjugate() * estimate.orientations[e_1])));
  }
  errors.rpe_se3 = Summarise(std::move(rigid));
  errors.rpe_sim3 = Summarise(std::move(scaled));
  errors.rpe_rotation = Summarise(std::move(turned));
  return errors;
}

}  // namespace plenocal
