// SPDX-License-Identifier: Apache-2.0
#include "calib/rig/outside_poses.h"

#include <algorithm>
#include <cmath>

#include "calib/base/linear_algebra.h"
#include "calib/base/statistics.h"

namespace plenocal {
namespace {

constexpr int kUnknowns = 13;  // both charts and the scale
using Unknowns13 = Eigen::Matrix<double, kUnknowns, 1>;
using Information13 = Eigen::Matrix<double, kUnknowns, kUnknowns>;
using Rows13 = Eigen::Matrix<double, 6, kUnknowns>;

// T_base_gripper = P M Q with the calibration's pose M, whose lengths have the scale.
struct OutsideModel {
  RigidTransform P, Q;
  double scale = 1;

  [[nodiscard]] OutsideModel Moved(const Unknowns13& delta) const {
    return {Retract(P, delta.head<6>()), Retract(Q, delta.segment<6>(6)), scale * (1 + delta[12])};
  }
  // Position, then rotation: predicted less measured.
  [[nodiscard]] Vector6d Error(const HandEyePair& pair) const {
    const RigidTransform predicted = P * RigidTransform{pair.B.R, scale * pair.B.t} * Q;
    Vector6d error;
    error << predicted.t - pair.A.t, LogRotation(pair.A.R.transpose() * predicted.R);
    return error;
  }
};

class OutsideSolver {
 public:
  OutsideSolver(const std::vector<HandEyePair>& pairs,
                const OutsideModel& start,
                OutsideScale scale)
      : pairs_(pairs), model_(start), free_scale_(scale == OutsideScale::kFree) {
    used_.assign(pairs.size(), true);
  }

  void Run() {
    constexpr int kRounds = 20;
    constexpr double kSettled = 1e-6;
    StartSigmas();
    for (int round = 0; round < kRounds; ++round) {
      Step();
      const double t = sigma_t_, r = sigma_r_;
      UpdateSigmas();
      const bool changed = RejectOutliers();
      if (!changed && std::abs(t / sigma_t_ - 1) + std::abs(r / sigma_r_ - 1) < kSettled) break;
    }
    Linearise();
  }

  [[nodiscard]] const OutsideModel& Model() const { return model_; }
  [[nodiscard]] const std::vector<bool>& Used() const { return used_; }
  [[nodiscard]] double TranslationSigma() const { return sigma_t_; }
  [[nodiscard]] double RotationSigma() const { return sigma_r_; }
  // Of directions that the motion leaves open by less than rounding; zero along these.
  [[nodiscard]] Information13 Covariance() const {
    constexpr double kRank = 1e-12;
    Unknowns13 scale;
    for (int i = 0; i < kUnknowns; ++i) scale[i] = H_(i, i) > 0 ? 1 / std::sqrt(H_(i, i)) : 0;
    const SymmetricEigen spectrum =
        DecomposeSymmetric(Eigen::MatrixXd(scale.asDiagonal() * H_ * scale.asDiagonal()));
    Information13 covariance = Information13::Zero();
    for (int i = 0; i < kUnknowns; ++i) {
      if (spectrum.values[i] < kRank) continue;
      const Unknowns13 direction = scale.asDiagonal() * spectrum.vectors.col(i);
      covariance += direction * direction.transpose() / spectrum.values[i];
    }
    return covariance;
  }

 private:
  void StartSigmas() {
    std::vector<double> t, r;
    for (const HandEyePair& pair : pairs_) {
      const Vector6d error = model_.Error(pair);
      t.push_back(error.head<3>().norm());
      r.push_back(error.tail<3>().norm());
    }
    sigma_t_ = std::max(Median(t), kLeast);
    sigma_r_ = std::max(Median(r), kLeast);
  }

  [[nodiscard]] Rows13 Derivatives(const HandEyePair& pair) const {
    constexpr double kStep = 1e-6;
    Rows13 J;
    for (int i = 0; i < kUnknowns; ++i) {
      const Unknowns13 step = kStep * Unknowns13::Unit(i);
      J.col(i) = (model_.Moved(step).Error(pair) - model_.Moved(-step).Error(pair)) / (2 * kStep);
    }
    if (!free_scale_) J.col(12).setZero();
    return J;
  }

  void Linearise() {
    H_.setZero();
    g_.setZero();
    leverage_t_.setZero();
    for (size_t i = 0; i < pairs_.size(); ++i) {
      if (!used_[i]) continue;
      const Rows13 J = Derivatives(pairs_[i]);
      const Vector6d error = model_.Error(pairs_[i]);
      const Information13 of_t =
          J.topRows<3>().transpose() * J.topRows<3>() / (sigma_t_ * sigma_t_);
      leverage_t_ += of_t;
      H_ += of_t + Information13(J.bottomRows<3>().transpose() * J.bottomRows<3>() /
                                 (sigma_r_ * sigma_r_));
      g_ += J.topRows<3>().transpose() * error.head<3>() / (sigma_t_ * sigma_t_) +
            J.bottomRows<3>().transpose() * error.tail<3>() / (sigma_r_ * sigma_r_);
    }
  }

  void Step() {
    constexpr int kSteps = 10;
    constexpr double kSmall = 1e-3;  // of a standard error
    for (int step = 0; step < kSteps; ++step) {
      Linearise();
      const Unknowns13 delta = -Covariance() * g_;
      if (!delta.allFinite()) return;
      model_ = model_.Moved(delta);
      if (delta.dot(H_ * delta) < kSmall * kSmall) return;
    }
  }

  // Sums of squares over degrees of freedom: those that the unknowns use of positions and angles.
  void UpdateSigmas() {
    double t = 0, r = 0, count = 0;
    for (size_t i = 0; i < pairs_.size(); ++i) {
      if (!used_[i]) continue;
      const Vector6d error = model_.Error(pairs_[i]);
      t += error.head<3>().squaredNorm();
      r += error.tail<3>().squaredNorm();
      count += 3;
    }
    const Information13 C = Covariance();
    const double taken_t = (C * leverage_t_).trace(), taken = (C * H_).trace();
    sigma_t_ = std::max(std::sqrt(t / std::max(1.0, count - taken_t)), kLeast);
    sigma_r_ = std::max(std::sqrt(r / std::max(1.0, count - (taken - taken_t))), kLeast);
  }

  bool RejectOutliers() {
    constexpr double kFalse = 0.05;
    const double limit = ChiSquareQuantile(6, kFalse / static_cast<double>(pairs_.size()));
    bool changed = false;
    for (size_t i = 0; i < pairs_.size(); ++i) {
      const Vector6d error = model_.Error(pairs_[i]);
      const bool fits = error.head<3>().squaredNorm() / (sigma_t_ * sigma_t_) +
                            error.tail<3>().squaredNorm() / (sigma_r_ * sigma_r_) <=
                        limit;
      changed = changed || fits != used_[i];
      used_[i] = fits;
    }
    return changed;
  }

  static constexpr double kLeast = 1e-12;  // m and rad: exact poses
  const std::vector<HandEyePair>& pairs_;
  OutsideModel model_;
  bool free_scale_;
  std::vector<bool> used_;
  double sigma_t_ = 1, sigma_r_ = 1;
  Information13 H_, leverage_t_;
  Unknowns13 g_;
};

// Derivative of the chart of T^-1 by that of T: v' = -R' v - R' [t]x w, w' = -R' w.
Matrix6d InverseChart(const RigidTransform& T) {
  Matrix6d J = Matrix6d::Zero();
  J.topLeftCorner<3, 3>() = J.bottomRightCorner<3, 3>() = -T.R.transpose();
  J.topRightCorner<3, 3>() = -T.R.transpose() * Hat(T.t);
  return J;
}

Vector6d SigmasOf(const Matrix6d& covariance) {
  return covariance.diagonal().cwiseMax(0).cwiseSqrt();
}

}  // namespace

std::optional<OutsideFit> FitOutsidePoses(std::span<const OutsidePose> poses,
                                          const OutsideOptions& options) {
  const bool on_gripper = options.mount == RigMount::kOnGripper;
  std::vector<HandEyePair> pairs;
  for (const OutsidePose& pose : poses) {
    pairs.push_back(
        {pose.T_base_gripper, on_gripper ? pose.T_rig_target.Inverse() : pose.T_rig_target});
  }
  const std::optional<HandEye> start = SolveHandEye(pairs);
  if (!start) return std::nullopt;
  OutsideSolver solver(pairs, {start->X, start->Y}, options.scale);
  solver.Run();
  const OutsideModel& model = solver.Model();
  const Information13 covariance = solver.Covariance();
  // On the gripper: P = T_base_target, Q = T_rig_gripper; else P = T_base_rig, Q =
  // T_target_gripper.
  const RigidTransform of_Q = model.Q.Inverse();
  const Vector6d sigma_P = SigmasOf(covariance.topLeftCorner<6, 6>());
  const Vector6d sigma_Q = SigmasOf(InverseChart(model.Q) * covariance.block<6, 6>(6, 6) *
                                    InverseChart(model.Q).transpose());
  return OutsideFit{.T_mount_rig = on_gripper ? of_Q : model.P,
                    .T_other_target = on_gripper ? model.P : of_Q,
                    .scale = model.scale,
                    .rig_sigma = on_gripper ? sigma_Q : sigma_P,
                    .target_sigma = on_gripper ? sigma_P : sigma_Q,
                    .scale_sigma = std::sqrt(covariance(12, 12)) * model.scale,
                    .translation_sigma = solver.TranslationSigma(),
                    .rotation_sigma = solver.RotationSigma(),
                    .used = solver.Used(),
                    .gap = start->gap,
                    .largest_angle = start->largest_angle};
}

double RatioOfLengths(std::span<const OutsidePose> poses) {
  const auto spread = [&](const auto& position_of) {
    Eigen::Vector3d mean = Eigen::Vector3d::Zero();
    for (const OutsidePose& pose : poses) mean += position_of(pose);
    mean /= static_cast<double>(poses.size());
    double squares = 0;
    for (const OutsidePose& pose : poses) squares += (position_of(pose) - mean).squaredNorm();
    return std::sqrt(squares / static_cast<double>(poses.size()));
  };
  const double outside = spread([](const OutsidePose& pose) { return pose.T_base_gripper.t; });
  const double inside =
      spread([](const OutsidePose& pose) { return pose.T_rig_target.Inverse().t; });
  return inside > 0 ? outside / inside : 1;
}

}  // namespace plenocal
