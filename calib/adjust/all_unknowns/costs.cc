// SPDX-License-Identifier: Apache-2.0
#include "calib/adjust/all_unknowns/costs.h"

#include <algorithm>
#include <utility>

namespace plenocal::internal {
namespace {

using RowMajor = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

// Derivative by a chart about the solve's start, at `delta`, from that by the chart about the
// present value.
Matrix6d FromStart(const double* delta) {
  Matrix6d chart = Matrix6d::Identity();
  chart.bottomRightCorner<3, 3>() = LeftJacobian(Eigen::Map<const Vector6d>(delta).tail<3>());
  return chart;
}

}  // namespace

ViewCost::ViewCost(const Bundle& bundle,
                   const Unknowns& unknowns,
                   const ViewUnknowns& view,
                   std::span<const BundleObservation> observations,
                   const RobustLoss& loss,
                   RowMemory* rows)
    : bundle_(bundle),
      unknowns_(unknowns),
      of_(view),
      observations_(observations),
      loss_(loss),
      memory_(*rows) {
  const CameraModel& model =
      *bundle.cameras[static_cast<size_t>(observations.front().camera)].model;
  const auto used = std::ranges::count(observations, true, &BundleObservation::used);
  set_num_residuals(static_cast<int>(used) * static_cast<int>(model.measured.size()));
  std::vector<int>& sizes = *mutable_parameter_block_sizes();
  sizes.push_back(static_cast<int>(view.intrinsics->block->Size()));
  if (view.extrinsics != nullptr) sizes.push_back(6);
  sizes.push_back(6);
  if (bundle.EstimatesJitter()) sizes.push_back(6);
  if (view.target) sizes.push_back(6);
  if (bundle.EstimatesMarkers()) sizes.push_back(static_cast<int>(unknowns.marker_block_size));
}

bool ViewCost::Evaluate(double const* const* /*parameters*/,
                        double* residuals,
                        double** jacobians) const {
  const auto frame = static_cast<size_t>(observations_.front().frame);
  const auto c = static_cast<size_t>(observations_.front().camera);
  const BundleCamera& camera = bundle_.cameras[c];
  // Limits are part of the model's domain.
  if (!WithinBounds(*camera.model, camera.params.data())) return false;
  const LinearisedView view = ViewOf(bundle_, frame, c);
  const ViewCharts charts = ChartsOf(bundle_, frame, c);
  MarkerRows& rows = jacobians == nullptr ? memory_.residuals : memory_.derivatives;
  Eigen::Index row = 0;
  for (size_t begin = 0, end = 0; begin < observations_.size(); begin = end) {
    while (end < observations_.size() && observations_[end].marker == observations_[begin].marker) {
      ++end;
    }
    const auto marker = static_cast<size_t>(observations_[begin].marker);
    const Eigen::Vector3d& p_target = bundle_.markers[marker].position;
    if (!rows.Load(view, p_target, observations_.subspan(begin, end - begin), loss_)) return false;
    const Eigen::Index count = rows.Count();
    Eigen::Map<Eigen::VectorXd>(residuals + row, count) = rows.Residual();
    if (jacobians == nullptr) {
      row += count;
      continue;
    }
    size_t block = 0;
    // Writes derivatives by a block, where Ceres needs them.
    const auto set = [&](const auto& derivatives) {
      const int width = parameter_block_sizes()[block];
      if (jacobians[block] != nullptr) {
        Eigen::Map<RowMajor>(jacobians[block] + row * width, count, width) = derivatives();
      }
      ++block;
    };
    set([&] {
      RowMajor J = RowMajor::Zero(count, parameter_block_sizes()[0]);
      for (size_t k = 0; k < camera.params.size(); ++k) {
        const size_t slot = of_.intrinsics->Slot(k);
        if (slot == kNoSlot) continue;
        J.col(static_cast<Eigen::Index>(slot)) += rows.Params().col(static_cast<Eigen::Index>(k));
      }
      return J;
    });
    if (of_.extrinsics != nullptr) {
      set([&] { return RowMajor(rows.Extrinsics() * FromStart(of_.extrinsics->delta)); });
    }
    set([&] { return RowMajor(rows.Pose() * charts.pose * FromStart(of_.pose->delta)); });
    if (bundle_.EstimatesJitter()) {
      set([&] { return RowMajor(rows.Pose() * charts.jitter); });
    }
    Eigen::Matrix3d R_moved = Eigen::Matrix3d::Identity();  // of the target, since the start
    if (of_.target) {
      const ChartedPose& pose = unknowns_.targets[*of_.target];
      const RigidTransform& T_target_own = bundle_.targets[*of_.target].T_target_own;
      R_moved = T_target_own.R * pose.origin.R.transpose();
      set([&] {
        return RowMajor(rows.Position() * PointByTargetPose(T_target_own, p_target) *
                        FromStart(pose.delta));
      });
    }
    if (bundle_.EstimatesMarkers()) {
      set([&] {
        const auto width = static_cast<Eigen::Index>(unknowns_.marker_block_size);
        RowMajor J = RowMajor::Zero(count, width);
        J.middleCols<3>(3 * static_cast<Eigen::Index>(marker) % width) = rows.Position() * R_moved;
        return J;
      });
    }
    row += count;
  }
  return true;
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

CalibrationPriorCost::CalibrationPriorCost(const Bundle& bundle, const Unknowns& unknowns)
    : bundle_(bundle), unknowns_(unknowns) {
  for (const CalibrationPrior::Unknown& unknown : bundle.prior->unknowns) {
    const IntrinsicsBlock& block = *unknowns.intrinsics[unknown.camera].block;
    block_of_.push_back(unknown.param ? AddBlock(block.values, block.Size())
                                      : AddBlock(unknowns.extrinsics[unknown.camera].delta, 6));
  }
  set_num_residuals(static_cast<int>(bundle.prior->weight.rows()));
}

size_t CalibrationPriorCost::AddBlock(double* values, size_t size) {
  const auto found = std::ranges::find(blocks_, values);
  if (found != blocks_.end()) return static_cast<size_t>(found - blocks_.begin());
  blocks_.push_back(values);
  mutable_parameter_block_sizes()->push_back(static_cast<int>(size));
  return blocks_.size() - 1;
}

bool CalibrationPriorCost::Evaluate(double const* const* /*parameters*/,
                                    double* residuals,
                                    double** jacobians) const {
  const CalibrationPrior& prior = *bundle_.prior;
  Eigen::Map<Eigen::VectorXd>(residuals, num_residuals()) =
      prior.weight * DeviationFromPrior(bundle_);
  for (size_t b = 0; jacobians != nullptr && b < blocks_.size(); ++b) {
    if (jacobians[b] == nullptr) continue;
    RowMajor J = RowMajor::Zero(prior.weight.cols(), parameter_block_sizes()[b]);
    for (size_t i = 0; i < block_of_.size(); ++i) {
      if (block_of_[i] != b) continue;
      const CalibrationPrior::Unknown& unknown = prior.unknowns[i];
      const auto row = static_cast<Eigen::Index>(i);
      if (unknown.param) {
        const size_t slot = unknowns_.intrinsics[unknown.camera].Slot(*unknown.param);
        if (slot != kNoSlot) J(row, static_cast<Eigen::Index>(slot)) = 1;
      } else {
        J.row(row) = ChartDerivative(prior.T_camera_rig[unknown.camera],
                                     bundle_.cameras[unknown.camera].T_camera_rig,
                                     unknown.component)
                         .transpose() *
                     FromStart(blocks_[b]);
      }
    }
    Eigen::Map<RowMajor>(jacobians[b], num_residuals(), J.cols()) = prior.weight * J;
  }
  return true;
}

}  // namespace plenocal::internal
