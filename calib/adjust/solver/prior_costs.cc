// SPDX-License-Identifier: Apache-2.0
#include "calib/adjust/solver/prior_costs.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <utility>

namespace plenocal::internal {

MarkerPrior::MarkerPrior(std::span<const double> nominal, size_t block_size, double sigma)
    : nominal_(nominal.begin(), nominal.end()), sigma_(sigma) {
  set_num_residuals(static_cast<int>(nominal.size()));
  mutable_parameter_block_sizes()->push_back(static_cast<int>(block_size));
}

bool MarkerPrior::Evaluate(double const* const* parameters,
                           double* residuals,
                           double** jacobians) const {
  const size_t size = nominal_.size();
  for (size_t i = 0; i < size; ++i) residuals[i] = (parameters[0][i] - nominal_[i]) / sigma_;
  if (jacobians != nullptr && jacobians[0] != nullptr) {
    const auto width = static_cast<size_t>(parameter_block_sizes()[0]);
    std::fill_n(jacobians[0], size * width, 0.0);
    for (size_t i = 0; i < size; ++i) jacobians[0][i * width + i] = 1 / sigma_;
  }
  return true;
}

ParamPriorCost::ParamPriorCost(size_t size, SlotPrior prior)
    : size_(size), prior_(std::move(prior)) {
  set_num_residuals(1);
  mutable_parameter_block_sizes()->push_back(static_cast<int>(size));
}

bool ParamPriorCost::Evaluate(double const* const* parameters,
                              double* residuals,
                              double** jacobians) const {
  double sum = 0;
  for (const auto& [slot, weight] : prior_.terms) sum += weight * parameters[0][slot];
  residuals[0] = (sum - prior_.value) / prior_.sigma;
  if (jacobians != nullptr && jacobians[0] != nullptr) {
    std::fill_n(jacobians[0], size_, 0.0);
    for (const auto& [slot, weight] : prior_.terms) jacobians[0][slot] += weight / prior_.sigma;
  }
  return true;
}

DistanceRows::DistanceRows(std::vector<MarkerDistance> distances)
    : distances_(std::move(distances)) {
  const auto count = static_cast<Eigen::Index>(distances_.size());
  Eigen::VectorXd own(count), common(count);
  for (Eigen::Index i = 0; i < count; ++i) {
    const MarkerDistance& distance = distances_[static_cast<size_t>(i)];
    own[i] = distance.sigma;
    common[i] = distance.common_sigma;
    for (const std::vector<int>* end : {&distance.markers_a, &distance.markers_b}) {
      markers_.insert(markers_.end(), end->begin(), end->end());
    }
  }
  std::ranges::sort(markers_);
  markers_.erase(std::unique(markers_.begin(), markers_.end()), markers_.end());
  Eigen::MatrixXd covariance = common * common.transpose();
  covariance.diagonal() += own.cwiseAbs2();
  weight_ = covariance.llt().matrixL().solve(Eigen::MatrixXd::Identity(count, count));
}

bool DistanceRows::Evaluate(std::span<const Eigen::Vector3d> positions,
                            Eigen::VectorXd* residual,
                            Eigen::MatrixXd* J) const {
  const auto index = [&](int marker) {
    return std::ranges::lower_bound(markers_, marker) - markers_.begin();
  };
  const auto centre = [&](const std::vector<int>& markers) {
    Eigen::Vector3d sum = Eigen::Vector3d::Zero();
    for (const int marker : markers) sum += positions[static_cast<size_t>(index(marker))];
    return Eigen::Vector3d(sum / static_cast<double>(markers.size()));
  };
  residual->resize(Rows());
  J->setZero(Rows(), 3 * static_cast<Eigen::Index>(markers_.size()));
  for (Eigen::Index i = 0; i < Rows(); ++i) {
    const MarkerDistance& distance = distances_[static_cast<size_t>(i)];
    const Eigen::Vector3d apart = centre(distance.markers_a) - centre(distance.markers_b);
    const double length = apart.norm();
    if (length == 0) return false;
    (*residual)[i] = length - distance.length;
    const auto add = [&](const std::vector<int>& markers, double sign) {
      for (const int marker : markers) {
        J->block<1, 3>(i, 3 * index(marker)) +=
            sign / (length * static_cast<double>(markers.size())) * apart.transpose();
      }
    };
    add(distance.markers_a, 1);
    add(distance.markers_b, -1);
  }
  *residual = weight_ * *residual;
  *J = weight_ * *J;
  return true;
}

std::vector<DistanceRows> RowsOfDistances(const Bundle& bundle,
                                          const std::function<bool(int marker)>& used) {
  std::vector<DistanceRows> rows;
  for (std::vector<MarkerDistance>& group : bundle.DistanceGroups()) {
    std::erase_if(group, [&](const MarkerDistance& distance) {
      return !std::ranges::all_of(distance.markers_a, used) ||
             !std::ranges::all_of(distance.markers_b, used);
    });
    if (!group.empty()) rows.emplace_back(std::move(group));
  }
  return rows;
}

DistanceCost::DistanceCost(DistanceRows rows) : rows_(std::move(rows)) {
  set_num_residuals(static_cast<int>(rows_.Rows()));
  mutable_parameter_block_sizes()->assign(rows_.Markers().size(), 3);
}

bool DistanceCost::Evaluate(double const* const* parameters,
                            double* residuals,
                            double** jacobians) const {
  const size_t count = rows_.Markers().size();
  std::vector<Eigen::Vector3d> positions;
  for (size_t i = 0; i < count; ++i) positions.emplace_back(parameters[i]);
  Eigen::VectorXd residual;
  Eigen::MatrixXd J;
  if (!rows_.Evaluate(positions, &residual, &J)) return false;
  Eigen::Map<Eigen::VectorXd>(residuals, rows_.Rows()) = residual;
  for (size_t i = 0; jacobians != nullptr && i < count; ++i) {
    if (jacobians[i] == nullptr) continue;
    using RowMajor = Eigen::Matrix<double, Eigen::Dynamic, 3, Eigen::RowMajor>;
    Eigen::Map<RowMajor>(jacobians[i], rows_.Rows(), 3) =
        J.middleCols<3>(3 * static_cast<Eigen::Index>(i));
  }
  return true;
}

CalibrationPriorCost::CalibrationPriorCost(const Bundle& bundle, Unknowns* unknowns)
    : prior_(*bundle.prior) {
  for (const CalibrationPrior::Unknown& unknown : prior_.unknowns) {
    if (unknown.param) {
      const Intrinsics& intrinsics = unknowns->intrinsics[unknown.camera];
      places_.push_back({.block = AddBlock(intrinsics.block->values, intrinsics.block->Size()),
                         .slot = intrinsics.Slot(*unknown.param)});
    } else {
      const ChartedPose& pose = unknowns->extrinsics[unknown.camera];
      places_.push_back({.block = AddBlock(pose.delta, 6),
                         .slot = static_cast<size_t>(unknown.component),
                         .pose = &pose});
    }
  }
  set_num_residuals(static_cast<int>(prior_.weight.rows()));
}

size_t CalibrationPriorCost::AddBlock(double* values, size_t size) {
  const auto found = std::find(blocks_.begin(), blocks_.end(), values);
  if (found != blocks_.end()) return static_cast<size_t>(found - blocks_.begin());
  blocks_.push_back(values);
  mutable_parameter_block_sizes()->push_back(static_cast<int>(size));
  return blocks_.size() - 1;
}

bool CalibrationPriorCost::Evaluate(double const* const* parameters,
                                    double* residuals,
                                    double** jacobians) const {
  const auto count = static_cast<Eigen::Index>(prior_.unknowns.size());
  Eigen::VectorXd deviation(count);
  std::vector<Eigen::MatrixXd> derivatives;  // of `deviation` by each block
  for (const int size : parameter_block_sizes()) {
    derivatives.push_back(Eigen::MatrixXd::Zero(count, size));
  }
  for (Eigen::Index i = 0; i < count; ++i) {
    const CalibrationPrior::Unknown& unknown = prior_.unknowns[static_cast<size_t>(i)];
    const Place& place = places_[static_cast<size_t>(i)];
    Eigen::MatrixXd& J = derivatives[place.block];
    const double* const block = parameters[place.block];
    if (place.pose == nullptr) {
      deviation[i] = block[place.slot] - unknown.value;
      J(i, static_cast<Eigen::Index>(place.slot)) = 1;
      continue;
    }
    const RigidTransform T = Retract(place.pose->origin, Eigen::Map<const Vector6d>(block));
    const Vector6d delta = LocalCoordinates(prior_.T_camera_rig[unknown.camera], T);
    deviation[i] = delta[unknown.component];
    if (unknown.component < 3) {
      J(i, unknown.component) = 1;
    } else {
      // Exp(w) = Exp(delta_w) R_0 R_prior': dw = J(w)^-1 J(delta_w) d delta_w.
      const Eigen::Matrix3d turn = LeftJacobian(delta.tail<3>()).inverse() *
                                   LeftJacobian(Eigen::Map<const Vector6d>(block).tail<3>());
      J.block<1, 3>(i, 3) = turn.row(unknown.component - 3);
    }
  }
  Eigen::Map<Eigen::VectorXd>(residuals, num_residuals()) = prior_.weight * deviation;
  for (size_t b = 0; jacobians != nullptr && b < derivatives.size(); ++b) {
    if (jacobians[b] == nullptr) continue;
    Eigen::Map<Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>>(
        jacobians[b], num_residuals(), derivatives[b].cols()) = prior_.weight * derivatives[b];
  }
  return true;
}

JitterPrior::JitterPrior(const Matrix6d& weight) : weight_(weight) {
  set_num_residuals(6);
  mutable_parameter_block_sizes()->push_back(6);
}

bool JitterPrior::Evaluate(double const* const* parameters,
                           double* residuals,
                           double** jacobians) const {
  Eigen::Map<Vector6d> residual(residuals);
  residual = weight_ * Eigen::Map<const Vector6d>(parameters[0]);
  if (jacobians != nullptr && jacobians[0] != nullptr) {
    Eigen::Map<Eigen::Matrix<double, 6, 6, Eigen::RowMajor>> J(jacobians[0]);
    J = weight_;
  }
  return true;
}

}  // namespace plenocal::internal
