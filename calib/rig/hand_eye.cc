// SPDX-License-Identifier: Apache-2.0
#include "calib/rig/hand_eye.h"

#include <ceres/rotation.h>
#include <ceres/tiny_solver.h>
#include <ceres/tiny_solver_autodiff_function.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <utility>
#include <vector>

#include "calib/base/linear_algebra.h"
#include "calib/base/statistics.h"

namespace plenocal {
namespace {

constexpr size_t kFewestInstants = 3;
// Pairs of instants; more add time and no certainty.
constexpr size_t kMostMotions = 3000;
// Axes of motions that spread by less than this angle are one axis up to the noise of poses, rad.
constexpr double kOneAxis = 0.02;
// Rotations that stay below are noise, rad.
constexpr double kNoRotation = 0.01;
// A logarithm near pi has two signs.
constexpr double kLargestAngle = std::numbers::pi - 0.2;

// Between two instants: A_i A_j^-1 = X (B_i B_j^-1) X^-1.
struct Motion {
  RigidTransform A, B;
  Eigen::Vector3d a, b;  // rotation vectors
};

std::vector<Motion> MotionsOf(std::span<const HandEyePair> pairs) {
  const size_t all = pairs.size() * (pairs.size() - 1) / 2;
  const size_t stride = all / kMostMotions + 1;
  std::vector<Motion> motions;
  size_t index = 0;
  for (size_t i = 0; i < pairs.size(); ++i) {
    for (size_t j = 0; j < i; ++j) {
      if (index++ % stride != 0) continue;
      Motion motion{pairs[i].A * pairs[j].A.Inverse(), pairs[i].B * pairs[j].B.Inverse(), {}, {}};
      motion.a = LogRotation(motion.A.R);
      motion.b = LogRotation(motion.B.R);
      if (std::max(motion.a.norm(), motion.b.norm()) < kLargestAngle) motions.push_back(motion);
    }
  }
  return motions;
}

// Motions by the same angle in both chains; a wrong pose gives others.
std::vector<Motion> AgreeingMotions(std::vector<Motion> motions) {
  constexpr double kTypicals = 5;
  constexpr double kSameAngle = 1e-6;  // rad
  std::vector<double> differences;
  for (const Motion& motion : motions) {
    differences.push_back(std::abs(motion.a.norm() - motion.b.norm()));
  }
  const double most = kTypicals * Median(differences) + kSameAngle;
  std::erase_if(motions, [&](const Motion& motion) {
    return std::abs(motion.a.norm() - motion.b.norm()) > most;
  });
  return motions;
}

// Least squares t of (R_A - I) t = R_X t_B - t_A, without a part along directions that the motions
// leave open.
Eigen::Vector3d TranslationOf(const std::vector<Motion>& motions, const Eigen::Matrix3d& R_X) {
  Eigen::Matrix3d H = Eigen::Matrix3d::Zero();
  Eigen::Vector3d g = Eigen::Vector3d::Zero();
  for (const Motion& motion : motions) {
    const Eigen::Matrix3d M = motion.A.R - Eigen::Matrix3d::Identity();
    H += M.transpose() * M;
    g += M.transpose() * (R_X * motion.B.t - motion.A.t);
  }
  const SymmetricEigen3 spectrum = DecomposeSymmetric(H);
  Eigen::Vector3d t = Eigen::Vector3d::Zero();
  for (Eigen::Index i = 0; i < 3; ++i) {
    if (spectrum.values[i] <= kOneAxis * kOneAxis * spectrum.values[2]) continue;
    const Eigen::Vector3d axis = spectrum.vectors.col(i);
    t += axis * (axis.dot(g) / spectrum.values[i]);
  }
  return t;
}

// The spread of the motions, and the axis about which most of them turn.
struct Spread {
  HandEyeGap gap = HandEyeGap::kNone;
  Eigen::Vector3d axis_a{0, 0, 1};
  double largest_angle = 0, second_angle = 0;  // rad; the second: RMS about other axes
};

Spread SpreadOf(const std::vector<Motion>& motions) {
  Eigen::Matrix3d of_a = Eigen::Matrix3d::Zero();
  Spread spread;
  for (const Motion& motion : motions) {
    of_a += motion.a * motion.a.transpose();
    spread.largest_angle = std::max(spread.largest_angle, motion.a.norm());
  }
  const SymmetricEigen3 spectrum = DecomposeSymmetric(of_a);
  spread.axis_a = spectrum.vectors.col(2);
  spread.second_angle =
      std::sqrt(std::max(0.0, spectrum.values[1]) / static_cast<double>(motions.size()));
  if (spread.largest_angle < kNoRotation) {
    spread.gap = HandEyeGap::kTranslation;
  } else if (spectrum.values[1] < kOneAxis * kOneAxis * spectrum.values[2]) {
    spread.gap = HandEyeGap::kAlongAxis;
  }
  return spread;
}

// Rotations from which a solution may start: one where axes differ, a turn about the common axis
// where they do not, and where nothing turns that of the translations.
std::vector<Eigen::Matrix3d> StartRotations(const std::vector<Motion>& motions,
                                            const Spread& spread) {
  constexpr int kTurns = 24;
  Eigen::Matrix3d correlation = Eigen::Matrix3d::Zero();
  for (const Motion& motion : motions) {
    correlation += spread.gap == HandEyeGap::kTranslation
                       ? Eigen::Matrix3d(motion.A.t * motion.B.t.transpose())
                       : Eigen::Matrix3d(motion.a * motion.b.transpose());
  }
  const Eigen::Matrix3d R = NearestRotation(correlation);
  if (spread.gap != HandEyeGap::kAlongAxis) return {R};
  std::vector<Eigen::Matrix3d> starts;
  for (int turn = 0; turn < kTurns; ++turn) {
    starts.push_back(ExpRotation(2 * std::numbers::pi * turn / kTurns * spread.axis_a) * R);
  }
  return starts;
}

// Errors A^-1 X B Y, the rotation as the way it moves a point at the typical distance. Unknowns are
// the translation and the rotation vector of X, then of Y.
class HandEyeFit {
 public:
  HandEyeFit(std::span<const HandEyePair> pairs, const RigidTransform& X)
      : pairs_(pairs), weights_(pairs.size(), 1) {
    for (const HandEyePair& pair : pairs) length_ += pair.A.t.norm() + pair.B.t.norm();
    length_ = std::max(length_ / static_cast<double>(2 * pairs.size()), 1e-9);
    // Y by the instant that suits most others.
    double least = std::numeric_limits<double>::infinity();
    const size_t stride = pairs.size() / 40 + 1;
    for (size_t i = 0; i < pairs.size(); i += stride) {
      const RigidTransform Y = pairs[i].B.Inverse() * X.Inverse() * pairs[i].A;
      Unknowns start;
      start << X.t, LogRotation(X.R), Y.t, LogRotation(Y.R);
      const double typical = Median(Lengths(start));
      if (typical >= least) continue;
      least = typical;
      unknowns_ = start;
    }
  }

  // Least squares with Cauchy's weights, which follow the residuals.
  void Refine() {
    constexpr int kRounds = 60;
    constexpr double kTypicals = 3, kLeast = 1e-12;
    const ceres::TinySolverAutoDiffFunction<HandEyeFit, Eigen::Dynamic, 12> function(*this);
    ceres::TinySolver<std::decay_t<decltype(function)>> solver;
    solver.options.function_tolerance = solver.options.cost_threshold = 0;
    for (int round = 0; round < kRounds; ++round) {
      const std::vector<double> lengths = Lengths(unknowns_);
      const double width = std::max(kTypicals * Median(lengths), kLeast * length_);
      for (size_t i = 0; i < lengths.size(); ++i) weights_[i] = 1 / std::hypot(width, lengths[i]);
      const Unknowns last = unknowns_;
      solver.Solve(function, &unknowns_);
      if (unknowns_ == last) return;
    }
  }

  [[nodiscard]] double TypicalError() const { return Median(Lengths(unknowns_)); }

  [[nodiscard]] HandEye Result() const {
    HandEye result{.X = {ExpRotation(unknowns_.segment<3>(3)), unknowns_.head<3>()},
                   .Y = {ExpRotation(unknowns_.tail<3>()), unknowns_.segment<3>(6)}};
    for (const HandEyePair& pair : pairs_) {
      const Vector6d error = Error(pair, unknowns_.data());
      result.translation_rms += error.head<3>().squaredNorm();
      result.rotation_rms += error.tail<3>().squaredNorm() / (length_ * length_);
    }
    const auto count = static_cast<double>(pairs_.size());
    result.rotation_rms = std::sqrt(result.rotation_rms / count);
    result.translation_rms = std::sqrt(result.translation_rms / count);
    return result;
  }

  // The function of `ceres::TinySolver`.
  [[nodiscard]] int NumResiduals() const { return static_cast<int>(6 * pairs_.size()); }
  template <typename T>
  bool operator()(const T* unknowns, T* residuals) const {
    for (size_t i = 0; i < pairs_.size(); ++i) {
      Eigen::Map<Eigen::Matrix<T, 6, 1>>(residuals + 6 * i) =
          weights_[i] * Error(pairs_[i], unknowns);
    }
    return true;
  }

 private:
  using Unknowns = Eigen::Matrix<double, 12, 1>;

  template <typename T>
  [[nodiscard]] Eigen::Matrix<T, 6, 1> Error(const HandEyePair& pair, const T* unknowns) const {
    Eigen::Matrix<T, 3, 3> R_X, R_Y;
    ceres::AngleAxisToRotationMatrix(unknowns + 3, R_X.data());
    ceres::AngleAxisToRotationMatrix(unknowns + 9, R_Y.data());
    const Eigen::Map<const Eigen::Matrix<T, 3, 1>> t_X(unknowns), t_Y(unknowns + 6);
    const Eigen::Matrix<T, 3, 3> R_XB = R_X * pair.B.R;
    const Eigen::Matrix<T, 3, 3> R = R_XB * R_Y * pair.A.R.transpose();
    Eigen::Matrix<T, 6, 1> error;
    ceres::RotationMatrixToAngleAxis(R.data(), error.data() + 3);
    error << R_XB * t_Y + R_X * pair.B.t + t_X - pair.A.t, length_ * error.template tail<3>();
    return error;
  }

  [[nodiscard]] std::vector<double> Lengths(const Unknowns& unknowns) const {
    std::vector<double> lengths;
    for (const HandEyePair& pair : pairs_) lengths.push_back(Error(pair, unknowns.data()).norm());
    return lengths;
  }

  std::span<const HandEyePair> pairs_;
  std::vector<double> weights_;
  double length_ = 0;  // m, typical distance
  Unknowns unknowns_;
};

}  // namespace

std::optional<HandEye> SolveHandEye(std::span<const HandEyePair> pairs) {
  if (pairs.size() < kFewestInstants) return std::nullopt;
  const std::vector<Motion> motions = AgreeingMotions(MotionsOf(pairs));
  if (motions.empty()) return std::nullopt;
  const Spread spread = SpreadOf(motions);
  std::optional<HandEye> best;
  double least = std::numeric_limits<double>::infinity();
  for (const Eigen::Matrix3d& R : StartRotations(motions, spread)) {
    HandEyeFit fit(pairs, {R, TranslationOf(motions, R)});
    fit.Refine();
    const double error = fit.TypicalError();
    if (!(error < least)) continue;
    least = error;
    best = fit.Result();
  }
  if (!best) return std::nullopt;
  best->gap = spread.gap;
  best->axis = spread.axis_a;
  const double free_instants = static_cast<double>(pairs.size()) - 2;  // two give X and Y
  best->error = least / (std::sqrt(free_instants) * std::max(spread.second_angle, kOneAxis));
  return best;
}

}  // namespace plenocal
