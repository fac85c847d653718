// SPDX-License-Identifier: Apache-2.0
#include "calib/space/space_rig.h"

#include <Eigen/QR>
#include <algorithm>
#include <cmath>
#include <map>
#include <utility>

#include "calib/base/linear_algebra.h"
#include "calib/base/statistics.h"
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

// Of the first of the chosen cameras.
Eigen::Vector3d MarkerInMaster(const CalibrationRecord& calibration,
                               const CalibratedCamera& master,
                               int frame,
                               int marker) {
  const RigidTransform& T_target_rig = calibration.frames[static_cast<size_t>(frame)].T_target_rig;
  return master.T_camera_rig * (T_target_rig.Inverse() * calibration.markers.at(marker).position);
}

// K of docs/space.md, 6 x theta.
Eigen::MatrixXd FollowedMotion(const CalibrationRecord& calibration,
                               const std::vector<const CalibratedCamera*>& chosen,
                               const SpaceRig& rig) {
  Matrix6d normal = Matrix6d::Zero();
  Eigen::MatrixXd mixed = Eigen::MatrixXd::Zero(6, rig.Size());
  for (size_t c = 0; c < chosen.size(); ++c) {
    for (const ResidualRow& row : chosen[c]->residuals) {
      if (!row.used || !calibration.markers.contains(row.marker)) continue;
      const Eigen::Vector3d X = MarkerInMaster(calibration, *chosen[0], row.frame, row.marker);
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

// By the rays of the calibration's own points: residuals less what a free point absorbs, over their
// noise. 1 where they do not differ from it significantly.
double NoiseFactor(const CalibrationRecord& calibration,
                   const std::vector<const CalibratedCamera*>& chosen,
                   const SpaceRig& rig) {
  constexpr double kFalseAlarms = 1e-3;
  constexpr size_t kMostPoints = 500;  // known to 3 %
  std::map<std::pair<int, int>, std::vector<std::pair<size_t, const ResidualRow*>>> seen;
  for (size_t c = 0; c < chosen.size(); ++c) {
    if (chosen[c]->model->plenoptic) return 1;
    for (const ResidualRow& row : chosen[c]->residuals) {
      const bool is_known = calibration.markers.contains(row.marker) && row.Error().allFinite();
      if (row.used && is_known) seen[{row.frame, row.marker}].emplace_back(c, &row);
    }
  }
  std::erase_if(seen, [](const auto& point) { return point.second.size() < 2; });
  const size_t step = seen.size() / kMostPoints + 1;
  double sum = 0, degrees = 0;
  size_t index = 0;
  for (const auto& [point, rows] : seen) {
    if (index++ % step != 0) continue;
    const Eigen::Vector3d X = MarkerInMaster(calibration, *chosen[0], point.first, point.second);
    const Eigen::Index n = 2 * std::ssize(rows);
    Eigen::MatrixXd J(n, 3);
    Eigen::VectorXd r(n);
    Eigen::Index at = 0;
    for (const auto& [c, row] : rows) {
      PointDerivative derivative;
      const double sigma = row->noise_sigma > 0 ? row->noise_sigma : rig.NoiseOf(c, 0);
      const SpaceObservation place{.camera = c, .values = row->values};
      if (!(sigma > 0) || !Differentiate(rig, place, X, 1, &derivative, false)) break;
      J.middleRows<2>(at) = derivative.by_point / sigma;
      r.segment<2>(at) = row->Error() / sigma;
      at += 2;
    }
    if (at < n) continue;
    const Eigen::VectorXd free = J.householderQr().householderQ().transpose() * r;
    sum += free.tail(n - 3).squaredNorm();
    degrees += static_cast<double>(n - 3);
  }
  degrees -= static_cast<double>(rig.unknowns.size()) / static_cast<double>(step);
  if (!(sum > 0) || !(degrees > 1)) return 1;
  const double larger = ChiSquareTail(degrees, sum);
  const bool differs = std::min(larger, 1 - larger) < kFalseAlarms / 2;
  return differs ? std::sqrt(sum / degrees) : 1;
}

void AddOpen(const CalibratedCamera& camera, std::vector<std::string>* open) {
  for (size_t k = 0; k < camera.params.size(); ++k) {
    if (!std::isinf(camera.Sigma(k))) continue;
    open->push_back(camera.name + "." + std::string(camera.model->params[k].name));
  }
  if (!camera.sigma_xi.allFinite()) open->push_back(camera.name + ".T_camera_rig");
}

// Adds independent numbers with these standard errors to those with L L'.
void AppendErrors(const Eigen::VectorXd& sigmas, Eigen::MatrixXd* root) {
  if (sigmas.size() == 0) return;
  const Eigen::Index before = root->rows(), size = before + sigmas.size();
  root->conservativeResizeLike(Eigen::MatrixXd::Zero(size, size));
  root->diagonal().tail(sigmas.size()) = sigmas;
}

}  // namespace

double SpaceRig::NoiseOf(size_t camera, double stated) const {
  const CameraFit& fit = fits[camera];
  const double typical = std::sqrt(
      std::max(0.0, fit.noise_sigma * fit.noise_sigma - fit.common_noise * fit.common_noise));
  if (!(stated > 0) || !(fit.detector_sigma > 0)) {
    return noise_factor * (typical > 0 ? typical : stated);
  }
  // As the adjustment has it: sigmas of the detector that are too small are added to, others
  // scaled.
  if (typical < fit.detector_sigma) return noise_factor * stated * typical / fit.detector_sigma;
  return noise_factor *
         std::sqrt(stated * stated + typical * typical - fit.detector_sigma * fit.detector_sigma);
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
  if (calibrated.prior) {
    ScaleAlike(calibration, chosen_names, &*calibrated.prior);
    rig.unknowns = std::move(calibrated.prior->unknowns);
    rig.root = Inverse(calibrated.prior->weight);
    rig.has_errors = true;
  }
  for (size_t c = 0; c < chosen.size(); ++c) {
    BundleCamera& camera = rig.cameras[c];
    while (!shared.empty() && camera.nuisances.size() < shared[c]) {
      rig.unknowns.push_back({.camera = c, .param = camera.params.size(), .value = 0});
      camera.params.push_back(0);
      camera.fixed.push_back(false);
      camera.nuisances.push_back(&nuisances::kSharedError);
    }
    rig.fits.push_back(chosen[c]->fit);
    AddOpen(*chosen[c], &rig.open);
  }
  const Eigen::Index stated = rig.root.rows(), unknowns = std::ssize(rig.unknowns);
  AppendErrors(Eigen::VectorXd::Ones(unknowns - stated), &rig.root);
  rig.follow = FollowedMotion(calibration, chosen, rig);
  if (!calibration.jitter) rig.noise_factor = NoiseFactor(calibration, chosen, rig);
  if (!calibration.jitter || chosen.size() < 2) return rig;
  Eigen::Vector<double, 6> sigmas;
  sigmas << Eigen::Vector3d::Constant(calibration.jitter->translation_sigma),
      Eigen::Vector3d::Constant(calibration.jitter->rotation_sigma);
  AppendErrors(sigmas.replicate(std::ssize(chosen), 1), &rig.root);
  rig.frame_columns = rig.Size() - unknowns;
  // The calibration's points have their own jitter.
  if (rig.follow.size() > 0)
    rig.follow.conservativeResizeLike(Eigen::MatrixXd::Zero(6, rig.Size()));
  return rig;
}

std::string NameOfUnknown(const SpaceRig& rig, size_t unknown) {
  const CalibrationPrior::Unknown& of = rig.unknowns[unknown];
  const BundleCamera& camera = rig.cameras[of.camera];
  const size_t params = camera.model->params.size();
  if (of.param >= params) return camera.name + ".shared_" + std::to_string(*of.param - params + 1);
  Bundle bundle;
  bundle.cameras = rig.cameras;
  bundle.prior.emplace().unknowns = rig.unknowns;
  return NameOfPriorUnknown(bundle, unknown);
}

void AddToTheta(const SpaceRig& rig,
                const Eigen::VectorXd& theta,
                std::vector<BundleCamera>* cameras) {
  std::vector<Vector6d> charts(cameras->size(), Vector6d::Zero());
  for (size_t i = 0; i < rig.unknowns.size(); ++i) {
    const CalibrationPrior::Unknown& unknown = rig.unknowns[i];
    const double error = theta[static_cast<Eigen::Index>(i)];
    if (unknown.param) {
      (*cameras)[unknown.camera].params[*unknown.param] += error;
    } else {
      charts[unknown.camera][unknown.component] = error;
    }
  }
  for (size_t c = 0; c < cameras->size(); ++c) {
    (*cameras)[c].T_camera_rig = Retract((*cameras)[c].T_camera_rig, charts[c]);
  }
}

}  // namespace plenocal
