// SPDX-License-Identifier: Apache-2.0
#include "calib/space/space_rig.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>

#include "calib/base/linear_algebra.h"
#include "calib/prior/calibrated_rig.h"
#include "calib/space/point_derivative.h"

namespace plenocal {
namespace {

std::vector<const CalibratedCamera*> Chosen(const CalibrationRecord& calibration,
                                            const std::vector<std::string>& names) {
  std::vector<const CalibratedCamera*> chosen;
  for (const std::string& name : names) chosen.push_back(&FindCamera(calibration, name));
  if (!names.empty()) return chosen;
  for (const CalibratedCamera& camera : calibration.cameras) chosen.push_back(&camera);
  return chosen;
}

// K of docs/space.md, 6 x theta.
Eigen::MatrixXd FollowedMotion(const CalibrationRecord& calibration,
                               const std::vector<const CalibratedCamera*>& chosen,
                               const SpaceRig& rig) {
  Matrix6d normal = Matrix6d::Zero();
  Eigen::MatrixXd mixed = Eigen::MatrixXd::Zero(6, rig.Size());
  const RigidTransform& T_master_rig = chosen[0]->T_camera_rig;
  for (size_t c = 0; c < chosen.size(); ++c) {
    for (const ResidualRow& row : chosen[c]->residuals) {
      const auto marker = calibration.markers.find(row.marker);
      if (!row.used || marker == calibration.markers.end()) continue;
      const FrameRecord& frame = calibration.frames[static_cast<size_t>(row.frame)];
      const Eigen::Vector3d X =
          T_master_rig * (frame.T_target_rig.Inverse() * marker->second.position);
      PointDerivative seen;
      if (!Differentiate(rig, {.camera = c, .values = row.values}, X, 1, &seen)) continue;
      Eigen::Matrix<double, 3, 6> moved;
      moved << Eigen::Matrix3d::Identity(), -Hat(X);
      const Eigen::MatrixXd A = seen.by_point * moved;
      const double sigma = row.noise_sigma > 0 ? row.noise_sigma : rig.NoiseOf(c, 0);
      if (!(sigma > 0)) continue;
      normal += A.transpose() * A / (sigma * sigma);
      mixed += A.transpose() * seen.by_theta / (sigma * sigma);
    }
  }
  if (normal.isZero()) return {};
  const Eigen::MatrixXd follow = -SolveSymmetric(normal, mixed);
  return follow.allFinite() ? follow : Eigen::MatrixXd();
}

void AddOpen(const CalibratedCamera& camera, std::vector<std::string>* open) {
  for (size_t k = 0; k < camera.params.size(); ++k) {
    if (!std::isinf(camera.Sigma(k))) continue;
    open->push_back(camera.name + "." + std::string(camera.model->params[k].name));
  }
  if (!camera.sigma_xi.allFinite()) open->push_back(camera.name + ".T_camera_rig");
}

}  // namespace

double SpaceRig::NoiseOf(size_t camera, double stated) const {
  const CameraFit& fit = fits[camera];
  const double typical = std::sqrt(
      std::max(0.0, fit.noise_sigma * fit.noise_sigma - fit.common_noise * fit.common_noise));
  if (!(stated > 0) || !(fit.detector_sigma > 0)) return typical > 0 ? typical : stated;
  // As the adjustment has it: sigmas of the detector that are too small are added to, others
  // scaled.
  if (typical < fit.detector_sigma) return stated * typical / fit.detector_sigma;
  return std::sqrt(stated * stated + typical * typical - fit.detector_sigma * fit.detector_sigma);
}

SpaceRig MakeSpaceRig(const CalibrationRecord& calibration,
                      const std::vector<std::string>& names,
                      const std::vector<size_t>& shared) {
  const std::vector<const CalibratedCamera*> chosen = Chosen(calibration, names);
  std::vector<std::string> chosen_names;
  for (const CalibratedCamera* camera : chosen) chosen_names.push_back(camera->name);
  CalibratedRig calibrated = MakeCalibratedRig(calibration, chosen_names, true);
  SpaceRig rig;
  rig.cameras = std::move(calibrated.cameras);
  Eigen::Index size = 0;
  if (calibrated.prior) {
    ScaleAlike(calibration, chosen_names, &*calibrated.prior);
    rig.unknowns = std::move(calibrated.prior->unknowns);
    size = static_cast<Eigen::Index>(rig.unknowns.size());
  }
  const Eigen::Index of_calibration = size;
  for (size_t c = 0; c < chosen.size(); ++c) {
    const Eigen::Index stated = std::ssize(rig.cameras[c].nuisances);
    rig.first_shared.push_back(size);
    if (!shared.empty())
      size += std::max<Eigen::Index>(0, static_cast<Eigen::Index>(shared[c]) - stated);
    rig.fits.push_back(chosen[c]->fit);
    AddOpen(*chosen[c], &rig.open);
  }
  rig.root = Eigen::MatrixXd::Identity(size, size);
  if (calibrated.prior) {
    rig.root.topLeftCorner(of_calibration, of_calibration) = Inverse(calibrated.prior->weight);
  }
  rig.follow = FollowedMotion(calibration, chosen, rig);
  return rig;
}

}  // namespace plenocal
