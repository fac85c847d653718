// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <map>
#include <memory>
#include <numbers>
#include <optional>
#include <string_view>

#include "apps/cli/command.h"
#include "apps/cli/options.h"
#include "apps/cli/program.h"
#include "apps/evaluate/trajectory.h"
#include "assess/views/pose_errors.h"
#include "calib/base/error.h"
#include "calib/base/names.h"
#include "calib/base/number_text.h"
#include "calib/base/statistics.h"
#include "calib/files/calibration_file.h"
#include "calib/files/calibration_tables.h"
#include "calib/io/input_file.h"
#include "calib/io/output_folder.h"
#include "calib/noise/open_directions.h"
#include "calib/rig/outside_poses.h"
#include "calib/rig/pose_track.h"
#include "engine/recording/frames/session_times.h"
#include "engine/recording/times.h"
#include "engine/session/calibration_folder.h"
#include "models/registry.h"

namespace plenocal {
namespace {

struct HandEyeArguments {
  std::filesystem::path folder;  ///< of a calibration
  std::filesystem::path poses;   ///< from outside
  std::filesystem::path times;   ///< of the frames, for poses by time; empty: their names
  std::string mount = "gripper";
  bool free_scale = false;
  std::filesystem::path out;  ///< handeye.yaml
};

// Poses from outside with the frames of a calibration that have one.
struct MatchedPoses {
  std::vector<std::string> frames;
  std::vector<OutsidePose> poses;
  size_t without = 0;           // frames of the calibration
  std::optional<double> shift;  // of poses by time
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

RigMount MountOf(const HandEyeArguments& arguments) {
  return arguments.mount == "gripper" ? RigMount::kOnGripper : RigMount::kOnBase;
}

OutsideScale ScaleOf(const HandEyeArguments& arguments) {
  return arguments.free_scale ? OutsideScale::kFree : OutsideScale::kHeld;
}

OutsideOptions OptionsOf(const HandEyeArguments& arguments) {
  return {.mount = MountOf(arguments), .scale = ScaleOf(arguments)};
}

// Whether a file of poses names frames; else it has times.
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
    throw Error(ErrorKind::kInput,
                fmt::format("{}: frame '{}' is no time, and the poses from outside have times; "
                            "give those of the frames by --times",
                            table.string(),
                            frame));
  }
  return *number > kNanosecondsAbove ? kNanosecond * *number : *number;
}

MatchedPoses MatchByTime(const HandEyeArguments& arguments, const CalibratedPoses& calibrated) {
  const Trajectory outside = ReadTrajectory(arguments.poses, {});
  const std::vector<std::string>& names = calibrated.frames;
  std::map<std::string, double> times;
  if (!arguments.times.empty()) times = TimesOfFrames(arguments.times, "the calibration", names);
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
  matched.options = OptionsOf(arguments);
  matched.options.instants_per_error = track.Errors().frames;
  matched.shift = FindTrackShift(track, frames, &matched.options);
  const TrackMatch match = MatchTrack(track, frames, *matched.shift);
  matched.poses = match.poses;
  for (const size_t frame : match.frames) matched.frames.push_back(names[frame]);
  matched.without = names.size() - match.frames.size();
  constexpr size_t kFewest = 3;
  if (matched.poses.size() >= kFewest || frames.empty()) return matched;
  throw Error(ErrorKind::kInput,
              fmt::format("{}: {} of the {} frames of {} lie in its times, {:.3f} to {:.3f} s; the "
                          "first frame is at {:.3f} s",
                          arguments.poses.string(),
                          matched.poses.size(),
                          frames.size(),
                          calibrated.table.string(),
                          outside.times.front(),
                          outside.times.back(),
                          frames[0].time));
}

MatchedPoses MatchByName(const HandEyeArguments& arguments, const CalibratedPoses& calibrated) {
  if (!arguments.times.empty()) {
    throw Error(ErrorKind::kInput, "--times: the poses from outside name frames and need no times");
  }
  const std::vector<FrameRecord> outside = ReadPoses(arguments.poses);
  const std::vector<std::string>& names = calibrated.frames;
  MatchedPoses matched;
  matched.options = OptionsOf(arguments);
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
  throw Error(ErrorKind::kInput,
              fmt::format("{}: {} of its {} poses have a frame of {} ('{}', ...; there '{}', ...); "
                          "the column 'frame' must have the names of the images",
                          arguments.poses.string(),
                          matched.poses.size(),
                          outside.size(),
                          calibrated.table.string(),
                          outside.empty() ? "" : outside[0].name,
                          names.empty() ? "" : names[0]));
}

CalibratedPoses ReadCalibratedPoses(const std::filesystem::path& folder) {
  CalibratedPoses calibrated;
  calibrated.table = folder / "poses.csv";
  std::map<std::string, PoseErrors> errors;
  try {
    const CalibrationRecord calibration = ReadCalibrationFolder(folder, CameraModels());
    for (auto& [frame, of_frame] : ErrorsOfPoses(calibration)) {
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
  throw Error(ErrorKind::kInput,
              fmt::format("{}: its positions move {:.3g} times as far as those of the calibration; "
                          "are they in {}? Give them in metres",
                          file.string(),
                          ratio,
                          ratio > 1 ? "millimetres" : "another unit"));
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

OutsideFit Fit(const HandEyeArguments& arguments, const MatchedPoses& matched) {
  const RigMount mount = MountOf(arguments);
  OutsideOptions options = matched.options;
  const auto fit = FitOutsidePoses(matched.poses, options);
  options.mount = Other(mount);
  const auto other = FitOutsidePoses(matched.poses, options);
  // The other reading of a true pose leaves errors as large as the motion.
  constexpr double kClearly = 5;
  if (other && (!fit || Misfit(*fit, matched) > kClearly * Misfit(*other, matched))) {
    throw Error(
        ErrorKind::kJob,
        fmt::format("{}: the poses fit the other way round only (to {:.2g} mm, {:.2g} degrees). "
                    "Either they map the base to the gripper, and must be inverted, or the rig is "
                    "mounted on the {}: --mount {}",
                    arguments.poses.string(),
                    1e3 * other->translation_sigma,
                    other->rotation_sigma * 180 / std::numbers::pi,
                    mount == RigMount::kOnGripper ? "base" : "gripper",
                    mount == RigMount::kOnGripper ? "base" : "gripper"));
  }
  if (!fit) {
    throw Error(ErrorKind::kJob,
                arguments.poses.string() +
                    ": no mount explains these motions; are the poses those of the frames?");
  }
  return *fit;
}

std::string PoseYaml(const std::string& name, const RigidTransform& T, const Vector6d& sigma) {
  std::string text = fmt::format("T_{}: [", name);
  for (int r = 0; r < 3; ++r) {
    text += fmt::format(
        "[{:.12g}, {:.12g}, {:.12g}, {:.12g}], ", T.R(r, 0), T.R(r, 1), T.R(r, 2), T.t[r]);
  }
  std::vector<std::string> sigmas;
  for (const double value : sigma) sigmas.push_back(YamlNumber(value));
  return text + fmt::format("[0, 0, 0, 1]]\nsigma_{}: [{}]\n", name, fmt::join(sigmas, ", "));
}

// Names of both poses in the file, that of the rig first.
std::array<std::string, 2> PoseNames(const HandEyeArguments& arguments) {
  if (arguments.mount == "gripper") return {"gripper_rig", "base_target"};
  return {"base_rig", "gripper_target"};
}

std::vector<OpenDirection> OpenDirections(const HandEyeArguments& arguments,
                                          const OutsideFit& fit) {
  std::vector<std::string> names;
  for (const std::string& pose : PoseNames(arguments)) {
    for (const char* coordinate : kExtrinsicsNames) {
      names.push_back(fmt::format("T_{}.{}", pose, coordinate));
    }
  }
  std::vector<OpenDirection> directions;
  for (const auto& direction : fit.open.colwise()) {
    directions.push_back(Describe(direction, std::numeric_limits<double>::infinity(), names));
  }
  return directions;
}

std::string HandEyeYaml(const HandEyeArguments& arguments,
                        const CalibratedPoses& calibrated,
                        const MatchedPoses& matched,
                        const OutsideFit& fit) {
  const auto [rig, target] = PoseNames(arguments);
  std::string text = "plenocal: 1\nmount: " + arguments.mount + "\n";
  text += PoseYaml(rig, fit.T_mount_rig, fit.rig_sigma);
  text += PoseYaml(target, fit.T_other_target, fit.target_sigma);
  text += UndeterminedYaml(OpenDirections(arguments, fit));
  text += fmt::format("scale: {:.12g}\nsigma_scale: {:.6g}\n", fit.scale, fit.scale_sigma);
  text += fmt::format("scatter: {{translation: {:.6g}, rotation: {:.6g}}}\n",
                      fit.translation_sigma,
                      fit.rotation_sigma);
  if (matched.shift) {
    text += fmt::format("time_shift: {:.9g}\nsigma_time_shift: {}\n",
                        *matched.shift,
                        YamlNumber(fit.time_shift_sigma));
  }
  text += fmt::format("calibration_errors: {}\n",
                      calibrated.without_errors.empty() ? "included" : "left_out");
  return text + fmt::format("frames: {}\nleft_out: {}\n",
                            fit.used.size(),
                            std::ranges::count(fit.used, false));
}

std::string PoseText(const char* what, const RigidTransform& T, const Vector6d& sigma) {
  constexpr double kDegrees = 180 / std::numbers::pi;
  const Eigen::Vector3d w = kDegrees * LogRotation(T.R);
  return fmt::format(
      "{}: ({:.3f}, {:.3f}, {:.3f}) +- ({:.3f}, {:.3f}, {:.3f}) mm, rotation vector "
      "({:.4f}, {:.4f}, {:.4f}) +- ({:.4f}, {:.4f}, {:.4f}) degrees\n",
      what,
      1e3 * T.t.x(),
      1e3 * T.t.y(),
      1e3 * T.t.z(),
      1e3 * sigma[0],
      1e3 * sigma[1],
      1e3 * sigma[2],
      w.x(),
      w.y(),
      w.z(),
      kDegrees * sigma[3],
      kDegrees * sigma[4],
      kDegrees * sigma[5]);
}

// By chi-square: estimates of independent standard normal errors.
bool ContradictsCalibration(const OutsideFit& fit) {
  constexpr double kFalse = 1e-3;
  const Eigen::Index count = fit.calibration_errors.size();
  return count > 0 &&
         fit.calibration_errors.squaredNorm() > ChiSquareQuantile(static_cast<int>(count), kFalse);
}

std::string HandEyeText(const HandEyeArguments& arguments,
                        const CalibratedPoses& calibrated,
                        const MatchedPoses& matched,
                        const OutsideFit& fit) {
  constexpr double kDegrees = 180 / std::numbers::pi;
  const bool on_gripper = arguments.mount == "gripper";
  std::string text = PoseText(on_gripper ? "rig in the gripper's frame" : "rig in the base's frame",
                              fit.T_mount_rig,
                              fit.rig_sigma);
  text += PoseText(on_gripper ? "target in the base's frame" : "target in the gripper's frame",
                   fit.T_other_target,
                   fit.target_sigma);
  if (arguments.free_scale) {
    text +=
        fmt::format("lengths from outside are {:.5f} +- {:.5f} times those of the calibration\n",
                    fit.scale,
                    fit.scale_sigma);
  }
  text += fmt::format(
      "poses from outside scatter by {:.3f} mm and {:.4f} degrees about it, over {} "
      "frames\n",
      1e3 * fit.translation_sigma,
      kDegrees * fit.rotation_sigma,
      fit.used.size());
  for (size_t i = 0; i < fit.used.size(); ++i) {
    if (!fit.used[i])
      text += fmt::format("  left out: frame {}, which is far off\n", matched.frames[i]);
  }
  if (matched.shift && std::isinf(fit.time_shift_sigma)) {
    text += "clocks: their difference is open; the rig was at rest in the frames\n";
  } else if (matched.shift) {
    text += fmt::format("clocks: {:.3f} +- {:.2g} ms are added to the times of the images\n",
                        1e3 * *matched.shift,
                        1e3 * fit.time_shift_sigma);
  }
  if (!calibrated.without_errors.empty()) {
    text +=
        "standard errors leave out those of the calibration: " + calibrated.without_errors + "\n";
  } else if (ContradictsCalibration(fit)) {
    text +=
        "the poses contradict the calibration: its parameters would have to be wrong by more than "
        "their standard errors. See its report, and check the robot's own calibration\n";
  }
  const size_t without = calibrated.without + matched.without;
  if (without > 0) text += fmt::format("  frames without a pose: {}\n", without);
  if (fit.open.cols() == 1) {
    const Eigen::Vector3d axis = fit.open.col(0).head<3>().normalized();
    text += fmt::format(
        "NOT DETERMINED: all rotations are about one axis, up to the noise of the poses; the "
        "translation along it is open, ({:.3f}, {:.3f}, {:.3f}) in the {}'s frame for the rig. "
        "Turn the gripper about a second axis by 15 degrees or more.\n",
        axis.x(),
        axis.y(),
        axis.z(),
        arguments.mount);
  } else if (fit.open.cols() > 1) {
    text +=
        "NOT DETERMINED: the gripper hardly turned; turn it about two axes by 15 degrees or more.\n";
  }
  return text;
}

void RunHandEye(const HandEyeArguments& arguments, const ConsoleOptions& shared) {
  Console console(shared);
  const CalibratedPoses calibrated = ReadCalibratedPoses(arguments.folder);
  const MatchedPoses matched = NamesFrames(arguments.poses) ? MatchByName(arguments, calibrated)
                                                            : MatchByTime(arguments, calibrated);
  CheckUnits(matched, arguments.poses);
  const OutsideFit fit = Fit(arguments, matched);
  if (!arguments.out.empty())
    WriteOutput(arguments.out, HandEyeYaml(arguments, calibrated, matched, fit));
  console.Print(HandEyeText(arguments, calibrated, matched, fit));
}

constexpr const char* kHandEyeHelp =
    "Where a rig is mounted on a robot, from a calibration and the robot's poses.\n\n"
    "  plenocal handeye OUT --poses robot.csv -o handeye.yaml\n\n"
    "OUT is the folder that 'plenocal calibrate' wrote. The file of poses has the columns of poses.csv: frame,x,y,z,qx,qy,qz,qw, T_base_gripper in metres; or times in place of frames, as TUM files (t x y z qx qy qz qw) and those of EuRoC: then poses are taken between two of them at the times of the frames, and the clocks' difference is estimated. With --mount base the rig stands in the base's frame and the target is on the gripper.";

RunCommand DeclareHandEye(CLI::App* app, ConsoleOptions* shared) {
  const auto arguments = std::make_shared<HandEyeArguments>();
  app->add_option("folder", arguments->folder, "folder of the calibration")->required();
  app->add_option(
         "--poses", arguments->poses, "T_base_gripper: CSV with a row a frame, or a trajectory")
      ->required();
  app->add_option("--times",
                  arguments->times,
                  "with a trajectory: file of the times of the frames (default: their names)");
  app->add_option("--mount",
                  arguments->mount,
                  "where the rig is: gripper (eye-in-hand) or base (eye-to-hand)")
      ->check(CLI::IsMember({"gripper", "base"}))
      ->capture_default_str();
  app->add_flag("--scale",
                arguments->free_scale,
                "estimate the scale of the target, whose size nobody measured");
  app->add_option("-o,--out", arguments->out, "handeye.yaml to write");
  AddQuiet(app, shared);
  return [arguments, shared] { RunHandEye(*arguments, *shared); };
}

}  // namespace

Command HandeyeCommand() { return {"handeye", kHandEyeHelp, DeclareHandEye}; }

}  // namespace plenocal
