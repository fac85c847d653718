// SPDX-License-Identifier: Apache-2.0
//
// Indices of the unknowns in the normal equations that are left when poses are eliminated.
#pragma once

#include <Eigen/Core>
#include <vector>

#include "calib/adjust/bundle.h"

namespace plenocal::internal {

/// Index of each unknown in the reduced system: parameters and extrinsics of the cameras and poses
/// of targets first, then three coordinates a marker.
struct UnknownLayout {
  std::vector<std::vector<int>> params;  ///< per camera and parameter; -1 when not estimated
  std::vector<int> extrinsics;           ///< per camera; -1 where not estimated
  std::vector<int> targets;              ///< per target; -1 where its pose is not estimated
  int scales = -1;                       ///< first of the targets' scales; -1 where there are none
  /// Per camera: first of its own parameters and extrinsics, which follow each other; then the
  /// first index after all of them.
  std::vector<int> first = {};
  int head = 0;  ///< number of unknowns before the markers
  int total = 0;
  bool markers = false;

  /// Unknowns of one marker: its position.
  static constexpr int kOfMarker = 3;
  [[nodiscard]] int Marker(int index) const { return head + kOfMarker * index; }
  [[nodiscard]] int Markers() const { return total - head; }
};

/// True where parameters are estimated of a model of which a point depends on few (`support_size`).
bool EstimatesLocalModel(const Bundle& bundle);

/// Per camera: whether it has used observations.
std::vector<bool> CamerasWithData(const Bundle& bundle);

/// The unknowns of cameras with data, and `of_prior` of those in the calibration prior.
UnknownLayout MakeLayout(const Bundle& bundle, bool of_prior = false);

/// Indices, ascending, on which rows of a camera may depend before the markers.
std::vector<int> UnknownsOf(const UnknownLayout& layout, size_t camera);

/// Values of the unknowns before the markers: of parameters, 0 of charts.
Eigen::VectorXd Values(const UnknownLayout& layout, const BundleState& bundle);

/// Bounds of a step of these from their present values, by the parameters' rules.
struct StepBounds {
  Eigen::VectorXd lower, upper;
};
StepBounds BoundsOfStep(const UnknownLayout& layout, const BundleState& bundle);

/// Moves the unknowns of a layout, in the charts about their present values.
void Move(const UnknownLayout& layout, const Eigen::VectorXd& step, BundleState* bundle);

/// True where the parameters of the chosen cameras are in their models' domains.
bool WithinDomain(const BundleState& bundle, const std::vector<bool>& cameras);

/// Sets `BundleCamera::at_bound`, and parameters that lie on a bound but for rounding to it.
void SetAtBounds(Bundle* bundle);

}  // namespace plenocal::internal
