// SPDX-License-Identifier: Apache-2.0
//
// All residuals of a bundle and their derivatives by differences, for comparison with elimination.
#pragma once

#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <cmath>
#include <vector>

#include "calib/adjust/layout.h"
#include "calib/adjust/reduced/elimination.h"

namespace plenocal::testing {

/// Unknowns: those of the layout, the pose of each frame, the jitter of each view, six each.
struct DenseProblem {
  Bundle bundle;
  internal::UnknownLayout layout = internal::MakeLayout(bundle);
  std::vector<int> cameras = {};  ///< per residual; -1: of a prior
  Eigen::VectorXd residuals = {};
  Eigen::MatrixXd J = {}, N = {};

  [[nodiscard]] Eigen::Index Pose(size_t frame) const {
    return layout.total + 6 * static_cast<Eigen::Index>(frame);
  }
  [[nodiscard]] Eigen::Index OfJitter(size_t view) const {
    return Pose(bundle.T_rig_target.size() + view);
  }
  [[nodiscard]] Eigen::Index Size() const { return OfJitter(bundle.jitter.delta.size()); }

  /// All residuals in units of their sigmas after a step: jitter, observations, markers, distances.
  Eigen::VectorXd Residuals(const Eigen::VectorXd& step) {
    Bundle moved = bundle;
    Move(layout, step.head(layout.total), &moved);
    for (size_t f = 0; f < moved.T_rig_target.size(); ++f) {
      moved.T_rig_target[f] = Retract(moved.T_rig_target[f], step.segment<6>(Pose(f)));
    }
    const internal::Objective objective = internal::ObjectiveOf(bundle, {});
    const std::vector<bool> has_data = internal::CamerasWithData(bundle);
    std::vector<double> all;
    for (size_t v = 0; v < moved.jitter.delta.size(); ++v) {
      moved.jitter.delta[v] += step.segment<6>(OfJitter(v));
      const Vector6d weighted = objective.jitter_weights[v] * moved.jitter.delta[v];
      if (has_data[v % has_data.size()]) all.insert(all.end(), weighted.begin(), weighted.end());
    }
    cameras.assign(all.size(), -1);
    for (const BundleObservation& each : moved.observations) {
      if (!each.used) continue;
      double residual[kMaxObservationSize];
      EXPECT_TRUE(Residual(moved, each, residual));
      for (int axis = 0; axis < 2; ++axis) all.push_back(residual[axis] / each.assumed_sigma);
      cameras.resize(all.size(), each.camera);
    }
    for (size_t m = 0; layout.markers && m < moved.markers.size(); ++m) {
      // In the frame of the marker's target: its motion leaves the prior as it is.
      const auto target = static_cast<size_t>(moved.markers[m].target);
      const Eigen::Matrix3d R = moved.targets.empty() ? Eigen::Matrix3d::Identity()
                                                      : moved.targets[target].T_target_own.R;
      const Eigen::Vector3d d = R.transpose() *
                                (moved.markers[m].position - moved.Expected(static_cast<int>(m))) /
                                std::sqrt(moved.marker_freedom.Variance());
      all.insert(all.end(), d.begin(), d.end());
    }
    for (const MarkerDistance& distance : moved.distances) {
      EXPECT_EQ(distance.common_sigma, 0);
      const auto middle = [&](const std::vector<int>& markers) {
        Eigen::Vector3d sum = Eigen::Vector3d::Zero();
        for (const int m : markers) sum += moved.markers[static_cast<size_t>(m)].position;
        return Eigen::Vector3d(sum / static_cast<double>(markers.size()));
      };
      const double length = (middle(distance.markers_a) - middle(distance.markers_b)).norm();
      all.push_back((length - distance.length) / distance.sigma);
    }
    cameras.resize(all.size(), -1);
    return Eigen::Map<Eigen::VectorXd>(all.data(), static_cast<Eigen::Index>(all.size()));
  }

  /// Sets residuals, J and N = J^T J, with ones on the diagonal where nothing is known.
  void Differentiate() {
    residuals = Residuals(Eigen::VectorXd::Zero(Size()));
    J.resize(residuals.size(), Size());
    const Eigen::VectorXd values = Values(layout, bundle);
    for (Eigen::Index k = 0; k < Size(); ++k) {
      const double step = k < values.size() && std::abs(values[k]) > 10 ? 1e-4 : 1e-6;
      const Eigen::VectorXd forward = step * Eigen::VectorXd::Unit(Size(), k);
      J.col(k) = (Residuals(forward) - Residuals(-forward)) / (2 * step);
    }
    N = J.transpose() * J;
    for (Eigen::Index k = 0; k < Size(); ++k) {
      if (N(k, k) == 0) N(k, k) = 1;
    }
  }
};

}  // namespace plenocal::testing
