// SPDX-License-Identifier: Apache-2.0
#include "calib/adjust/priors.h"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <limits>
#include <optional>

#include "calib/adjust/rows.h"

namespace plenocal::internal {
namespace {

// Derivative of a pose in the chart about `origin` by the chart about its present value `T`.
Matrix6d ChartDerivative(const RigidTransform& origin, const RigidTransform& T) {
  Matrix6d J = Matrix6d::Identity();
  J.bottomRightCorner<3, 3>() = LeftJacobian(LocalCoordinates(origin, T).tail<3>()).inverse();
  return J;
}

}  // namespace

std::vector<SparseRow> RowsOfParamPriors(const BundleState& bundle, const UnknownLayout& layout) {
  std::vector<SparseRow> rows;
  for (const ParamPrior& prior : ParamPriors(bundle)) {
    SparseRow row{.J = {}, .residual = -prior.value / prior.sigma};
    for (const auto& [param, weight] : prior.terms) {
      const int index = layout.params[param.camera][param.param];
      if (index >= 0) row.J[index] += weight / prior.sigma;
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
  Eigen::MatrixXd D = Eigen::MatrixXd::Zero(std::ssize(prior.unknowns), layout.head);
  for (Eigen::Index i = 0; i < D.rows(); ++i) {
    const CalibrationPrior::Unknown& unknown = prior.unknowns[static_cast<size_t>(i)];
    const size_t c = unknown.camera;
    const int first = unknown.param ? layout.params[c][*unknown.param] : layout.extrinsics[c];
    if (first < 0) continue;
    if (unknown.param) {
      D(i, first) = 1;
    } else {
      D.block<1, 6>(i, first) =
          ChartDerivative(prior.T_camera_rig[c], bundle.cameras[c].T_camera_rig)
              .row(unknown.component);
    }
  }
  const Eigen::VectorXd residual = prior.weight * DeviationFromPrior(bundle);
  const Eigen::MatrixXd J = prior.weight * D;
  std::vector<SparseRow> rows(static_cast<size_t>(residual.size()));
  for (size_t r = 0; r < rows.size(); ++r) {
    const auto row = static_cast<Eigen::Index>(r);
    rows[r].residual = residual[row];
    for (int k = 0; k < layout.head; ++k) {
      if (J(row, k) != 0) rows[r].J[k] = J(row, k);
    }
  }
  return rows;
}

std::vector<SparseRow> RowsOfPriors(const BundleState& bundle, const UnknownLayout& layout) {
  std::vector<SparseRow> rows = RowsOfParamPriors(bundle, layout);
  std::ranges::move(RowsOfCalibrationPrior(bundle, layout), std::back_inserter(rows));
  for (size_t k = 0; layout.scales >= 0 && k < bundle.scales.size(); ++k) {
    const auto& [target, axes, sigma, value] = bundle.scales[k];
    rows.push_back(
        {.J = {{layout.scales + static_cast<int>(k), 1 / sigma}}, .residual = value / sigma});
  }
  return rows;
}

void AddInformation(const std::vector<SparseRow>& rows,
                    Eigen::MatrixXd* information,
                    int left_out) {
  for (const SparseRow& row : rows) {
    for (const auto& [a, J_a] : row.J) {
      for (const auto& [b, J_b] : row.J) {
        if (a >= b && b < left_out) (*information)(a, b) += J_a * J_b;
      }
    }
  }
}

std::vector<SparseRow> RowsOfDistances(const BundleState& bundle, const UnknownLayout& layout) {
  if (!layout.markers) return {};
  return RowsOfDistances(
      bundle, layout, [&](int marker) { return layout.Marker(marker); }, bundle);
}

std::vector<SparseRow> RowsOfDistances(const BundleState& bundle,
                                       const UnknownLayout& layout,
                                       const std::function<int(int marker)>& first,
                                       const BundleState& start) {
  std::vector<MarkerDistance> distances = bundle.distances;
  if (bundle.scale_distance) distances.push_back(*bundle.scale_distance);
  std::vector<SparseRow> rows;
  std::vector<double> common;  // sigma of the common error over that of each row
  for (const MarkerDistance& distance : distances) {
    const auto is_out = [&](int marker) { return first(marker) < 0; };
    if (std::ranges::any_of(distance.markers_a, is_out) ||
        std::ranges::any_of(distance.markers_b, is_out)) {
      continue;
    }
    const auto centre = [&](const std::vector<int>& markers) {
      Eigen::Vector3d sum = Eigen::Vector3d::Zero();
      for (const int marker : markers) sum += bundle.markers[static_cast<size_t>(marker)].position;
      return Eigen::Vector3d(sum / static_cast<double>(markers.size()));
    };
    const Eigen::Vector3d apart = centre(distance.markers_a) - centre(distance.markers_b);
    // Zero where the ends coincide.
    const Eigen::RowVector3d J = apart.normalized().transpose() / distance.sigma;
    SparseRow& row = rows.emplace_back();
    row.residual = apart.isZero(0) ? std::numeric_limits<double>::infinity()
                                   : (apart.norm() - distance.length) / distance.sigma;
    const auto add = [&](const std::vector<int>& markers, double sign) {
      for (const int marker : markers) {
        const auto add_columns = [&](int index, const auto& by_position) {
          const auto by = (sign / static_cast<double>(markers.size()) * J * by_position).eval();
          for (int i = 0; i < by.size(); ++i) row.J[index + i] += by[i];
        };
        for (size_t k = 0; layout.scales >= 0 && k < bundle.scales.size(); ++k) {
          add_columns(layout.scales + static_cast<int>(k),
                      bundle.ByScale(bundle.scales[k], marker));
        }
        const std::optional<size_t> target = bundle.FreeTarget(marker);
        if (!target) {
          add_columns(first(marker), Eigen::Matrix3d(Eigen::Matrix3d::Identity()));
          continue;
        }
        const RigidTransform& T = bundle.targets[*target].T_target_own;
        add_columns(first(marker),
                    Eigen::Matrix3d(T.R * start.targets[*target].T_target_own.R.transpose()));
        add_columns(layout.targets[*target],
                    PointByTargetPose(T, bundle.markers[static_cast<size_t>(marker)].position));
      }
    };
    add(distance.markers_a, 1);
    add(distance.markers_b, -1);
    common.push_back(distance.common_sigma / distance.sigma);
  }
  // Inverse root of 1 + c c', as `MarkerRows::Whiten`'s.
  double square = 0;
  for (const double c : common) square += c * c;
  if (square == 0) return rows;
  const auto add = [](double factor, const SparseRow& row, SparseRow* sum) {
    sum->residual += factor * row.residual;
    for (const auto& [unknown, derivative] : row.J) sum->J[unknown] += factor * derivative;
  };
  SparseRow along;
  for (size_t i = 0; i < rows.size(); ++i) add(common[i], rows[i], &along);
  const double part = (1 - 1 / std::sqrt(1 + square)) / square;
  for (size_t i = 0; i < rows.size(); ++i) add(-part * common[i], along, &rows[i]);
  return rows;
}

}  // namespace plenocal::internal
