// SPDX-License-Identifier: Apache-2.0
#include "calib/adjust/landmarks.h"

#include <algorithm>
#include <cmath>

#include "calib/adjust/rows.h"
#include "calib/base/linear_algebra.h"

namespace plenocal {

LandmarkEquations LineariseLandmark(const Bundle& bundle,
                                    std::span<const size_t> observations,
                                    double width) {
  LandmarkEquations equations;
  for (const size_t i : observations) {
    const BundleObservation& observation = bundle.observations[i];
    const BundleCamera& camera = bundle.cameras[static_cast<size_t>(observation.camera)];
    const auto rows = static_cast<Eigen::Index>(camera.model->measured.size());
    Eigen::Matrix<double, kMaxObservationSize, 1> r;
    Eigen::Matrix<double, kMaxObservationSize, 3, Eigen::RowMajor> J;
    if (!internal::Linearise(
            camera,
            {.T_camera_rig = camera.T_camera_rig,
             .T_rig_target = bundle.T_rig_target[static_cast<size_t>(observation.frame)]},
            bundle.markers[static_cast<size_t>(observation.marker)].position,
            observation,
            {.residual = r.data(), .J_marker = J.data()})) {
      continue;
    }
    const double part = camera.noise.OwnSigma(observation.assumed_sigma) /
                        camera.noise.Sigma(observation.assumed_sigma);
    const double weight = part * part * width / std::max(part * r.head(rows).norm(), width);
    equations.H.noalias() += weight * J.topRows(rows).transpose().lazyProduct(J.topRows(rows));
    equations.g.noalias() += weight * J.topRows(rows).transpose().lazyProduct(r.head(rows));
  }
  return equations;
}

void AdjustLandmark(std::span<const size_t> observations, Bundle* bundle) {
  constexpr int kSteps = 4;
  constexpr double kWidth = 3;
  if (observations.empty()) return;
  Eigen::Vector3d& position =
      bundle->markers[static_cast<size_t>(bundle->observations[observations[0]].marker)].position;
  for (int step = 0; step < kSteps; ++step) {
    const LandmarkEquations equations = LineariseLandmark(*bundle, observations, kWidth);
    const Eigen::Vector3d delta = -SolveSymmetric(equations.H, equations.g);
    if (!delta.allFinite()) return;
    position += delta;
    if (delta.dot(equations.H * delta) < 1) return;
  }
}

std::vector<std::vector<size_t>> ObservationsOfMarkers(const Bundle& bundle) {
  std::vector<std::vector<size_t>> of_marker(bundle.markers.size());
  for (size_t i = 0; i < bundle.observations.size(); ++i) {
    of_marker[static_cast<size_t>(bundle.observations[i].marker)].push_back(i);
  }
  return of_marker;
}

}  // namespace plenocal
