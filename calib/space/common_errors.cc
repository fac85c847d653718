// SPDX-License-Identifier: Apache-2.0
#include "calib/space/common_errors.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <utility>

#include "calib/base/parallel.h"
#include "calib/base/statistics.h"

namespace plenocal {

CommonErrors::CommonErrors(std::span<const SpacePoint> frame) {
  for (const SpacePoint& point : frame) {
    if (!point.IsFound()) continue;
    const Eigen::MatrixXd& B = point.misses_by_calibration;
    CommonErrors one;
    one.normal_ = B.transpose() * B;
    one.mixed_ = B.transpose() * point.misses;
    one.square_ = point.misses.squaredNorm();
    one.degrees_ = static_cast<int>(point.misses.size());
    Add(one);
  }
  if (degrees_ == 0 || frame[0].frame_columns == 0) return;
  const Eigen::Index own_columns = frame[0].frame_columns, rest = normal_.rows() - own_columns;
  const Eigen::LLT<Eigen::MatrixXd> own(
      Eigen::MatrixXd(normal_.bottomRightCorner(own_columns, own_columns) +
                      Eigen::MatrixXd::Identity(own_columns, own_columns)));
  const Eigen::MatrixXd cross = normal_.bottomLeftCorner(own_columns, rest);
  const Eigen::VectorXd mixed = mixed_.tail(own_columns);
  square_ -= mixed.dot(own.solve(mixed));
  mixed_ = (mixed_.head(rest) - cross.transpose() * own.solve(mixed)).eval();
  normal_ = (normal_.topLeftCorner(rest, rest) - cross.transpose() * own.solve(cross)).eval();
}

void CommonErrors::Add(const CommonErrors& other) {
  if (other.degrees_ == 0) return;
  if (degrees_ == 0) {
    *this = other;
    return;
  }
  normal_ += other.normal_;
  mixed_ += other.mixed_;
  square_ += other.square_;
  degrees_ += other.degrees_;
}

Eigen::MatrixXd CommonErrors::Information() const {
  return normal_ + Eigen::MatrixXd::Identity(normal_.rows(), normal_.cols());
}

RaysTest CommonErrors::Test() const {
  // z' (I + B B')^-1 z = z' z - (B' z)' (I + B' B)^-1 (B' z)
  RaysTest test{.chi_square = square_, .degrees = degrees_};
  if (degrees_ == 0) return test;
  if (mixed_.size() > 0) test.chi_square -= mixed_.dot(Information().llt().solve(mixed_));
  test.chi_square = std::max(0.0, test.chi_square);
  test.probability = ChiSquareTail(test.degrees, test.chi_square);
  return test;
}

Eigen::VectorXd CommonErrors::Estimate(const Eigen::VectorXd& at) const {
  return Information().llt().solve(mixed_ + normal_ * at);
}

Eigen::MatrixXd CommonErrors::Root() const {
  const Eigen::MatrixXd upper = Information().llt().matrixU();
  return upper.triangularView<Eigen::Upper>().solve(
      Eigen::MatrixXd::Identity(upper.rows(), upper.cols()));
}

AdjustedRig AdjustedTo(const SpaceRig& rig,
                       std::span<const std::vector<SpaceObservation>> points,
                       int threads) {
  constexpr int kSteps = 10;
  constexpr double kSmall = 1e-3;  // of a standard error
  AdjustedRig adjusted{rig, Eigen::VectorXd::Zero(rig.Size())};
  Eigen::VectorXd u = Eigen::VectorXd::Zero(rig.root.cols());
  std::vector<SpacePoint> fitted(points.size());
  for (int step = 0; step < kSteps; ++step) {
    ParallelFor(
        points.size(), threads, [&](size_t i) { fitted[i] = FitPoint(adjusted.rig, points[i]); });
    const CommonErrors common(fitted);
    if (common.Test().degrees == 0) break;
    const Eigen::VectorXd before = std::exchange(u, common.Estimate(u));
    adjusted.change = rig.root * u;
    adjusted.rig.cameras = rig.cameras;
    AddToTheta(rig, adjusted.change, &adjusted.rig.cameras);
    if ((u - before).norm() >= kSmall && step + 1 < kSteps) continue;
    adjusted.rig.root = rig.root * common.Root();
    break;
  }
  return adjusted;
}

}  // namespace plenocal
