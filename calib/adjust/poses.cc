// SPDX-License-Identifier: Apache-2.0
#include "calib/adjust/poses.h"

#include <algorithm>
#include <cmath>
#include <optional>

#include "calib/adjust/linearise.h"
#include "calib/base/linear_algebra.h"

namespace plenocal {
namespace {

constexpr double kNoLoss = 1e300;  // width of Huber's loss

// Normal equations H delta = -g of a target pose, from observations in [begin, end). `width` is
// that of Huber's loss.
struct PoseEquations {
  Matrix6d H = Matrix6d::Zero();
  Vector6d g = Vector6d::Zero();
};

PoseEquations LinearisePose(const Bundle& bundle, size_t begin, size_t end, double width) {
  PoseEquations equations;
  using J6 = Eigen::Matrix<double, kMaxObservationSize, 6, Eigen::RowMajor>;
  using Residual = Eigen::Matrix<double, kMaxObservationSize, 1>;
  const auto add = [&](double weight, Eigen::Index rows, const J6& J, const Residual& r) {
    for (Eigen::Index row = 0; row < rows; ++row) {
      const Vector6d by_pose = J.row(row);
      equations.H.noalias() += weight * by_pose * by_pose.transpose();
      equations.g += (weight * r[row]) * by_pose;
    }
  };
  internal::LinearisedView view;
  J6 J, J_sum;  // in own sigmas
  Residual r, r_sum;
  for (size_t i = begin, of_marker = begin, end_of_view = begin; i < end;) {
    const BundleCamera& camera = bundle.cameras[static_cast<size_t>(bundle.observations[i].camera)];
    const auto rows = static_cast<Eigen::Index>(camera.model->measured.size());
    if (end_of_view <= i) {
      end_of_view = EndOfView(bundle.observations, i);
      view = internal::ViewOf(bundle,
                              static_cast<size_t>(bundle.observations[i].frame),
                              static_cast<size_t>(bundle.observations[i].camera));
    }
    const bool has_common = camera.noise.common_sigma > 0;
    if (has_common) {
      J_sum.setZero();
      r_sum.setZero();
    }
    double information = 0;
    for (of_marker = EndOfMarker(bundle.observations, i); i < of_marker; ++i) {
      const BundleObservation& observation = bundle.observations[i];
      if (!observation.used) continue;
      if (!internal::Linearise(camera,
                               camera.params.data(),
                               view,
                               bundle.markers[static_cast<size_t>(observation.marker)].position,
                               observation,
                               {.residual = r.data(), .J_pose = J.data()})) {
        continue;
      }
      const double own = camera.noise.OwnSigma(observation.assumed_sigma);
      const double length =
          r.head(rows).norm() * own / camera.noise.Sigma(observation.assumed_sigma);
      const double weight = width / std::max(length, width);
      add(weight, rows, J, r);
      if (!has_common) continue;
      J_sum.topRows(rows) += J.topRows(rows) * (weight / own);
      r_sum.head(rows) += r.head(rows) * (weight / own);
      information += weight / (own * own);
    }
    if (has_common) {
      add(-internal::CommonShare(camera.noise.common_sigma, information), rows, J_sum, r_sum);
    }
  }
  return equations;
}

}  // namespace

void AdjustPose(size_t begin, size_t end, Bundle* bundle) {
  constexpr int kSteps = 4;
  constexpr double kWidth = 3;  // of Huber's loss, sigmas
  RigidTransform& T_rig_target =
      bundle->T_rig_target[static_cast<size_t>(bundle->observations[begin].frame)];
  for (int step = 0; step < kSteps; ++step) {
    const PoseEquations equations = LinearisePose(*bundle, begin, end, kWidth);
    const Vector6d delta = -SolveSymmetric(equations.H, equations.g);
    if (!delta.allFinite()) break;
    T_rig_target = Retract(T_rig_target, delta);
    if (delta.dot(equations.H * delta) < 1) break;  // less than a sigma; the adjustment goes on
  }
}

void AdjustPoses(Bundle* bundle, const std::vector<bool>& frames) {
  const auto& observations = bundle->observations;
  for (size_t begin = 0, end = 0; begin < observations.size(); begin = end) {
    const auto frame = static_cast<size_t>(observations[begin].frame);
    while (end < observations.size() && observations[end].frame == observations[begin].frame) ++end;
    if (frames[frame]) AdjustPose(begin, end, bundle);
  }
}

Matrix6d PoseInformation(const Bundle& bundle, size_t begin, size_t end) {
  return LinearisePose(bundle, begin, end, kNoLoss).H;
}

std::vector<PoseStep> OwnPoseSteps(const Bundle& bundle) {
  std::vector<PoseStep> steps;
  const auto& observations = bundle.observations;
  for (size_t begin = 0, end = 0; begin < observations.size(); begin = end) {
    const BundleObservation& first = observations[begin];
    end = EndOfView(observations, begin);
    const PoseEquations equations = LinearisePose(bundle, begin, end, kNoLoss);
    const std::optional<Vector6d> step = SolvePositive(equations.H, equations.g);
    if (!step) continue;
    const Vector6d delta = -*step;
    steps.push_back({first.frame, first.camera, delta, -delta.dot(equations.g)});
  }
  return steps;
}

}  // namespace plenocal
