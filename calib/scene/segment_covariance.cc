// SPDX-License-Identifier: Apache-2.0
#include "calib/scene/segment_covariance.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>

#include "calib/base/error.h"
#include "calib/base/linear_algebra.h"
#include "calib/noise/landmark_system.h"

namespace plenocal {
namespace {

// Derivative of a camera's position in the landmarks' frame by the chart of T_rig_target and by
// that of the camera's extrinsics: p = -R' q, q = t + R_c' t_c.
struct PositionDerivative {
  Eigen::Matrix<double, 3, 6> by_pose, by_extrinsics;
};

PositionDerivative DifferentiatePosition(const RigidTransform& T_rig_target,
                                         const RigidTransform& T_camera_rig) {
  const Eigen::Vector3d q = T_rig_target.t + T_camera_rig.R.transpose() * T_camera_rig.t;
  const Eigen::Matrix3d Rt = T_rig_target.R.transpose();
  const Eigen::Matrix3d Rc = Rt * T_camera_rig.R.transpose();
  PositionDerivative derivative;
  derivative.by_pose << -Rt, -Rt * Hat(q);
  derivative.by_extrinsics << -Rc, -Rc * Hat(T_camera_rig.t);
  return derivative;
}

// Rows of the seven numbers of a segment by all unknowns.
Eigen::MatrixXd SegmentRows(const Bundle& bundle,
                            const PoseSystem& system,
                            int extrinsics,
                            size_t camera,
                            const PathSegment& segment,
                            std::span<const size_t> frames) {
  Matrix7d normal = Matrix7d::Zero();
  Eigen::MatrixXd rows = Eigen::MatrixXd::Zero(7, system.Size());
  for (size_t i = 0; i < frames.size(); ++i) {
    const auto A = SimilarityEffect(segment.positions[i], segment.centre);
    normal += A.transpose() * A;
    const PositionDerivative dp =
        DifferentiatePosition(bundle.T_rig_target[frames[i]], bundle.cameras[camera].T_camera_rig);
    const int pose = system.pose[frames[i]];
    if (pose >= 0) rows.middleCols<6>(pose) += A.transpose() * dp.by_pose;
    if (extrinsics >= 0) rows.middleCols<6>(extrinsics) += A.transpose() * dp.by_extrinsics;
  }
  return SolveSymmetric(Eigen::MatrixXd(normal), rows);
}

// Diagonal 6 x 6 blocks of (L L')^-1 of each frame's pose in its chart.
std::vector<Matrix6d> PoseBlocks(const Eigen::LLT<Eigen::MatrixXd>& factor,
                                 const std::vector<int>& pose) {
  std::vector<Matrix6d> blocks(pose.size(), Matrix6d::Zero());
  const Eigen::Index size = factor.rows();
  for (size_t frame = 0; frame < pose.size(); ++frame) {
    if (pose[frame] < 0) continue;
    const Eigen::Index rest = size - pose[frame];
    const auto L = factor.matrixLLT().bottomRightCorner(rest, rest);
    const Eigen::MatrixXd columns =
        L.triangularView<Eigen::Lower>().solve(Eigen::MatrixXd::Identity(rest, 6));
    blocks[frame] = columns.transpose() * columns;
  }
  return blocks;
}

// A covariance, no smaller in any direction than another estimate of it.
struct Widened {
  Eigen::MatrixXd covariance;
  double factor = 1;  // mean over the directions
};

Widened Widen(const Eigen::MatrixXd& covariance, const Eigen::MatrixXd& other) {
  const Eigen::LLT<Eigen::MatrixXd> root(covariance);
  if (root.info() != Eigen::Success) return {covariance};
  const Eigen::MatrixXd left = root.matrixL().solve(other);
  const SymmetricEigen spectrum =
      DecomposeSymmetric(Eigen::MatrixXd(root.matrixL().solve(left.transpose())));
  const Eigen::VectorXd factors = spectrum.values.cwiseMax(1);
  const Eigen::MatrixXd directions = root.matrixL() * spectrum.vectors;
  return {directions * factors.asDiagonal() * directions.transpose(), factors.mean()};
}

}  // namespace

Eigen::Matrix<double, 3, 7> SimilarityEffect(const Eigen::Vector3d& p,
                                             const Eigen::Vector3d& centre) {
  Eigen::Matrix<double, 3, 7> effect;
  effect << Eigen::Matrix3d::Identity(), -Hat(p - centre), p - centre;
  return effect;
}

Vector7d PathSegment::Fit(std::span<const Eigen::Vector3d> dp) const {
  Matrix7d normal = Matrix7d::Zero();
  Vector7d right = Vector7d::Zero();
  for (size_t i = 0; i < positions.size(); ++i) {
    const auto A = SimilarityEffect(positions[i], centre);
    normal += A.transpose() * A;
    right += A.transpose() * dp[i];
  }
  return SolveSymmetric(Eigen::MatrixXd(normal), Eigen::VectorXd(right));
}

PathSegment MakeSegment(const Bundle& bundle, size_t camera, std::span<const size_t> frames) {
  PathSegment segment;
  for (const size_t frame : frames) {
    segment.positions.push_back(
        (bundle.cameras[camera].T_camera_rig * bundle.T_rig_target[frame]).Inverse().t);
    segment.centre += segment.positions.back();
  }
  const double count = std::max<double>(1, static_cast<double>(frames.size()));
  segment.centre /= count;
  Eigen::Matrix3d scatter = Eigen::Matrix3d::Zero();
  for (const Eigen::Vector3d& p : segment.positions) {
    scatter += (p - segment.centre) * (p - segment.centre).transpose() / count;
  }
  segment.extent = DecomposeSymmetric(scatter).values.reverse().cwiseMax(0).cwiseSqrt();
  return segment;
}

Matrix7d LoopCovariance::Relative() const {
  return segments.topLeftCorner<7, 7>() + segments.bottomRightCorner<7, 7>() -
         segments.topRightCorner<7, 7>() - segments.bottomLeftCorner<7, 7>();
}

double LoopCovariance::AlignmentFloor(const PathSegment& start,
                                      const PathSegment& end,
                                      std::span<const Eigen::Vector3d> path) const {
  double sum = 0;
  for (const Eigen::Vector3d& p : path) {
    Eigen::Matrix<double, 3, 14> M;
    M << -SimilarityEffect(p, start.centre), SimilarityEffect(p, end.centre);
    sum += (M * segments * M.transpose()).trace();
  }
  // Rounding may make a sum of zeros negative.
  return std::sqrt(std::max(0.0, sum) / std::max<double>(1, static_cast<double>(path.size())));
}

LoopCovariance EstimateLoopCovariance(const Bundle& bundle,
                                      size_t camera,
                                      std::span<const size_t> start,
                                      std::span<const size_t> end) {
  const internal::UnknownLayout layout = LayoutOf(bundle);
  const PoseSystem system = EliminateLandmarks(bundle, layout);
  const Eigen::LLT<Eigen::MatrixXd> factor(system.information.selfadjointView<Eigen::Lower>());
  if (factor.info() != Eigen::Success) {
    throw Error(ErrorKind::kJob,
                "the scene points do not determine all poses and the scale; images with more "
                "points in common, and a calibration with standard errors, may");
  }
  const auto rows_of = [&](std::span<const size_t> frames) {
    const PathSegment segment = MakeSegment(bundle, camera, frames);
    return SegmentRows(bundle, system, layout.extrinsics[camera], camera, segment, frames);
  };
  std::vector<size_t> both(start.begin(), start.end());
  both.insert(both.end(), end.begin(), end.end());
  Eigen::MatrixXd rows(21, system.Size());
  rows << rows_of(start), rows_of(end), rows_of(both);
  const Eigen::MatrixXd directions = factor.solve(rows.transpose());
  const Eigen::MatrixXd covariance = rows * directions;
  const Eigen::MatrixXd gradients = LandmarkGradients(bundle, layout, directions);
  Eigen::MatrixXd of_prior = Eigen::MatrixXd::Zero(system.Size(), system.Size());
  AddCalibrationPrior(bundle, layout, &of_prior);
  const Eigen::MatrixXd by_tracks =
      gradients * gradients.transpose() +
      directions.transpose() * (of_prior.selfadjointView<Eigen::Lower>() * directions);
  LoopCovariance result;
  const Widened widened = Widen(covariance.topLeftCorner(14, 14), by_tracks.topLeftCorner(14, 14));
  result.segments = widened.covariance;
  result.track_factor = widened.factor;
  result.scale_sigma = std::sqrt(std::max(covariance(20, 20), by_tracks(20, 20)));
  result.poses = PoseBlocks(factor, system.pose);
  for (size_t frame = 0; frame < result.poses.size(); ++frame) {
    const Matrix6d J = InverseLogJacobian(bundle.T_rig_target[frame]);
    result.poses[frame] = widened.factor * J * result.poses[frame] * J.transpose();
  }
  return result;
}

}  // namespace plenocal
