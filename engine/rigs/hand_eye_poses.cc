// SPDX-License-Identifier: Apache-2.0
#include "engine/rigs/hand_eye_poses.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <numbers>
#include <string_view>

#include "assess/views/pose_errors.h"
#include "calib/base/format_error.h"
#include "calib/base/number_text.h"
#include "calib/base/statistics.h"
#include "calib/files/calibration_tables.h"
#include "calib/io/csv.h"
#include "calib/io/input_file.h"
#include "calib/io/output_folder.h"
#include "calib/rig/pose_track.h"
#include "calib/rig/trajectory.h"
#include "engine/recording/frames/session_times.h"
#include "engine/recording/frames/times.h"
#include "engine/session/calibration_folder.h"

namespace plenocal {
namespace {

// Poses from outside with the frames of a calibration that have one.
struct MatchedPoses {
  std::vector<std::string> frames;
  std::vector<OutsidePose> poses;
  size_t without = 0;           // frames of the calibration
  std::optional<double> shift;  // of poses by time, s
  OutsideOptions options;
};

// Poses of a calibration.
struct CalibratedPoses {
  std::filesystem::path table;
  std::vector<std::string> frames;
  std::vector<OutsidePose> poses;  // but for that from outside
  size_t without = 0;              // frames whose points do not determine their pose
  std::string without_errors;      // why errors are left out; empty: they are not
};

OutsideOptions OptionsOf(const HandEyeRequest& request) {
  return {.mount = request.mount, .scale = request.scale};
}

// True if a file of poses names frames; else it has times.
bool NamesFrames(const std::filesystem::path& path) {
  constexpr size_t kStart = 4096;
  const std::string start = ReadInputStart(path, kStart);
  const std::string_view first = FirstRow(start, 0);
  return first.find("frame") != std::string_view::npos;
}

// The time of a frame whose name is one, in seconds or nanoseconds.
double TimeOfName(const std::string& frame, const std::filesystem::path& table) {
  constexpr double kNanosecondsAbove = 1e11, kNanosecond = 1e-9;
  const std::optional<double> number = ParseDouble(frame);
  if (!number || !std::isfinite(*number)) {
    throw InputError(
        "{}: frame '{}' is no time, and the poses from outside have times; "
        "give those of the frames by --times",
        table.string(),
        frame);
  }
  return *number > kNanosecondsAbove ? kNanosecond * *number : *number;
}

MatchedPoses MatchByTime(const HandEyeRequest& request, const CalibratedPoses& calibrated) {
  const Trajectory outside = ReadTrajectory(request.poses, {});
  const std::vector<std::string>& names = calibrated.frames;
  std::map<std::string, double> times;
  if (!request.times.empty()) times = TimesOfFrames(request.times, "the calibration", names);
  std::vector<TimedFrame> frames;
  for (size_t i = 0; i < names.size(); ++i) {
    const double time = times.empty() ? TimeOfName(names[i], calibrated.table) : times.at(names[i]);
    frames.push_back({time, calibrated.poses[i].T_rig_target, calibrated.poses[i].errors});
  }
  std::vector<RigidTransform> poses;
  for (size_t i = 0; i < outside.Size(); ++i) {
    poses.push_back({outside.orientations[i].toRotationMatrix(), outside.positions[i]});
  }
  std::vector<double> intervals;
  for (size_t i = 1; i < frames.size(); ++i)
    intervals.push_back(frames[i].time - frames[i - 1].time);
  const PoseTrack track(outside.times, poses, Median(std::move(intervals)));
  MatchedPoses matched;
  matched.options = OptionsOf(request);
  matched.options.instants_per_error = track.Errors().frames;
  matched.shift = FindTrackShift(track, frames, &matched.options);
  const TrackMatch match = MatchTrack(track, frames, *matched.shift);
  matched.poses = match.poses;
  for (const size_t frame : match.frames) matched.frames.push_back(names[frame]);
  matched.without = names.size() - match.frames.size();
  constexpr size_t kFewest = 3;
  if (matched.poses.size() >= kFewest || frames.empty()) return matched;
  throw InputError(
      "{}: {} of the {} frames of {} lie in its times, {:.3f} to {:.3f} s; the "
      "first frame is at {:.3f} s",
      request.poses.string(),
      matched.poses.size(),
      frames.size(),
      calibrated.table.string(),
      outside.times.front(),
      outside.times.back(),
      frames[0].time);
}

MatchedPoses MatchByName(const HandEyeRequest& request, const CalibratedPoses& calibrated) {
  if (!request.times.empty()) {
    throw InputError("--times: the poses from outside name frames and need no times");
  }
  const std::vector<FrameRecord> outside = ReadPoses(request.poses);
  const std::vector<std::string>& names = calibrated.frames;
  MatchedPoses matched;
  matched.options = OptionsOf(request);
  for (size_t i = 0; i < names.size(); ++i) {
    const auto found = std::ranges::find(outside, names[i], &FrameRecord::name);
    if (found == outside.end()) {
      ++matched.without;
      continue;
    }
    matched.frames.push_back(names[i]);
    matched.poses.push_back(calibrated.poses[i]);
    matched.poses.back().T_base_gripper = found->T_target_rig;
  }
  constexpr size_t kFewest = 3;
  if (matched.poses.size() >= kFewest) return matched;
  throw InputError(
      "{}: {} of its {} poses have a frame of {} ('{}', ...; there '{}', ...); "
      "the column 'frame' must have the names of the images",
      request.poses.string(),
      matched.poses.size(),
      outside.size(),
      calibrated.table.string(),
      outside.empty() ? "" : outside[0].name,
      names.empty() ? "" : names[0]);
}

CalibratedPoses ReadCalibratedPoses(const std::filesystem::path& folder) {
  CalibratedPoses calibrated;
  calibrated.table = folder / "poses.csv";
  std::map<std::string, PoseErrors> errors;
  try {
    const CalibrationRecord calibration = OpenCalibrationFolder(folder);
    for (auto& [frame, of_frame] : ComputePoseErrors(calibration)) {
      errors[calibration.frames[static_cast<size_t>(frame)].name] = std::move(of_frame);
    }
  } catch (const Error& error) {
    calibrated.without_errors = error.what();
  }
  for (const FrameRecord& frame : ReadPoses(calibrated.table)) {
    const auto found = errors.find(frame.name);
    if (found == errors.end() && calibrated.without_errors.empty()) {
      ++calibrated.without;
      continue;
    }
    calibrated.frames.push_back(frame.name);
    calibrated.poses.push_back(
        {.T_base_gripper = {},
         .T_rig_target = frame.T_target_rig.Inverse(),
         .errors = found == errors.end() ? PoseErrors{} : std::move(found->second)});
  }
  return calibrated;
}

// Throws where lengths differ as units do.
void CheckUnits(const MatchedPoses& matched, const std::filesystem::path& file) {
  constexpr double kApart = 30;
  const double ratio = RatioOfLengths(matched.poses);
  if (ratio < kApart && ratio > 1 / kApart) return;
  throw InputError(
      "{}: its positions move {:.3g} times as far as those of the calibration; "
      "are they in {}? Give them in metres",
      file.string(),
      ratio,
      ratio > 1 ? "millimetres" : "another unit");
}

RigMount Other(RigMount mount) {
  return mount == RigMount::kOnGripper ? RigMount::kOnBase : RigMount::kOnGripper;
}

// Scatter as the way a point moves at the distance of the target.
double Misfit(const OutsideFit& fit, const MatchedPoses& matched) {
  double distance = 0;
  for (const OutsidePose& pose : matched.poses) {
    distance += pose.T_rig_target.t.norm() / static_cast<double>(matched.poses.size());
  }
  const auto left_out = static_cast<double>(std::ranges::count(fit.used, false)) /
                        static_cast<double>(fit.used.size());
  return (fit.translation_sigma + distance * fit.rotation_sigma) / std::max(0.1, 1 - left_out);
}

OutsideFit Fit(const HandEyeRequest& request, const MatchedPoses& matched) {
  const RigMount mount = request.mount;
  OutsideOptions options = matched.options;
  const auto fit = FitOutsidePoses(matched.poses, options);
  options.mount = Other(mount);
  const auto other = FitOutsidePoses(matched.poses, options);
  // The other reading of a true pose leaves errors as large as the motion.
  constexpr double kClearly = 5;
  if (other && (!fit || Misfit(*fit, matched) > kClearly * Misfit(*other, matched))) {
    throw JobError(
        "{}: the poses fit the other way round only (to {:.2g} mm, {:.2g} degrees). "
        "Either they map the base to the gripper, and must be inverted, or the rig is "
        "mounted on the {}: --mount {}",
        request.poses.string(),
        1e3 * other->translation_sigma,
        other->rotation_sigma * 180 / std::numbers::pi,
        mount == RigMount::kOnGripper ? "base" : "gripper",
        mount == RigMount::kOnGripper ? "base" : "gripper");
  }
  if (!fit) {
    throw JobError("{}: no mount explains these motions; are the poses those of the frames?",
                   request.poses.string());
  }
  return *fit;
}

}  // namespace

MountedRig FindHandEye(const HandEyeRequest& request, const Run& run) {
  const RunScope inputs;
  CalibratedPoses calibrated = ReadCalibratedPoses(request.folder);
  MatchedPoses matched = NamesFrames(request.poses) ? MatchByName(request, calibrated)
                                                    : MatchByTime(request, calibrated);
  CheckUnits(matched, request.poses);
  if (!run.Progress("hand-eye pose")) throw Stopped();
  MountedRig result{.mount = request.mount,
                    .scale = request.scale,
                    .fit = Fit(request, matched),
                    .frames = std::move(matched.frames),
                    .time_shift = matched.shift,
                    .without = calibrated.without + matched.without,
                    .without_errors = std::move(calibrated.without_errors)};
  if (!request.out.empty()) WriteOutput(request.out, HandEyeYaml(result));
  return result;
}

}  // namespace plenocal
