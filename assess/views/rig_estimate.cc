// SPDX-License-Identifier: Apache-2.0
#include "assess/views/rig_estimate.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <tuple>

#include "calib/base/format_error.h"
#include "calib/base/linear_algebra.h"
#include "calib/base/names.h"
#include "calib/base/statistics.h"

namespace plenocal {
namespace {

// Sigma of a marker of a detector that states none, px.
constexpr double kUsualSigma = 0.1;

void RefuseRecord(const CalibrationRecord& calibration) {
  const std::string file = calibration.path.string();
  if (calibration.HasScene()) {
    throw InputError("{}: calibrated from scene points; next views are for a target", file);
  }
  for (const CalibratedCamera& camera : calibration.cameras) {
    if (camera.model->support_size == 0) continue;
    throw InputError(
        "{}: camera {} has the model {}, whose many parameters are local; "
        "calibrate with a model of few parameters and follow the suggestions "
        "for it: they serve both",
        file,
        camera.name,
        camera.model->name);
  }
  const bool has_points =
      std::ranges::any_of(calibration.cameras,
                          [](const CalibratedCamera& camera) { return !camera.residuals.empty(); });
  if (!has_points) {
    throw InputError("{}: the calibration has no points (residuals.csv)", file);
  }
  // A second camera has its extrinsics.
  const CalibratedCamera& first = calibration.cameras[0];
  bool is_held = calibration.cameras.size() == 1;
  for (size_t k = 0; k < first.params.size(); ++k) is_held = is_held && first.Sigma(k) == 0;
  if (is_held) {
    throw InputError("{}: states no standard error, so that views have nothing to determine", file);
  }
}

BundleCamera CameraOf(const CalibratedCamera& camera, bool is_master) {
  BundleCamera result{.name = camera.name,
                      .image_size = camera.image_size,
                      .model = camera.model,
                      .config = camera.config,
                      .params = camera.params,
                      .fixed = {},
                      .T_camera_rig = camera.T_camera_rig,
                      .is_master = is_master};
  for (size_t k = 0; k < camera.params.size(); ++k) result.fixed.push_back(camera.Sigma(k) == 0);
  result.noise.common_sigma = camera.fit.common_noise;
  return result;
}

// Sigma of an observation without the part that it shares with others of its marker.
double OwnSigma(const ResidualRow& row, const CameraFit& fit) {
  const double all = row.noise_sigma > 0 ? row.noise_sigma : fit.noise_sigma;
  const double own = std::sqrt(std::max(0.0, all * all - fit.common_noise * fit.common_noise));
  return own > 0 ? own : kUsualSigma;
}

// Deformations of a target that all its markers share, as displacements of each: symmetric linear
// ones and, normal to a plane, the quadratic ones. Each has the size that independent errors of
// the markers of `marker_sigma` give it.
std::map<int, Eigen::Matrix3Xd> MakeDeformations(const Bundle& bundle) {
  const auto count = static_cast<Eigen::Index>(bundle.markers.size());
  Eigen::Matrix3Xd positions(3, count);
  for (Eigen::Index m = 0; m < count; ++m) {
    positions.col(m) = bundle.markers[static_cast<size_t>(m)].position;
  }
  positions.colwise() -= positions.rowwise().mean().eval();
  const SymmetricEigen3 axes =
      DecomposeSymmetric(Eigen::Matrix3d(positions * positions.transpose()));
  const Eigen::Matrix3Xd local = axes.vectors.transpose() * positions;  // ascending spread
  constexpr double kFlat = 0.02;                                        // of the extent
  const bool flat = axes.values[0] < kFlat * kFlat * axes.values[1];
  std::vector<Eigen::Matrix3Xd> fields;
  const auto add = [&](const Eigen::Matrix3Xd& field) {
    if (field.norm() > 0) fields.push_back(bundle.marker_freedom.Sigma() / field.norm() * field);
  };
  for (int i = flat ? 1 : 0; i < 3; ++i) {
    for (int j = i; j < 3; ++j) {
      Eigen::Matrix3Xd field = Eigen::Matrix3Xd::Zero(3, count);
      field.row(i) += local.row(j);
      if (j != i) field.row(j) += local.row(i);
      add(field);
      if (!flat) continue;
      field.setZero();
      field.row(0) = local.row(i).cwiseProduct(local.row(j));
      field.row(0).array() -= field.row(0).mean();
      add(field);
    }
  }
  std::map<int, Eigen::Matrix3Xd> deformations;
  for (Eigen::Index m = 0; m < count; ++m) {
    Eigen::Matrix3Xd& of_marker = deformations[bundle.markers[static_cast<size_t>(m)].number];
    of_marker.resize(Eigen::NoChange, static_cast<Eigen::Index>(fields.size()));
    for (size_t f = 0; f < fields.size(); ++f) {
      of_marker.col(static_cast<Eigen::Index>(f)) = axes.vectors * fields[f].col(m);
    }
  }
  return deformations;
}

}  // namespace

RigEstimate MakeRigEstimate(const CalibrationRecord& calibration) {
  RefuseRecord(calibration);
  RigEstimate rig;
  Bundle& bundle = rig.bundle;
  for (const CalibratedCamera& camera : calibration.cameras) {
    bundle.cameras.push_back(CameraOf(camera, bundle.cameras.empty()));
  }
  for (const FrameRecord& frame : calibration.frames) {
    bundle.T_rig_target.push_back(frame.T_target_rig.Inverse());
  }
  std::map<int, int> index;
  for (const auto& [number, marker] : calibration.markers) {
    index[number] = static_cast<int>(bundle.markers.size());
    bundle.markers.push_back({number, marker.position, marker.nominal.value_or(marker.position)});
    if (marker.sigma && marker.sigma->allFinite()) rig.marker_sigmas[number] = *marker.sigma;
  }
  if (calibration.adjustment) bundle.marker_freedom = calibration.adjustment->marker_freedom;
  if (bundle.marker_freedom.IsRigid()) rig.marker_sigmas.clear();
  // The size of the print is no error of single markers.
  for (auto& [number, sigma] : rig.marker_sigmas) {
    if (!calibration.target_scales.empty()) sigma = sigma.cwiseMin(bundle.marker_freedom.Sigma());
  }
  if (calibration.jitter) {
    bundle.jitter.translation_sigma = calibration.jitter->translation_sigma;
    bundle.jitter.rotation_sigma = calibration.jitter->rotation_sigma;
    const size_t views = bundle.T_rig_target.size() * bundle.cameras.size();
    bundle.jitter.delta.assign(views, Vector6d::Zero());
    bundle.jitter.misplaced.assign(views, false);
  }
  for (size_t c = 0; c < calibration.cameras.size(); ++c) {
    const CalibratedCamera& camera = calibration.cameras[c];
    std::vector<double> sigmas;
    for (const ResidualRow& row : camera.residuals) {
      BundleObservation observation{.camera = static_cast<int>(c),
                                    .frame = row.frame,
                                    .marker = index.at(row.marker),
                                    .seen = {.marker = row.marker, .values = row.values},
                                    .used = row.used,
                                    .assumed_sigma = OwnSigma(row, camera.fit)};
      if (row.used) sigmas.push_back(observation.assumed_sigma);
      bundle.observations.push_back(std::move(observation));
    }
    rig.sigma_px.push_back(Median(sigmas, kUsualSigma));
    for (const auto& [frame, view] : camera.view_poses) {
      if (!bundle.jitter.misplaced.empty()) {
        bundle.jitter.misplaced[bundle.View(static_cast<size_t>(frame), c)] = view.misplaced;
      }
    }
  }
  std::ranges::stable_sort(bundle.observations, {}, [](const BundleObservation& each) {
    return std::tuple(each.frame, each.camera, each.marker);
  });
  rig.factors.assign(bundle.cameras.size(), 1);
  rig.lenses.resize(bundle.cameras.size());
  return rig;
}

RigUnknowns MakeRigUnknowns(const Bundle& bundle, double distance) {
  constexpr double kSmallest = 1e-12;
  RigUnknowns unknowns;
  std::vector<double> units;
  for (const BundleCamera& camera : bundle.cameras) {
    auto& indices = unknowns.params.emplace_back();
    for (size_t k = 0; k < camera.params.size(); ++k) {
      indices.push_back(camera.fixed[k] ? -1 : static_cast<int>(units.size()));
      if (camera.fixed[k]) continue;
      const Param& param = camera.model->params[k];
      units.push_back(std::max({std::abs(camera.params[k]), param.scale, kSmallest}));
      unknowns.names.push_back(fmt::format("{}.{}", camera.name, param.name));
    }
    unknowns.extrinsics.push_back(camera.is_master ? -1 : static_cast<int>(units.size()));
    if (camera.is_master) continue;
    units.insert(units.end(), 3, distance);
    units.insert(units.end(), 3, 1.0);
    for (const char* name : kExtrinsicsNames) {
      unknowns.names.push_back(fmt::format("{}.T_camera_rig.{}", camera.name, name));
    }
  }
  unknowns.head = static_cast<Eigen::Index>(units.size());
  if (bundle.EstimatesMarkers() && bundle.markers.size() > 1) {
    unknowns.deformations = MakeDeformations(bundle);
    // A displacement of one unit is that of one sigma already.
    units.insert(
        units.end(), static_cast<size_t>(unknowns.deformations.begin()->second.cols()), 1.0);
  }
  unknowns.unit =
      Eigen::Map<Eigen::VectorXd>(units.data(), static_cast<Eigen::Index>(units.size()));
  return unknowns;
}

Eigen::VectorXd UnknownScales(const RigEstimate& rig, const RigUnknowns& unknowns) {
  Eigen::VectorXd scale = unknowns.unit;
  for (size_t c = 0; c < rig.bundle.cameras.size(); ++c) {
    const double root = std::sqrt(rig.factors[c]);
    for (const int index : unknowns.params[c]) {
      if (index >= 0) scale[index] *= root;
    }
    if (unknowns.extrinsics[c] >= 0) scale.segment<6>(unknowns.extrinsics[c]) *= root;
  }
  return scale;
}

std::vector<double> PointDistances(const Bundle& bundle, size_t camera) {
  std::vector<double> distances;
  for (const BundleObservation& each : bundle.observations) {
    if (each.camera != static_cast<int>(camera) || !each.used) continue;
    const RigidTransform T_camera_target = bundle.cameras[camera].T_camera_rig *
                                           bundle.SeenPose(static_cast<size_t>(each.frame), camera);
    distances.push_back(
        (T_camera_target * bundle.markers[static_cast<size_t>(each.marker)].position).norm());
  }
  std::ranges::sort(distances);
  return distances;
}

std::vector<double> ProjectionDistances(const Bundle& bundle) {
  double nearest = std::numeric_limits<double>::infinity(), farthest = 0;
  for (size_t c = 0; c < bundle.cameras.size(); ++c) {
    const std::vector<double> distances = PointDistances(bundle, c);
    if (distances.empty()) continue;
    nearest = std::min(nearest, distances.front());
    farthest = std::max(farthest, distances.back());
  }
  const bool plenoptic = std::ranges::any_of(
      bundle.cameras, [](const BundleCamera& camera) { return camera.model->plenoptic; });
  if (plenoptic) return {nearest, farthest};
  return {nearest, farthest, 10 * farthest};
}

}  // namespace plenocal
