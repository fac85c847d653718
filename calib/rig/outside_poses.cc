// SPDX-License-Identifier: Apache-2.0
#include "calib/rig/outside_poses.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <random>

#include "calib/base/linear_algebra.h"
#include "calib/base/statistics.h"
#include "calib/noise/matrix_root.h"
#include "calib/noise/open_directions.h"

namespace plenocal {
namespace {

// Both charts, then the scale and the time shift.
constexpr Eigen::Index kScale = 12, kTimeShift = 13, kMotion = 14;

// T_base_gripper = P B Q with B the calibration's T_rig_target or its inverse, whose lengths have
// the scale; `errors` are those of the calibration.
struct OutsideModel {
  RigidTransform P, Q;
  double scale = 1, time_shift = 0;
  Eigen::VectorXd errors;

  [[nodiscard]] OutsideModel Moved(const Eigen::VectorXd& delta) const {
    return {Retract(P, delta.head<6>()),
            Retract(Q, delta.segment<6>(6)),
            scale * (1 + delta[kScale]),
            time_shift + delta[kTimeShift],
            errors + delta.tail(errors.size())};
  }
};

class OutsideSolver {
 public:
  OutsideSolver(std::span<const OutsidePose> poses, const HandEye& start, OutsideOptions options)
      : poses_(poses),
        options_(options),
        model_{start.X, start.Y, 1, 0, Eigen::VectorXd::Zero(poses[0].errors.shared.cols())},
        used_(poses.size(), true) {}

  void Run() {
    constexpr int kRounds = 100;
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
  [[nodiscard]] DeterminedPart NothingDetermined() const {
    return {Eigen::MatrixXd::Zero(H_.rows(), H_.rows()), Eigen::MatrixXd(H_.rows(), 0)};
  }
  // Covariance of what the motion determines, and what it leaves open. Poses of a calibration whose
  // errors are not known have at most the scatter.
  [[nodiscard]] DeterminedPart Determined() const {
    Eigen::VectorXd unit = Eigen::VectorXd::Ones(H_.rows());
    double distance = 0;
    for (const OutsidePose& pose : poses_) distance += pose.T_rig_target.t.norm();
    distance = std::max(distance / static_cast<double>(poses_.size()), kLeast);
    unit.head<3>().setConstant(distance);
    unit.segment<3>(6).setConstant(distance);
    std::vector<Matrix6d> roots;
    for (const OutsidePose& pose : poses_) {
      Matrix6d own = pose.errors.own;
      if (own.isZero(0)) {
        own.diagonal() << Eigen::Vector3d::Constant(sigma_t_ * sigma_t_),
            Eigen::Vector3d::Constant(sigma_r_ * sigma_r_);
      }
      roots.emplace_back(Root(own));
    }
    return Separate(
        SampleNoise(H_,
                    [&](unsigned sample, double sign) { return Information(sample, sign, roots); }),
        unit);
  }

 private:
  // Covariance along directions with more information than rounding; zero along others.
  [[nodiscard]] Eigen::MatrixXd Covariance() const {
    constexpr double kRank = 1e-12;
    const Eigen::VectorXd scale = H_.diagonal().unaryExpr(
        [](double information) { return information > 0 ? 1 / std::sqrt(information) : 0; });
    const SymmetricEigen spectrum =
        DecomposeSymmetric(Eigen::MatrixXd(scale.asDiagonal() * H_ * scale.asDiagonal()));
    Eigen::MatrixXd covariance = Eigen::MatrixXd::Zero(H_.rows(), H_.cols());
    for (Eigen::Index i = 0; i < H_.rows(); ++i) {
      if (spectrum.values[i] < kRank) continue;
      const Eigen::VectorXd direction = scale.asDiagonal() * spectrum.vectors.col(i);
      covariance += direction * direction.transpose() / spectrum.values[i];
    }
    return covariance;
  }

  // One instant at the present model: error, its derivatives and the inverse of its covariance.
  struct Row {
    Vector6d error;
    Eigen::Matrix<double, 6, Eigen::Dynamic> J;
    Matrix6d weight;
  };

  // Position, then rotation: predicted less measured, with the calibration's pose moved by
  // `change`.
  [[nodiscard]] Vector6d Error(const OutsidePose& pose,
                               const OutsideModel& model,
                               const Vector6d& change) const {
    RigidTransform B = Retract(pose.T_rig_target, change);
    if (options_.mount == RigMount::kOnGripper) B = B.Inverse();
    const RigidTransform predicted = model.P * RigidTransform{B.R, model.scale * B.t} * model.Q;
    const RigidTransform measured = Retract(pose.T_base_gripper, model.time_shift * pose.velocity);
    Vector6d error;
    error << predicted.t - measured.t, LogRotation(measured.R.transpose() * predicted.R);
    return error;
  }

  [[nodiscard]] Vector6d Error(const OutsidePose& pose) const {
    return Error(pose, model_, pose.errors.shared * model_.errors);
  }

  void StartSigmas() {
    std::vector<double> t, r;
    for (const OutsidePose& pose : poses_) {
      const Vector6d error = Error(pose);
      t.push_back(error.head<3>().norm());
      r.push_back(error.tail<3>().norm());
    }
    sigma_t_ = std::max(Median(t), kLeast);
    sigma_r_ = std::max(Median(r), kLeast);
  }

  [[nodiscard]] Row RowOf(const OutsidePose& pose) const {
    constexpr double kStep = 1e-6;
    const Eigen::Index shared = model_.errors.size();
    const Vector6d change = pose.errors.shared * model_.errors;
    Row row{Error(pose, model_, change),
            Eigen::Matrix<double, 6, Eigen::Dynamic>::Zero(6, kMotion + shared),
            Matrix6d::Zero()};
    for (Eigen::Index i = 0; i < kMotion; ++i) {
      if (IsFixed(i)) continue;
      const Eigen::VectorXd step = kStep * Eigen::VectorXd::Unit(kMotion + shared, i);
      row.J.col(i) =
          (Error(pose, model_.Moved(step), change) - Error(pose, model_.Moved(-step), change)) /
          (2 * kStep);
    }
    Matrix6d by_pose;
    for (Eigen::Index i = 0; i < 6; ++i) {
      const Vector6d step = kStep * Vector6d::Unit(i);
      by_pose.col(i) =
          (Error(pose, model_, change + step) - Error(pose, model_, change - step)) / (2 * kStep);
    }
    row.J.rightCols(shared) = by_pose * pose.errors.shared;
    Matrix6d covariance = by_pose * pose.errors.own * by_pose.transpose();
    covariance.diagonal().head<3>().array() += sigma_t_ * sigma_t_;
    covariance.diagonal().tail<3>().array() += sigma_r_ * sigma_r_;
    row.weight = Inverse(covariance);
    return row;
  }

  // Information of the priors: of the calibration's errors, and of a scale that is fixed.
  [[nodiscard]] Eigen::MatrixXd InformationOfPriors() const {
    const Eigen::Index shared = model_.errors.size();
    Eigen::MatrixXd H = Eigen::MatrixXd::Zero(kMotion + shared, kMotion + shared);
    H.diagonal().tail(shared).setOnes();
    for (const Eigen::Index i : {kScale, kTimeShift}) H(i, i) = IsFixed(i) ? 1 : 0;
    return H;
  }

  [[nodiscard]] bool IsFixed(Eigen::Index i) const {
    return (i == kScale && options_.scale == OutsideScale::kFixed) ||
           (i == kTimeShift && !options_.time_shift);
  }

  // H with the calibration's poses moved by `sign` times errors with these roots of covariances,
  // and velocities from outside by theirs.
  [[nodiscard]] Eigen::MatrixXd Information(unsigned sample,
                                            double sign,
                                            const std::vector<Matrix6d>& roots) const {
    Eigen::MatrixXd H = InformationOfPriors();
    std::mt19937 random(sample);
    std::normal_distribution<double> normal;
    const FreeTimeShift shift = options_.time_shift.value_or(FreeTimeShift{});
    for (size_t i = 0; i < poses_.size(); ++i) {
      const Vector6d error = Vector6d::NullaryExpr([&] { return normal(random); });
      Vector6d of_velocity = Vector6d::NullaryExpr([&] { return normal(random); });
      of_velocity.head<3>() *= shift.velocity_sigma;
      of_velocity.tail<3>() *= shift.angular_velocity_sigma;
      if (!used_[i]) continue;
      OutsidePose moved = poses_[i];
      moved.T_rig_target = Retract(moved.T_rig_target, sign * (roots[i] * error));
      moved.velocity += sign * of_velocity;
      const Row row = RowOf(moved);
      H += row.J.transpose() * row.weight * row.J;
    }
    return H;
  }

  void Linearise() {
    const Eigen::Index shared = model_.errors.size();
    H_ = InformationOfPriors();
    g_ = Eigen::VectorXd::Zero(kMotion + shared);
    g_.tail(shared) = model_.errors;
    rows_.clear();
    for (size_t i = 0; i < poses_.size(); ++i) {
      if (!used_[i]) continue;
      const Row& row = rows_.emplace_back(RowOf(poses_[i]));
      H_ += row.J.transpose() * row.weight * row.J;
      g_ += row.J.transpose() * row.weight * row.error;
      // The mean of the product of both errors.
      if (options_.time_shift) {
        g_[kTimeShift] -= row.weight.diagonal().dot(poses_[i].velocity_covariance);
      }
    }
  }

  void Step() {
    constexpr int kSteps = 10;
    constexpr double kSmall = 1e-3;  // of a standard error
    for (int step = 0; step < kSteps; ++step) {
      Linearise();
      const Eigen::VectorXd delta = -Covariance() * g_;
      if (!delta.allFinite()) return;
      model_ = model_.Moved(delta);
      if (delta.dot(H_ * delta) < kSmall * kSmall) return;
    }
  }

  // With W the inverse covariance of the errors e and P = W - W J C J' W, a variance that enters by
  // the matrix V is multiplied by e' W V W e / tr(P V). Where the calibration's poses are exact,
  // this is the sum of squares over the degrees of freedom.
  void UpdateSigmas() {
    Linearise();
    const Eigen::MatrixXd C = Covariance();
    Eigen::Vector2d squares(0, 0), traces(0, 0);
    for (const Row& row : rows_) {
      const Vector6d weighted = row.weight * row.error;
      const Eigen::Matrix<double, 6, Eigen::Dynamic> WJ = row.weight * row.J;
      const Vector6d P = row.weight.diagonal() - (WJ * C).cwiseProduct(WJ).rowwise().sum();
      squares +=
          Eigen::Vector2d(weighted.head<3>().squaredNorm(), weighted.tail<3>().squaredNorm());
      traces += Eigen::Vector2d(P.head<3>().sum(), P.tail<3>().sum());
    }
    const auto factor = [&](int k) {
      return traces[k] > 0 ? std::sqrt(squares[k] / traces[k]) : 1.0;
    };
    sigma_t_ = std::max(sigma_t_ * factor(0), kLeast);
    sigma_r_ = std::max(sigma_r_ * factor(1), kLeast);
  }

  bool RejectOutliers() {
    constexpr double kFalse = 0.05;
    const double limit = ChiSquareQuantile(6, kFalse / static_cast<double>(poses_.size()));
    bool changed = false;
    for (size_t i = 0; i < poses_.size(); ++i) {
      const Row row = RowOf(poses_[i]);
      const bool fits = row.error.dot(row.weight * row.error) <= limit;
      changed = changed || fits != used_[i];
      used_[i] = fits;
    }
    return changed;
  }

  static constexpr double kLeast = 1e-12;  // m and rad: exact poses
  std::span<const OutsidePose> poses_;
  OutsideOptions options_;
  OutsideModel model_;
  std::vector<bool> used_;
  double sigma_t_ = 1, sigma_r_ = 1;
  std::vector<Row> rows_;  // of the instants that are used
  Eigen::MatrixXd H_;
  Eigen::VectorXd g_;
};

// Derivative of the chart of T^-1 by that of T: v' = -R' v - R' [t]x w, w' = -R' w.
Matrix6d InverseChart(const RigidTransform& T) {
  Matrix6d J = Matrix6d::Zero();
  J.topLeftCorner<3, 3>() = J.bottomRightCorner<3, 3>() = -T.R.transpose();
  J.topRightCorner<3, 3>() = -T.R.transpose() * Hat(T.t);
  return J;
}

constexpr double kRounding = 1e-6;  // of the largest part of an open direction

// Standard errors; infinite where a direction in `open` has a part.
Eigen::VectorXd SigmasOf(const Eigen::MatrixXd& covariance, const Eigen::MatrixXd& open) {
  Eigen::VectorXd sigmas = covariance.diagonal().cwiseMax(0).cwiseSqrt();
  if (open.size() == 0) return sigmas;
  const double least = kRounding * open.cwiseAbs().maxCoeff();
  for (Eigen::Index i = 0; i < sigmas.size(); ++i) {
    if ((open.row(i).cwiseAbs().array() > least).any())
      sigmas[i] = std::numeric_limits<double>::infinity();
  }
  return sigmas;
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
  OutsideSolver solver(poses, *start, options);
  solver.Run();
  const OutsideModel& model = solver.Model();
  const DeterminedPart determined =
      options.standard_errors ? solver.Determined() : solver.NothingDetermined();
  // On the gripper: P = T_base_target, Q = T_rig_gripper; else P = T_base_rig, Q =
  // T_target_gripper.
  const RigidTransform of_Q = model.Q.Inverse();
  const Eigen::Index P = on_gripper ? 6 : 0, Q = 6 - P;
  Eigen::MatrixXd charts = Eigen::MatrixXd::Zero(kMotion, determined.covariance.rows());
  charts.block<6, 6>(P, 0).setIdentity();
  charts.block<6, 6>(Q, 6) = InverseChart(model.Q);
  charts(kScale, kScale) = charts(kTimeShift, kTimeShift) = 1;
  const Eigen::MatrixXd open = charts * determined.open;
  const Eigen::VectorXd sigmas = SigmasOf(
      options.instants_per_error * charts * determined.covariance * charts.transpose(), open);
  std::vector<Eigen::Index> of_charts;  // open directions, but for that of the time shift alone
  for (Eigen::Index i = 0; i < open.cols(); ++i) {
    if (open.col(i).head<kScale>().norm() > kRounding * open.col(i).norm()) of_charts.push_back(i);
  }
  return OutsideFit{
      .T_mount_rig = on_gripper ? of_Q : model.P,
      .T_other_target = on_gripper ? model.P : of_Q,
      .scale = model.scale,
      .rig_sigma = sigmas.head<6>(),
      .target_sigma = sigmas.segment<6>(6),
      .scale_sigma = options.scale == OutsideScale::kFixed ? 0 : sigmas[kScale] * model.scale,
      .time_shift = model.time_shift,
      .time_shift_sigma = options.time_shift ? sigmas[kTimeShift] : 0,
      .translation_sigma = solver.TranslationSigma(),
      .rotation_sigma = solver.RotationSigma(),
      .used = solver.Used(),
      .open = open(Eigen::seqN(0, kScale), of_charts),
      .calibration_errors = model.errors};
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
