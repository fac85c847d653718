// SPDX-License-Identifier: Apache-2.0
//
// Errors of an estimated trajectory. Source of the loop's metrics: N. Zeller, F. Quint, U. Stilla,
// "A Synchronized Stereo and Plenoptic Visual Odometry Dataset", arXiv:1807.09372, "Ground Truth
// and Evaluation Metric"; of ATE and RPE: J. Sturm et al., "A Benchmark for the Evaluation of RGB-D
// SLAM Systems", IROS 2012.
#pragma once

#include <Eigen/Core>
#include <optional>
#include <utility>
#include <vector>

#include "calib/rig/trajectory.h"

namespace plenocal {

/// Element of Sim(3): p_a = s * R * p_b + t.
struct Similarity {
  double s = 1;
  Eigen::Matrix3d R = Eigen::Matrix3d::Identity();
  Eigen::Vector3d t = Eigen::Vector3d::Zero();

  Eigen::Vector3d operator*(const Eigen::Vector3d& p) const { return s * (R * p) + t; }
  Similarity operator*(const Similarity& b) const { return {s * b.s, R * b.R, *this * b.t}; }
  [[nodiscard]] Similarity Inverse() const {
    const Eigen::Matrix3d Rt = R.transpose();
    return {1 / s, Rt, -(Rt * t) / s};
  }
  [[nodiscard]] Eigen::Matrix4d Matrix() const;
};

/// Pairs (index into the estimate, index into the truth) of poses that are each other's nearest in
/// time and at most `tolerance` s apart, in the order of time.
using PosePairs = std::vector<std::pair<size_t, size_t>>;
PosePairs Associate(const Trajectory& estimate, const Trajectory& truth, double tolerance);

/// Truth at the start and at the end of a loop.
struct LoopTruth {
  Trajectory start;
  Trajectory end;
};

/// A ground truth in one file, split at its largest gap. Nothing when no gap stands out (longer
/// than twice the next and than a tenth of the whole): then the truth covers the whole path.
std::optional<LoopTruth> SplitAtLargestGap(const Trajectory& truth);

/// The paper's metrics; lengths in the truth's unit.
struct LoopMetrics {
  Similarity T_s_gt;          ///< estimate to truth, by the start segment
  Similarity T_e_gt;          ///< by the end segment
  Similarity T_drift;         ///< T_e_gt * T_s_gt^-1
  double rotation_drift_deg;  ///< e_r
  double translation_drift;   ///< e_t
  double alignment_error;     ///< e_align
  double absolute_scale;      ///< d_s
  double path_length;         ///< of the estimate, times d_s
  size_t frames;              ///< N, poses of the estimate

  [[nodiscard]] double ScaleDrift() const { return T_drift.s; }  ///< e_s
  [[nodiscard]] double ScaleMin() const;                         ///< s_min
  [[nodiscard]] double ScaleMax() const;                         ///< s_max
};

/// max(x, 1 / x): how far a scale is from 1 either way.
double Folded(double scale);

/// The metrics of an estimate with these alignments.
LoopMetrics MeasureDrift(const Trajectory& estimate,
                         const Similarity& T_s_gt,
                         const Similarity& T_e_gt);

/// Throws `Error` of kind kJob when a segment does not determine a similarity: fewer than three
/// pairs, no motion, motion along a line.
LoopMetrics MeasureLoop(const Trajectory& estimate, const LoopTruth& truth, double tolerance);

/// Statistics of the absolute values of errors.
struct ErrorStatistics {
  double rmse, mean, median, std, min, max, sse;
};

/// ATE (absolute trajectory error) over all pairs and RPE (relative pose error) over all pairs that
/// are `delta` pairs apart.
struct PathErrors {
  size_t pairs;
  double scale;                   ///< of the alignment with scale
  ErrorStatistics ate_unaligned;  ///< m
  ErrorStatistics ate_se3;        ///< m, after the rigid alignment
  ErrorStatistics ate_sim3;       ///< m, after the alignment with scale
  ErrorStatistics ate_rotation;   ///< degrees, after the alignment
  ErrorStatistics rpe_se3;        ///< m
  ErrorStatistics rpe_sim3;       ///< m, the estimate scaled by `scale`
  ErrorStatistics rpe_rotation;   ///< degrees
};

/// Throws `Error` of kind kJob when the pairs do not determine the alignment or are fewer than
/// delta + 1.
PathErrors MeasurePath(const Trajectory& estimate,
                       const Trajectory& truth,
                       double tolerance,
                       size_t delta);

}  // namespace plenocal
