// SPDX-License-Identifier: Apache-2.0
#include "calib/adjust/priors.h"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <limits>

namespace plenocal::internal {
namespace {

// Derivative of component `component` of a pose in the chart about `origin` by the chart about its
// present value `T`.
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

}  // namespace

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

std::vector<SparseRow> RowsOfPriors(const BundleState& bundle, const UnknownLayout& layout) {
  std::vector<SparseRow> rows = RowsOfParamPriors(bundle, layout);
  std::ranges::move(RowsOfCalibrationPrior(bundle, layout), std::back_inserter(rows));
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

std::vector<SparseRow> RowsOfDistances(const BundleState& bundle,
                                       const std::function<int(int marker)>& first) {
  std::vector<MarkerDistance> distances = bundle.distances;
  if (bundle.scale_distance) distances.push_back(*bundle.scale_distance);
  std::erase_if(distances, [&](const MarkerDistance& distance) {
    const auto is_out = [&](int marker) { return first(marker) < 0; };
    return std::ranges::any_of(distance.markers_a, is_out) ||
           std::ranges::any_of(distance.markers_b, is_out);
  });
  std::vector<int> columns;  // of J, first of three
  for (const MarkerDistance& distance : distances) {
    for (const int marker : distance.markers_a) columns.push_back(first(marker));
    for (const int marker : distance.markers_b) columns.push_back(first(marker));
  }
  std::ranges::sort(columns);
  columns.erase(std::unique(columns.begin(), columns.end()), columns.end());
  const auto count = std::ssize(distances);
  Eigen::MatrixXd J = Eigen::MatrixXd::Zero(count, 3 * std::ssize(columns));
  Eigen::VectorXd residual(count), common(count);
  for (Eigen::Index i = 0; i < count; ++i) {
    const MarkerDistance& distance = distances[static_cast<size_t>(i)];
    const auto centre = [&](const std::vector<int>& markers) {
      Eigen::Vector3d sum = Eigen::Vector3d::Zero();
      for (const int marker : markers) sum += bundle.markers[static_cast<size_t>(marker)].position;
      return Eigen::Vector3d(sum / static_cast<double>(markers.size()));
    };
    const Eigen::Vector3d apart = centre(distance.markers_a) - centre(distance.markers_b);
    const auto add = [&](const std::vector<int>& markers, double sign) {
      for (const int marker : markers) {
        const auto column = std::ranges::lower_bound(columns, first(marker)) - columns.begin();
        J.block<1, 3>(i, 3 * column) += sign / static_cast<double>(markers.size()) *
                                        apart.transpose() / (apart.norm() * distance.sigma);
      }
    };
    add(distance.markers_a, 1);
    add(distance.markers_b, -1);
    residual[i] = apart.isZero(0) ? std::numeric_limits<double>::infinity()
                                  : (apart.norm() - distance.length) / distance.sigma;
    common[i] = distance.common_sigma / distance.sigma;
  }
  if (!residual.allFinite()) J.setZero();
  // Inverse root of 1 + c c', as `MarkerRows::Whiten`'s.
  if (const double square = common.squaredNorm(); square > 0) {
    const double part = (1 - 1 / std::sqrt(1 + square)) / square;
    J -= part * common * (common.transpose() * J);
    residual -= part * common.dot(residual) * common;
  }
  std::vector<SparseRow> rows(distances.size());
  for (size_t i = 0; i < rows.size(); ++i) {
    const auto row = static_cast<Eigen::Index>(i);
    rows[i].residual = residual[row];
    for (Eigen::Index k = 0; k < J.cols(); ++k) {
      if (J(row, k) == 0) continue;
      rows[i].J.emplace_back(columns[static_cast<size_t>(k / 3)] + static_cast<int>(k % 3),
                             J(row, k));
    }
  }
  return rows;
}

}  // namespace plenocal::internal
