// SPDX-License-Identifier: Apache-2.0
#include "calib/rig/hand_eye.h"

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

using Vector12d = Eigen::Matrix<double, 12, 1>;

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
  constexpr double kRounding = 1e-6;  // rad
  std::vector<double> differences;
  for (const Motion& motion : motions) {
    differences.push_back(std::abs(motion.a.norm() - motion.b.norm()));
  }
  const double most = kTypicals * Median(differences) + kRounding;
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

// X and Y at work.
class HandEyeFit {
 public:
  HandEyeFit(std::span<const HandEyePair> pairs, const RigidTransform& X) : pairs_(pairs), X_(X) {
    // Y by the instant that suits most others.
    double least = std::numeric_limits<double>::infinity();
    for (const HandEyePair& pair : pairs) length_ += pair.A.t.norm() + pair.B.t.norm();
    length_ = std::max(length_ / static_cast<double>(2 * pairs.size()), 1e-9);
    const size_t stride = pairs.size() / 40 + 1;
    for (size_t i = 0; i < pairs.size(); i += stride) {
      const RigidTransform Y = pairs[i].B.Inverse() * X.Inverse() * pairs[i].A;
      const double cost = Median(Errors(X, Y));
      if (cost >= least) continue;
      least = cost;
      Y_ = Y;
    }
  }

  // Levenberg and Marquardt with Cauchy's weights, which follow the residuals.
  void Refine() {
    constexpr int kSteps = 60;
    double damping = 1e-6;
    for (int step = 0; step < kSteps; ++step) {
      const double width = Width();
      const double before = Cost(X_, Y_, width);
      Eigen::Matrix<double, 12, 12> H = Eigen::Matrix<double, 12, 12>::Zero();
      Vector12d g = Vector12d::Zero();
      Linearise(width, &H, &g);
      const double scale = H.diagonal().maxCoeff();
      H.diagonal().array() += damping * scale;
      const Vector12d delta = -SolveSymmetric(Eigen::MatrixXd(H), Eigen::VectorXd(g));
      if (!delta.allFinite()) return;
      const RigidTransform X = Retract(X_, delta.head<6>()), Y = Retract(Y_, delta.tail<6>());
      if (Cost(X, Y, width) < before) {
        X_ = X;
        Y_ = Y;
        damping = std::max(damping / 10, 1e-14);
        if (delta.norm() < 1e-12) return;
      } else {
        damping *= 10;
        if (damping > 1) return;
      }
    }
  }

  [[nodiscard]] double TypicalError() const { return Median(Errors(X_, Y_)); }

  [[nodiscard]] HandEye Result() const {
    HandEye result{.X = X_, .Y = Y_};
    for (const HandEyePair& pair : pairs_) {
      const RigidTransform E = pair.A.Inverse() * X_ * pair.B * Y_;
      result.rotation_rms += LogRotation(E.R).squaredNorm() / static_cast<double>(pairs_.size());
      result.translation_rms += E.t.squaredNorm() / static_cast<double>(pairs_.size());
    }
    result.rotation_rms = std::sqrt(result.rotation_rms);
    result.translation_rms = std::sqrt(result.translation_rms);
    return result;
  }

 private:
  // Rotation and translation of A^-1 X B Y, the rotation as the way it moves a point at the typical
  // distance.
  [[nodiscard]] Vector6d Error(const HandEyePair& pair,
                               const RigidTransform& X,
                               const RigidTransform& Y) const {
    const RigidTransform E = X * pair.B * Y;
    Vector6d error;
    error << E.t - pair.A.t, length_ * LogRotation(E.R * pair.A.R.transpose());
    return error;
  }

  [[nodiscard]] std::vector<double> Errors(const RigidTransform& X, const RigidTransform& Y) const {
    std::vector<double> errors;
    for (const HandEyePair& pair : pairs_) errors.push_back(Error(pair, X, Y).norm());
    return errors;
  }

  [[nodiscard]] double Width() const {
    constexpr double kTypicals = 3, kLeast = 1e-12;
    return std::max(kTypicals * TypicalError(), kLeast * length_);
  }

  [[nodiscard]] double Cost(const RigidTransform& X, const RigidTransform& Y, double width) const {
    double cost = 0;
    for (const double error : Errors(X, Y)) cost += std::log1p(error * error / (width * width));
    return cost;
  }

  void Linearise(double width, Eigen::Matrix<double, 12, 12>* H, Vector12d* g) const {
    constexpr double kStep = 1e-6;
    for (const HandEyePair& pair : pairs_) {
      const Vector6d error = Error(pair, X_, Y_);
      Eigen::Matrix<double, 6, 12> J;
      for (Eigen::Index i = 0; i < 6; ++i) {
        const Vector6d step = kStep * Vector6d::Unit(i);
        J.col(i) = (Error(pair, Retract(X_, step), Y_) - Error(pair, Retract(X_, -step), Y_)) /
                   (2 * kStep);
        J.col(6 + i) = (Error(pair, X_, Retract(Y_, step)) - Error(pair, X_, Retract(Y_, -step))) /
                       (2 * kStep);
      }
      const double weight = 1 / (width * width + error.squaredNorm());
      *H += weight * J.transpose() * J;
      *g += weight * J.transpose() * error;
    }
  }

  std::span<const HandEyePair> pairs_;
  double length_ = 0;  // m, typical distance
  RigidTransform X_, Y_;
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
