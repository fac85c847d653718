// SPDX-License-Identifier: Apache-2.0
//
// The unknowns of a bundle as blocks of numbers for the solver.
#pragma once

#include <deque>
#include <limits>
#include <utility>
#include <vector>

#include "calib/adjust/bundle.h"

namespace plenocal::internal {

/// Markers of a target are estimated in blocks: fewer, larger blocks cost Ceres less bookkeeping.
/// Landmarks, which few frames have in common, are estimated one by one.
inline int MarkersPerBlock(const Bundle& bundle) { return bundle.HasLandmarks() ? 1 : 4; }

/// A pose in the chart around its value before the solve.
struct ChartedPose {
  RigidTransform origin;
  double* delta = nullptr;  ///< its six unknowns

  [[nodiscard]] RigidTransform Value() const {
    return Retract(origin, Eigen::Map<const Vector6d>(delta));
  }
};

/// `ParamPrior` of the slots of a block.
struct SlotPrior {
  std::vector<std::pair<size_t, double>> terms;  ///< slot, weight
  double value = 0, sigma = 0;
};

/// The parameters of one camera, or of several that have some in common: each value once.
struct IntrinsicsBlock {
  std::vector<double> initial;  ///< before the solve
  std::vector<bool> fixed;
  std::vector<double> lower, upper;  ///< from the parameters' rules
  std::vector<SlotPrior> priors;
  double* values = nullptr;  ///< among the unknowns

  [[nodiscard]] size_t Size() const { return initial.size(); }
};

/// Slot of a parameter that is fixed and not in the block.
inline constexpr size_t kNoSlot = std::numeric_limits<size_t>::max();

/// One camera's parameters in their block.
struct Intrinsics {
  IntrinsicsBlock* block = nullptr;
  /// Per parameter; empty when the block is the camera's alone, in order.
  std::vector<size_t> slots;

  [[nodiscard]] size_t Slot(size_t param) const { return slots.empty() ? param : slots[param]; }
};

/// All unknowns in one array: Ceres orders the blocks of a group by their addresses, and the same
/// input must give the same order.
class Unknowns {
 public:
  explicit Unknowns(const Bundle& bundle);
  Unknowns(const Unknowns&) = delete;
  Unknowns& operator=(const Unknowns&) = delete;

  /// Sets the bundle to these values.
  void WriteTo(Bundle* bundle) const;

  [[nodiscard]] size_t MarkerBlocks() const { return nominal_markers.size() / marker_block_size; }
  [[nodiscard]] double* Jitter(size_t view) { return jitter + 6 * view; }
  [[nodiscard]] double* MarkerBlock(size_t block) { return markers + block * marker_block_size; }

  std::vector<double> values;
  std::vector<Intrinsics> intrinsics;   ///< per camera
  std::vector<ChartedPose> extrinsics;  ///< per camera
  std::vector<ChartedPose> poses;       ///< per frame
  std::vector<ChartedPose> targets;     ///< per target
  double* jitter = nullptr;
  size_t marker_block_size = 3;
  /// Markers of targets with a pose of their own are where they were before the solve: the change
  /// of the pose moves them. The last block may have spare markers.
  double* markers = nullptr;
  std::vector<double> nominal_markers;  ///< parallel to `markers`

 private:
  std::deque<IntrinsicsBlock> blocks_;
};

}  // namespace plenocal::internal
