// SPDX-License-Identifier: Apache-2.0
#include "calib/adjust/priors.h"

#include <Eigen/Cholesky>
#include <algorithm>

namespace plenocal::internal {

std::vector<SparseRow> RowsOfParamPriors(const BundleState& bundle, const UnknownLayout& layout) {
  std::vector<SparseRow> rows;
  for (const ParamPrior& prior : ParamPriors(bundle)) {
    SparseRow row{.J = {}, .residual = -prior.value / prior.sigma};
    for (const auto& [param, weight] : prior.terms) {
      const int index = layout.params[param.camera][param.param];
      if (index >= 0) row.J.emplace_back(index, weight / prior.sigma);
      row.residual += weight / prior.sigma * bundle.cameras[param.camera].params[param.param];
    }
    if (!row.J.empty()) rows.push_back(std::move(row));
  }
  return rows;
}

Vector6d ChartDerivative(const RigidTransform& origin,
                         const RigidTransform& T,
                         Eigen::Index component) {
  Vector6d J = Vector6d::Zero();
  if (component < 3) {
    J[component] = 1;
  } else {
    const Eigen::Vector3d w = LocalCoordinates(origin, T).tail<3>();
    J.tail<3>() = LeftJacobian(w).inverse().row(component - 3);
  }
  return J;
}

std::vector<SparseRow> RowsOfCalibrationPrior(const BundleState& bundle,
                                              const UnknownLayout& layout) {
  if (!bundle.prior) return {};
  const CalibrationPrior& prior = *bundle.prior;
  const Eigen::VectorXd residual = prior.weight * DeviationFromPrior(bundle);
  std::vector<SparseRow> rows(static_cast<size_t>(residual.size()));
  for (size_t r = 0; r < rows.size(); ++r) {
    const auto row = static_cast<Eigen::Index>(r);
    rows[r].residual = residual[row];
    for (size_t i = 0; i < prior.unknowns.size(); ++i) {
      const CalibrationPrior::Unknown& unknown = prior.unknowns[i];
      const double weight = prior.weight(row, static_cast<Eigen::Index>(i));
      if (weight == 0) continue;
      if (unknown.param) {
        const int index = layout.params[unknown.camera][*unknown.param];
        if (index >= 0) rows[r].J.emplace_back(index, weight);
        continue;
      }
      const int first = layout.extrinsics[unknown.camera];
      if (first < 0) continue;
      const Vector6d J = ChartDerivative(prior.T_camera_rig[unknown.camera],
                                         bundle.cameras[unknown.camera].T_camera_rig,
                                         unknown.component);
      for (int k = 0; k < 6; ++k) {
        if (J[k] != 0) rows[r].J.emplace_back(first + k, weight * J[k]);
      }
    }
  }
  return rows;
}

void AddInformation(const std::vector<SparseRow>& rows, Eigen::MatrixXd* information) {
  for (const SparseRow& row : rows) {
    for (const auto& [a, J_a] : row.J) {
      for (const auto& [b, J_b] : row.J) {
        if (a >= b) (*information)(a, b) += J_a * J_b;
      }
    }
  }
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

}  // namespace plenocal::internal
