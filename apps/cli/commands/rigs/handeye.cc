// SPDX-License-Identifier: Apache-2.0

#include "apps/cli/options.h"
#include "engine/rigs/hand_eye_poses.h"

namespace plenocal {
namespace {

struct HandEyeArguments : HandEyeRequest {
  std::string mount_name = "gripper";
  bool free_scale = false;
};

void RunHandEye(HandEyeArguments arguments, Console* console) {
  if (arguments.mount_name == "base") arguments.mount = RigMount::kOnBase;
  if (arguments.free_scale) arguments.scale = OutsideScale::kFree;
  console->Print(HandEyeText(FindHandEye(arguments, console->NewRun())));
}

constexpr const char* kHandEyeHelp =
    "Where a rig is mounted on a robot, from a calibration and the robot's poses.\n\n"
    "  plenocal handeye OUT --poses robot.csv -o handeye.yaml\n\n"
    "OUT is the folder that 'plenocal calibrate' wrote. The file of poses has the columns of poses.csv: frame,x,y,z,qx,qy,qz,qw, T_base_gripper in metres; or times in place of frames, as TUM files (t x y z qx qy qz qw) and those of EuRoC: then poses are taken between two of them at the times of the frames, and the clocks' difference is estimated. With --mount base the rig stands in the base's frame and the target is on the gripper.";

void DeclareHandEye(CLI::App* app, HandEyeArguments* arguments, ConsoleOptions* shared) {
  app->add_option("folder", arguments->folder, "folder of the calibration")->required();
  app->add_option(
         "--poses", arguments->poses, "T_base_gripper: CSV with a row a frame, or a trajectory")
      ->required();
  app->add_option("--times",
                  arguments->times,
                  "with a trajectory: file of the times of the frames (default: their names)");
  app->add_option("--mount",
                  arguments->mount_name,
                  "where the rig is: gripper (eye-in-hand) or base (eye-to-hand)")
      ->check(CLI::IsMember({"gripper", "base"}))
      ->capture_default_str();
  app->add_flag("--scale",
                arguments->free_scale,
                "estimate the scale of the target, whose size nobody measured");
  app->add_option("-o,--out", arguments->out, "handeye.yaml to write");
  AddQuiet(app, shared);
}

}  // namespace

Command HandeyeCommand() {
  return MakeCommand("handeye", kHandEyeHelp, DeclareHandEye, RunHandEye);
}

}  // namespace plenocal
