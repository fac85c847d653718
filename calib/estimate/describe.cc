// SPDX-License-Identifier: Apache-2.0
#include "calib/estimate/describe.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "calib/estimate/weak_unknowns.h"
#include "calib/files/calibration_tables.h"

namespace plenocal {
namespace {

// Correlations of a camera's first `params` parameters; fixed ones have none.
Eigen::MatrixXd ParamCorrelation(const Uncertainty& uncertainty, size_t c, size_t params) {
  const std::vector<int>& places = uncertainty.param_index[c];
  const auto count = static_cast<Eigen::Index>(params);
  Eigen::MatrixXd correlation = Eigen::MatrixXd::Identity(count, count);
  for (Eigen::Index i = 0; i < count; ++i) {
    for (Eigen::Index j = 0; j < i; ++j) {
      const int a = places[static_cast<size_t>(i)], b = places[static_cast<size_t>(j)];
      if (a < 0 || b < 0) continue;
      correlation(i, j) = correlation(j, i) = uncertainty.correlation(a, b);
    }
  }
  return correlation;
}

// Standard errors of the se(3) vector of a pose, whose six unknowns begin at `place` (-1: not
// estimated) in the chart in which it was estimated; infinite where an undetermined direction has a
// part.
Vector6d SigmaXi(const Uncertainty& uncertainty, int place, const RigidTransform& T) {
  constexpr double kRounding = 1e-6;  // of the largest part
  if (place < 0) return Vector6d::Zero();
  const Matrix6d J = LogJacobian(T);
  Vector6d sigma = (J * uncertainty.covariance.block<6, 6>(place, place) * J.transpose())
                       .diagonal()
                       .cwiseMax(0)
                       .cwiseSqrt();
  for (const auto& direction : uncertainty.undetermined.colwise()) {
    const Vector6d part = J * direction.segment<6>(place);
    for (Eigen::Index i = 0; i < 6; ++i) {
      if (std::abs(part[i]) > kRounding * direction.cwiseAbs().maxCoeff()) {
        sigma[i] = std::numeric_limits<double>::infinity();
      }
    }
  }
  return sigma;
}

// `value` with as many decimals as files hold: the number nearest to the decimal one.
double Rounded(double value, int decimals) {
  const double scale = std::pow(10, decimals);
  return std::round(value * scale) / scale;
}

ResidualRow DescribeResidual(const Bundle& bundle,
                             const BundleObservation& observation,
                             const std::array<double, kMaxObservationSize>& residual) {
  const BundleCamera& camera = bundle.cameras[static_cast<size_t>(observation.camera)];
  ResidualRow row;
  row.frame = observation.frame;
  row.marker = bundle.markers[static_cast<size_t>(observation.marker)].number;
  row.used = observation.used;
  row.noise_sigma = Rounded(camera.noise.Sigma(observation.assumed_sigma), kNoiseSigmaDecimals);
  row.residual = residual;
  for (double& value : row.residual) value = Rounded(value, kResidualDecimals);
  row.values = WithoutDisplacement(observation, camera).values;
  for (double& value : row.values) value = Rounded(value, kResidualDecimals);
  return row;
}

void DescribeObservations(const Calibration& calibration, CalibrationRecord* record) {
  const Bundle& bundle = calibration.bundle;
  const Jitter& jitter = bundle.jitter;
  std::vector<size_t> counts(bundle.cameras.size(), 0);
  for (const BundleObservation& observation : bundle.observations) {
    ++counts[static_cast<size_t>(observation.camera)];
  }
  for (size_t c = 0; c < counts.size(); ++c) record->cameras[c].residuals.reserve(counts[c]);
  const auto residuals = Residuals(bundle);
  for (size_t i = 0; i < residuals.size(); ++i) {
    const BundleObservation& observation = bundle.observations[i];
    const auto c = static_cast<size_t>(observation.camera);
    const auto f = static_cast<size_t>(observation.frame);
    record->cameras[c].residuals.push_back(DescribeResidual(bundle, observation, residuals[i]));
    if (!observation.used || bundle.cameras.size() == 1) continue;
    if (record->cameras[c].view_poses.contains(observation.frame)) continue;
    record->cameras[c].view_poses[observation.frame] = {
        .T_target_rig = bundle.SeenPose(f, c).Inverse(),
        .misplaced = !jitter.delta.empty() && jitter.misplaced[bundle.View(f, c)]};
  }
}

void DescribeMarkers(const Calibration& calibration, CalibrationRecord* record) {
  const Bundle& bundle = calibration.bundle;
  const std::vector<Eigen::Vector3d>& sigmas = calibration.uncertainty.marker_std_errors;
  for (size_t i = 0; i < bundle.markers.size(); ++i) {
    const BundleMarker& marker = bundle.markers[i];
    // Fixed markers have no uncertainty of their own.
    if (bundle.HasLandmarks()) {
      record->markers[marker.number] = {.position = marker.position};
      continue;
    }
    record->markers[marker.number] = {
        .position = marker.position,
        .nominal = marker.nominal,
        .sigma = sigmas.empty() ? Eigen::Vector3d(Eigen::Vector3d::Zero()) : sigmas[i]};
  }
}

std::vector<TargetRecord> DescribeTargets(const Calibration& calibration) {
  std::vector<TargetRecord> records;
  const Uncertainty& uncertainty = calibration.uncertainty;
  for (size_t k = 0; k < calibration.bundle.targets.size(); ++k) {
    const BundleTarget& target = calibration.bundle.targets[k];
    records.push_back(
        {.name = target.name,
         .T_target_own = target.T_target_own,
         .sigma_xi = SigmaXi(uncertainty, uncertainty.target_index[k], target.T_target_own)});
  }
  return records;
}

}  // namespace

CalibratedCamera DescribeCamera(const Calibration& calibration, size_t c) {
  const BundleCamera& camera = calibration.bundle.cameras[c];
  const std::vector<double>& std_errors = calibration.uncertainty.param_std_errors[c];
  const auto own = static_cast<std::ptrdiff_t>(camera.ModelParams());
  CalibratedCamera described{
      .name = camera.name,
      .model = camera.model,
      .image_size = camera.image_size,
      .image_circle = camera.image_circle,
      .config = camera.config,
      .params = {camera.params.begin(), camera.params.begin() + own},
      .covariance =
          CovarianceOf({std_errors.begin(), std_errors.begin() + own},
                       ParamCorrelation(calibration.uncertainty, c, camera.ModelParams())),
      .T_camera_rig = camera.T_camera_rig,
      .sigma_xi = SigmaXi(calibration.uncertainty,
                          calibration.uncertainty.extrinsics_index[c],
                          camera.T_camera_rig),
      .fit = calibration.fits[c]};
  if (const std::optional<size_t> shift = camera.Find(nuisances::kTimeShift)) {
    described.time_shift = {.value = camera.params[*shift], .sigma = std_errors[*shift]};
  }
  for (size_t k = camera.ModelParams(); k < camera.params.size(); ++k) {
    const bool estimated = calibration.uncertainty.param_index[c][k] >= 0;
    if (!estimated || camera.nuisances[k - camera.ModelParams()] != &nuisances::kSharedError)
      continue;
    described.nuisances.push_back({.value = camera.params[k], .sigma = std_errors[k]});
  }
  for (size_t k = 0; k < std::min(camera.at_bound.size(), camera.ModelParams()); ++k) {
    if (camera.at_bound[k]) described.at_bound.emplace_back(camera.model->params[k].name);
  }
  if (calibration.jackknife) {
    const std::vector<double>& jackknife = calibration.jackknife->param_std_errors[c];
    described.sigma_jackknife.assign(jackknife.begin(), jackknife.begin() + own);
    const Vector6d& xi = calibration.jackknife->extrinsics_std_errors[c];
    described.sigma_xi_jackknife.assign(xi.begin(), xi.end());
  }
  return described;
}

Correlations DescribeCorrelations(const Calibration& calibration) {
  const Uncertainty& uncertainty = calibration.uncertainty;
  Correlations result{uncertainty.names, uncertainty.correlation};
  // Poses in the rig were estimated in another chart than files hold.
  const Eigen::VectorXd sigma = uncertainty.covariance.diagonal().cwiseMax(0).cwiseSqrt();
  const auto convert = [&](int place, const RigidTransform& T) {
    if (place < 0) return;
    Matrix6d J = LogJacobian(T) * sigma.segment<6>(place).asDiagonal();
    const Vector6d sigma_xi =
        (J * result.matrix.block<6, 6>(place, place) * J.transpose()).diagonal().cwiseSqrt();
    constexpr double kLeast = 1e-300;  // an exact pose has no correlations, but not NaN
    J = sigma_xi.cwiseMax(kLeast).cwiseInverse().asDiagonal() * J;
    result.matrix.middleRows<6>(place) = (J * result.matrix.middleRows<6>(place)).eval();
    result.matrix.middleCols<6>(place) =
        (result.matrix.middleCols<6>(place) * J.transpose()).eval();
  };
  for (size_t c = 0; c < uncertainty.extrinsics_index.size(); ++c) {
    convert(uncertainty.extrinsics_index[c], calibration.bundle.cameras[c].T_camera_rig);
  }
  for (size_t k = 0; k < uncertainty.target_index.size(); ++k) {
    convert(uncertainty.target_index[k], calibration.bundle.targets[k].T_target_own);
  }
  return result;
}

CalibrationRecord Describe(const Calibration& calibration) {
  const Bundle& bundle = calibration.bundle;
  CalibrationRecord record;
  for (size_t c = 0; c < bundle.cameras.size(); ++c) {
    record.cameras.push_back(DescribeCamera(calibration, c));
  }
  for (size_t f = 0; f < calibration.frames.size(); ++f) {
    record.frames.push_back({calibration.frames[f], bundle.T_rig_target[f].Inverse()});
  }
  DescribeMarkers(calibration, &record);
  record.targets = DescribeTargets(calibration);
  for (size_t k = 0; calibration.uncertainty.scale_index >= 0 && k < bundle.scales.size(); ++k) {
    const auto i = calibration.uncertainty.scale_index + static_cast<Eigen::Index>(k);
    record.target_scales.emplace_back(
        NameOfScale(bundle, bundle.scales[k]),
        EstimatedNumber{bundle.scales[k].value,
                        std::sqrt(calibration.uncertainty.covariance(i, i))});
  }
  DescribeObservations(calibration, &record);
  record.adjustment = {.converged = calibration.converged,
                       .iterations = calibration.iterations,
                       .rejection_sigmas = calibration.rejection_threshold,
                       .marker_freedom = bundle.marker_freedom};
  if (const Jitter& jitter = bundle.jitter; !jitter.delta.empty()) {
    record.jitter = {.translation_sigma = jitter.translation_sigma,
                     .rotation_sigma = jitter.rotation_sigma,
                     .misplaced = static_cast<int>(std::ranges::count(jitter.misplaced, true))};
  }
  record.correlations = DescribeCorrelations(calibration);
  record.undetermined = calibration.uncertainty.open;
  record.weak = FindWeakUnknowns(bundle, calibration.uncertainty);
  record.findings = calibration.findings;
  for (const LeftOut& item : calibration.left_out) {
    record.left_out.push_back(item.where + ": " + item.reason);
  }
  return record;
}

}  // namespace plenocal
