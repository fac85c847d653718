// SPDX-License-Identifier: Apache-2.0
//
// Poses from outside by time, as a robot or motion capture logs them, and the shift of its clock.
#pragma once

#include <cstddef>
#include <optional>
#include <span>
#include <vector>

#include "calib/rig/outside_poses.h"

namespace plenocal {

class PoseTrack {
 public:
  /// T_base_gripper at times that increase, s.
  PoseTrack(std::vector<double> times, std::vector<RigidTransform> poses);

  /// The pose at a time, between two poses by constant velocities. Nothing before the first, after
  /// the last and in gaps of more than three usual intervals.
  [[nodiscard]] std::optional<RigidTransform> At(double time) const;

 private:
  std::vector<double> times_;
  std::vector<RigidTransform> poses_;
  double longest_gap_ = 0;  // s
};

/// A pose of the calibration with the time of its image.
struct TimedFrame {
  double time = 0;  ///< s
  RigidTransform T_rig_target;
};

struct TrackMatch {
  std::vector<OutsidePose> poses;
  std::vector<size_t> frames;  ///< parallel: indices into the frames
};

/// The frames that have a pose at their time plus `shift`.
TrackMatch MatchTrack(const PoseTrack& track, std::span<const TimedFrame> frames, double shift);

/// What has to be added to the times of the images, s.
struct TrackShift {
  double value = 0, sigma = 0;
};

/// The shift within a second at which the poses fit best (maximum likelihood of their scatter).
/// Nothing where it explains no more than no shift does (likelihood ratio, level 1e-4), as where
/// the rig was at rest in all frames.
std::optional<TrackShift> FindTrackShift(const PoseTrack& track,
                                         std::span<const TimedFrame> frames,
                                         const OutsideOptions& options);

}  // namespace plenocal
