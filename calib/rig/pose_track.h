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

/// Standard deviations of a coordinate and an angle of single logged poses, whose errors are
/// independent, and of a pose between them and its derivatives by time.
struct TrackErrors {
  double single_position = 0, single_angle = 0;  ///< m, rad
  double position = 0, angle = 0;                ///< m, rad
  double velocity = 0, angular_velocity = 0;     ///< m/s, rad/s
  /// Number of frames that share the error of one logged pose: 1 unless frames are closer in time
  /// than the poses that are averaged.
  double frames = 1;
};

class PoseTrack {
 public:
  /// T_base_gripper at times that increase, s; frames are `frame_interval` apart.
  PoseTrack(std::vector<double> times, std::vector<RigidTransform> poses, double frame_interval);

  struct Moving {
    RigidTransform pose;
    Vector6d velocity;  ///< in the pose's chart (`Retract`), m/s and rad/s
    /// Covariance of the errors of both, a coordinate each, m^2/s and rad^2/s.
    Vector6d covariance = Vector6d::Zero();
  };
  /// The pose at a time: the least-squares cubic through the poses around it, or the line through
  /// two, whichever predicts logged poses best from others. So their errors are averaged, over no
  /// longer than frames are apart (but for the cubic through four). Nothing before the first, after
  /// the last and in gaps of more than three usual intervals.
  [[nodiscard]] std::optional<Moving> At(double time) const;
  [[nodiscard]] const TrackErrors& Errors() const { return errors_; }

 private:
  // Poses that a polynomial goes through: so many next to its time, or all nearer than `reach`,
  // which is in usual intervals.
  struct Window {
    int degree = 1;
    size_t poses = 2;
    double reach = 0;
    [[nodiscard]] double Length() const {
      return reach > 0 ? 2 * reach : static_cast<double>(poses - 1);
    }
  };
  struct Neighbours;
  [[nodiscard]] Neighbours Around(double time, const Window& window, bool without_nearest) const;
  [[nodiscard]] Moving PoseOf(const Neighbours& neighbours) const;
  // Chooses `window_` and sets `errors_` but for `frames`.
  void Choose(double longest);

  std::vector<double> times_;
  std::vector<RigidTransform> poses_;
  std::vector<size_t> first_, end_;  // per pose: of the run without gaps in which it is
  double interval_ = 0;              // s, usual
  Window window_;
  TrackErrors errors_;
};

/// A pose of the calibration with the time of its image.
struct TimedFrame {
  double time = 0;  ///< s
  RigidTransform T_rig_target;
  PoseErrors errors = {};
};

struct TrackMatch {
  std::vector<OutsidePose> poses;
  std::vector<size_t> frames;  ///< parallel: indices into the frames
};

/// The frames that have a pose at their time plus `shift`.
TrackMatch MatchTrack(const PoseTrack& track, std::span<const TimedFrame> frames, double shift);

/// The time to add to those of the images, s, for the poses to fit best: within a second
/// by their scatter, from there (or from 0, where no shift explains clearly more) by
/// `FitOutsidePoses` with the shift as one of its unknowns, which `options` gets.
double FindTrackShift(const PoseTrack& track,
                      std::span<const TimedFrame> frames,
                      OutsideOptions* options);

}  // namespace plenocal
