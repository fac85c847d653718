// SPDX-License-Identifier: Apache-2.0
#include "apps/evaluate/truth_uncertainty.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <string>
#include <string_view>
#include <vector>

#include "calib/base/error.h"
#include "calib/files/checks/correlation_check.h"
#include "calib/io/yaml.h"

namespace plenocal {
namespace {

using Vector14d = Eigen::Matrix<double, 14, 1>;

Eigen::Vector3d ReadCentre(const YamlNode& node) {
  return Eigen::Vector3d(node.AsNumbers(3).data());
}

// Throws for what is no covariance: a variance below zero would be no number as a standard error.
void CheckCovariance(const Eigen::Matrix<double, 14, 14>& matrix, const YamlNode& node) {
  // Twelve digits hold a covariance to 5e-12 of itself, and the variances by which it is divided.
  constexpr double kRounding = 1e-11;
  const auto variances = matrix.diagonal();
  if (variances.minCoeff() < 0) node.Fail("expected a covariance, found a negative variance");
  // Translations, rotations and scales differ by orders of magnitude.
  const Eigen::Vector<double, 14> scales =
      (variances.array() > 0).select(variances.array().sqrt().inverse(), 1);
  const Eigen::MatrixXd correlations = scales.asDiagonal() * matrix * scales.asDiagonal();
  std::vector<std::string> names;
  for (int i = 0; i < matrix.rows(); ++i) names.push_back(fmt::format("number {}", i + 1));
  if (const auto defect = CorrelationDefect(correlations, names, kRounding)) {
    node.Fail("expected a covariance: " + *defect);
  }
}

TruthUncertainty ReadUncertainty(const YamlNode& node) {
  TruthUncertainty uncertainty;
  uncertainty.start_centre = ReadCentre(node.At("start_centre"));
  uncertainty.end_centre = ReadCentre(node.At("end_centre"));
  auto& matrix = uncertainty.covariance.segments;
  const std::vector<YamlNode> rows = node.At("matrix").Elements();
  if (rows.size() != 14) node.At("matrix").Fail(fmt::format("14 rows, found {}", rows.size()));
  for (size_t i = 0; i < rows.size(); ++i) {
    matrix.row(static_cast<Eigen::Index>(i)) = Vector14d(rows[i].AsNumbers(14).data()).transpose();
  }
  CheckCovariance(matrix, node.At("matrix"));
  return uncertainty;
}

// The small similarity `change` about `centre`.
Similarity SmallSimilarity(const Vector7d& change, const Eigen::Vector3d& centre) {
  Similarity small{.s = 1 + change[6], .R = ExpRotation(change.segment<3>(3))};
  small.t = centre + change.head<3>() - small.s * (small.R * centre);
  return small;
}

using Values = Eigen::Matrix<double, 5, 1>;  // in the order of `LoopMetricErrors`

Values MetricValues(const LoopMetrics& metrics) {
  return {metrics.ScaleDrift(),
          metrics.rotation_drift_deg,
          metrics.translation_drift,
          metrics.alignment_error,
          metrics.absolute_scale};
}

// Derivatives of the metrics by the similarities [start, end] of the truth.
Eigen::Matrix<double, 5, 14> DifferentiateMetrics(const LoopMetrics& metrics,
                                                  const Trajectory& estimate,
                                                  const TruthUncertainty& uncertainty) {
  constexpr double kStep = 1e-6;  // m, rad, 1
  const auto changed = [&](const Vector14d& change) {
    return MetricValues(
        MeasureDrift(estimate,
                     SmallSimilarity(change.head<7>(), uncertainty.start_centre) * metrics.T_s_gt,
                     SmallSimilarity(change.tail<7>(), uncertainty.end_centre) * metrics.T_e_gt));
  };
  Eigen::Matrix<double, 5, 14> derivatives;
  for (int i = 0; i < 14; ++i) {
    const Vector14d step = kStep * Vector14d::Unit(i);
    derivatives.col(i) = (changed(step) - changed(-step)) / (2 * kStep);
  }
  return derivatives;
}

// The root of a variance that rounding may have made negative; NaN stays.
double Root(double variance) { return std::sqrt(std::max(variance, 0.0)); }

// The metrics' deviations for an estimate without errors that follows the measured path.
Values ComputeFloors(const LoopMetrics& metrics,
                     const Trajectory& estimate,
                     const TruthUncertainty& uncertainty) {
  const LoopCovariance& covariance = uncertainty.covariance;
  const Matrix7d relative = covariance.Relative();
  const PathSegment start{.positions = {}, .centre = uncertainty.start_centre};
  const PathSegment end{.positions = {}, .centre = uncertainty.end_centre};
  std::vector<Eigen::Vector3d> path;
  for (const Eigen::Vector3d& p : estimate.positions) path.push_back(metrics.T_s_gt * p);
  const std::vector<Eigen::Vector3d> origin{Eigen::Vector3d::Zero()};
  const auto& C = covariance.segments;
  return {Root(relative(6, 6)),
          Root(relative.block<3, 3>(3, 3).trace()) * 180 / std::numbers::pi,
          covariance.AlignmentFloor(start, end, origin),
          covariance.AlignmentFloor(start, end, path),
          Root(C(6, 6) + 2 * C(6, 13) + C(13, 13)) / 2};
}

}  // namespace

GroundTruthFile ReadGroundTruth(const std::filesystem::path& path, const std::string& camera) {
  const YamlNode root = YamlNode::ReadFile(path);
  root.CheckVersion();
  const YamlNode cameras = root.At("cameras");
  const auto entries = cameras.Entries();
  if (entries.empty()) cameras.Fail("names no camera");
  GroundTruthFile file{
      .cameras = {}, .segments = {}, .uncertainty = ReadUncertainty(root.At("segment_covariance"))};
  if (root.Has("scale")) {
    const YamlNode sigma = root.At("scale").At("sigma");
    file.uncertainty.covariance.scale_sigma = sigma.AsNumber();
    if (file.uncertainty.covariance.scale_sigma < 0) sigma.Fail("expected a number of at least 0");
  }
  for (const auto& [name, node] : entries) {
    file.cameras.push_back(name);
    if (!file.segments.empty() || (!camera.empty() && camera != name)) continue;
    file.segments = path.parent_path() / node.At("segments").AsString();
  }
  if (file.segments.empty()) {
    const std::vector<std::string_view> names(file.cameras.begin(), file.cameras.end());
    cameras.Fail(fmt::format("no camera '{}'{}", camera, SuggestName(camera, names)));
  }
  return file;
}

LoopMetricErrors ErrorsByTruth(const LoopMetrics& metrics,
                               const Trajectory& estimate,
                               const TruthUncertainty& uncertainty) {
  const auto J = DifferentiateMetrics(metrics, estimate, uncertainty);
  const Values floors = ComputeFloors(metrics, estimate, uncertainty);
  const Values deviations = MetricValues(metrics) - Values{1, 0, 0, 0, 1};
  const auto error = [&](int i) {
    const double variance = (J.row(i) * uncertainty.covariance.segments * J.row(i).transpose())(0);
    const bool resolved = std::abs(deviations[i]) >= floors[i];
    // The derivative of a length near zero does not describe its errors.
    return MetricError{resolved ? Root(variance) : floors[i], floors[i], resolved};
  };
  return {error(0), error(1), error(2), error(3), error(4)};
}

}  // namespace plenocal
