// SPDX-License-Identifier: Apache-2.0
#include "calib/space/congruent_points.h"

#include <Eigen/Cholesky>
#include <Eigen/Geometry>
#include <algorithm>
#include <optional>

#include "calib/base/linear_algebra.h"
#include "calib/camera/rigid_transform.h"

namespace plenocal {
namespace {

using Positions = std::map<int, Eigen::Vector3d>;

// The motion of positions onto those of a frame; nothing for fewer than three common ones, or on a
// line.
std::optional<RigidTransform> Align(const Positions& positions, const PointsOfFrame& frame) {
  std::vector<Eigen::Vector3d> from, to;
  for (const auto& [number, point] : frame) {
    const auto found = positions.find(number);
    if (found == positions.end()) continue;
    from.push_back(found->second);
    to.push_back(point->position);
  }
  if (from.size() < 3) return std::nullopt;
  const Eigen::Index n = std::ssize(from);
  const Eigen::Map<const Eigen::Matrix3Xd> a(from[0].data(), 3, n), b(to[0].data(), 3, n);
  const Eigen::Matrix3Xd about = a.colwise() - a.rowwise().mean();
  const SymmetricEigen3 spread = DecomposeSymmetric(Eigen::Matrix3d(about * about.transpose()));
  if (!(spread.values[1] > 1e-6 * spread.values[2])) return std::nullopt;
  const Eigen::Matrix4d T = Eigen::umeyama(a, b, false);
  return RigidTransform{T.topLeftCorner<3, 3>(), T.topRightCorner<3, 1>()};
}

class Adjustment {
 public:
  explicit Adjustment(const std::vector<PointsOfFrame>& frames) : frames_(frames) {
    result_.used.assign(frames.size(), false);
    const auto first = std::ranges::max_element(frames, {}, &PointsOfFrame::size);
    if (first == frames.end() || first->empty()) return;
    Use(static_cast<size_t>(first - frames.begin()), {});
    for (bool grows = true; grows;) {
      grows = false;
      for (size_t f = 0; f < frames.size(); ++f) {
        if (result_.used[f]) continue;
        const std::optional<RigidTransform> pose = Align(positions_, frames[f]);
        if (!pose) continue;
        Use(f, *pose);
        grows = true;
      }
    }
  }

  CongruentPoints Make() {
    if (positions_.empty()) return std::move(result_);
    constexpr int kSteps = 10;
    for (int step = 0; step < kSteps; ++step) {
      Accumulate();
      const Eigen::VectorXd change = normal_.ldlt().solve(mixed_);
      Move(change);
      if (change.dot(normal_ * change) < 1e-8) break;
    }
    Accumulate();
    const auto points = 3 * std::ssize(positions_);
    const Eigen::MatrixXd covariance =
        SolveSymmetric(normal_, Eigen::MatrixXd::Identity(normal_.rows(), normal_.cols()).eval());
    const Eigen::MatrixXd by_calibration = covariance * by_root_;
    const SymmetricEigen noise =
        DecomposeSymmetric(Eigen::MatrixXd(covariance.bottomRightCorner(points, points)));
    const Eigen::MatrixXd root = noise.vectors * noise.values.cwiseMax(0).cwiseSqrt().asDiagonal();
    for (const auto& [number, position] : positions_) {
      SpacePoint& point = result_.points[number];
      point.position = position;
      point.rho = 1 / position.norm();
      point.frame_columns = points;
      point.shared.resize(3, by_calibration.cols() + points);
      const Eigen::Index row = rows_.at(number);
      point.shared << by_calibration.middleRows<3>(row),
          root.middleRows<3>(row - (normal_.rows() - points));
    }
    return std::move(result_);
  }

 private:
  // Unknowns of a frame: its pose, that of the positions in its rig, unless it is the first one,
  // which holds the positions; and its jitter.
  struct Frame {
    RigidTransform T;
    Eigen::VectorXd jitter;
    Eigen::Index row = 0, pose_size = 6;
  };

  void Use(size_t f, const RigidTransform& pose) {
    const Eigen::Index own_columns = frames_[f].begin()->second->frame_columns;
    Frame frame{pose, Eigen::VectorXd::Zero(own_columns), count_, positions_.empty() ? 0 : 6};
    count_ += frame.pose_size + own_columns;
    result_.used[f] = true;
    used_.emplace(f, std::move(frame));
    const RigidTransform back = pose.Inverse();
    for (const auto& [number, point] : frames_[f]) {
      positions_.try_emplace(number, back * point->position);
    }
  }

  void Accumulate() {
    Eigen::Index size = count_;
    for (const auto& [number, position] : positions_) {
      rows_[number] = size;
      size += 3;
    }
    normal_ = Eigen::MatrixXd::Zero(size, size);
    mixed_ = Eigen::VectorXd::Zero(size);
    by_root_.resize(0, 0);
    for (const auto& [f, frame] : used_) {
      const Eigen::Index own_columns = frame.jitter.size(), own = frame.pose_size + own_columns;
      // A prior of unit variance.
      normal_.diagonal().segment(frame.row + frame.pose_size, own_columns).array() += 1;
      mixed_.segment(frame.row + frame.pose_size, own_columns) -= frame.jitter;
      for (const auto& [number, point] : frames_[f]) {
        const Eigen::Vector3d turned = frame.T.R * positions_.at(number);
        Eigen::Matrix<double, 3, 6> by_pose;
        by_pose << Eigen::Matrix3d::Identity(), -Hat(turned);
        Eigen::MatrixXd J(3, own + 3);
        J << by_pose.leftCols(frame.pose_size), point->ByFrame(), frame.T.R;
        const Eigen::MatrixXd JW = SolveSymmetric(Eigen::MatrixXd(point->noise), J).transpose();
        Eigen::VectorX<Eigen::Index> at(own + 3);
        for (Eigen::Index k = 0; k < own; ++k) at[k] = frame.row + k;
        for (Eigen::Index k = 0; k < 3; ++k) at[own + k] = rows_.at(number) + k;
        normal_(at, at) += JW * J;
        mixed_(at) += JW * (point->position - turned - frame.T.t - point->ByFrame() * frame.jitter);
        if (by_root_.size() == 0) {
          by_root_ = Eigen::MatrixXd::Zero(size, point->ByCalibration().cols());
        }
        by_root_(at, Eigen::all) += JW * point->ByCalibration();
      }
    }
  }

  void Move(const Eigen::VectorXd& change) {
    for (auto& [f, frame] : used_) {
      if (frame.pose_size > 0) frame.T = Retract(frame.T, change.segment<6>(frame.row));
      frame.jitter += change.segment(frame.row + frame.pose_size, frame.jitter.size());
    }
    for (auto& [number, position] : positions_) position += change.segment<3>(rows_.at(number));
  }

  const std::vector<PointsOfFrame>& frames_;
  std::map<size_t, Frame> used_;
  std::map<int, Eigen::Index> rows_;  // of the positions in the unknowns
  Positions positions_;
  Eigen::Index count_ = 0;
  Eigen::MatrixXd normal_, by_root_;
  Eigen::VectorXd mixed_;
  CongruentPoints result_;
};

}  // namespace

CongruentPoints AdjustCongruent(const std::vector<PointsOfFrame>& frames) {
  return Adjustment(frames).Make();
}

}  // namespace plenocal
