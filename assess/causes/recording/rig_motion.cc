// SPDX-License-Identifier: Apache-2.0
//
// Cameras of a rig that disagree about the target's pose: images paired wrongly by a constant
// number of frames, a camera that moved on the rig, or images taken at different times.
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <optional>

#include "assess/causes/cause.h"
#include "assess/causes/residual_tests.h"
#include "calib/base/statistics.h"

namespace plenocal {
namespace {

// Between the images of one frame; more makes the rig useless for measuring.
constexpr double kBadDisagreement = 1;  // px

using Poses = std::map<int, RigidTransform>;  // T_camera_target by frame

Poses PosesOf(const Bundle& bundle, size_t c) {
  Poses poses;
  for (const BundleObservation& observation : bundle.observations) {
    if (observation.camera != static_cast<int>(c) || !observation.used) continue;
    if (poses.contains(observation.frame)) continue;
    poses[observation.frame] =
        bundle.cameras[c].T_camera_rig * bundle.SeenPose(static_cast<size_t>(observation.frame), c);
  }
  return poses;
}

// Angle of the target's rotation from one frame to the next, the same for all cameras of a rigid
// rig.
std::map<int, double> Turns(const Poses& poses) {
  std::map<int, double> turns;
  for (const auto& [frame, pose] : poses) {
    const auto next = poses.find(frame + 1);
    if (next != poses.end()) turns[frame] = LogRotation(next->second.R * pose.R.transpose()).norm();
  }
  return turns;
}

// Median difference of the turns when the second camera's frames are `shift` later.
std::optional<double> Mismatch(const std::map<int, double>& a,
                               const std::map<int, double>& b,
                               int shift) {
  constexpr size_t kLeast = 5;
  std::vector<double> differences;
  for (const auto& [frame, turn] : a) {
    const auto other = b.find(frame + shift);
    if (other != b.end()) differences.push_back(std::abs(turn - other->second));
  }
  if (differences.size() < kLeast) return std::nullopt;
  return Median(std::move(differences));
}

// By how many frames a camera's images are late against the master's; 0: paired rightly, or not
// decided.
int OffsetOf(const Poses& master, const Poses& camera) {
  constexpr int kMost = 5;
  constexpr double kDecisive = 0.2;  // mismatch at the offset over that without
  const std::map<int, double> a = Turns(master), b = Turns(camera);
  const std::optional<double> without = Mismatch(a, b, 0);
  if (!without) return 0;
  int best = 0;
  double least = kDecisive * *without;
  for (int shift = -kMost; shift <= kMost; ++shift) {
    const std::optional<double> mismatch = shift == 0 ? std::nullopt : Mismatch(a, b, shift);
    if (!mismatch || *mismatch >= least) continue;
    best = shift;
    least = *mismatch;
  }
  return best;
}

// Probability by chance of the largest change of the mean at one frame. `errors`: a row a frame.
double ChangeByChance(const Eigen::MatrixXd& errors) {
  constexpr Eigen::Index kLeast = 3;  // frames on each side
  return errors.rows() < 2 * kLeast + 1
             ? 1
             : LargestSplit(errors, Eigen::VectorXd::Ones(errors.rows()), kLeast).Probability();
}

// Whether the disagreement of the camera's poses persists: it was displaced once, or drifts. Where
// the images were taken at different times each frame has an error of its own.
bool HasMoved(const Bundle& bundle, size_t c, const Poses& master, const Poses& camera) {
  constexpr double kLevel = 1e-3;
  Eigen::MatrixXd errors(static_cast<Eigen::Index>(camera.size()), 6);
  Eigen::Index count = 0;
  for (const auto& [frame, pose] : camera) {
    if (!master.contains(frame)) continue;
    errors.row(count++) = bundle.jitter.delta[bundle.View(static_cast<size_t>(frame), c)];
  }
  const double chance = std::min(ChangeByChance(errors.topLeftCorner(count, 3)),
                                 ChangeByChance(errors.topRightCorner(count, 3)));
  return 2 * chance < kLevel;
}

// RMS displacement in the images that the disagreement makes, px.
double Displacement(const Bundle& bundle) {
  double squares = 0, count = 0;
  for (size_t c = 0; c < bundle.cameras.size(); ++c) {
    for (const ViewRows& view : RowsOfViews(bundle, c)) {
      const Vector6d& delta = bundle.jitter.delta[bundle.View(static_cast<size_t>(view.frame), c)];
      const Eigen::VectorXd moved = view.pose * delta;
      for (Eigen::Index i = 0; i < view.noise.size(); ++i) {
        squares += moved.segment<2>(2 * i).squaredNorm() * view.noise[i] * view.noise[i];
      }
      count += static_cast<double>(view.noise.size());
    }
  }
  return count > 0 ? std::sqrt(squares / count) : 0;
}

Finding Misaligned(const std::string& master, const std::string& camera, int offset) {
  return {.code = "frames_misaligned",
          .role = FindingRole::kCause,
          .grade = Grade::kBad,
          .cameras = {camera},
          .value = offset,
          .limit = 0,
          .what = fmt::format(
              "{}: its images are paired wrongly: the motion of the target agrees "
              "with that in {} when each image belongs to the frame {} {}.",
              camera,
              master,
              std::abs(offset) == 1 ? std::string("one") : std::to_string(std::abs(offset)),
              offset > 0 ? "before" : "after"),
          .remedy =
              "Rename or remove images so that images of one instant have the same name; a "
              "recording often starts earlier in one camera."};
}

std::vector<Finding> FindRigMotion(const CauseEvidence& evidence) {
  const Bundle& bundle = evidence.calibration->bundle;
  if (bundle.jitter.delta.empty()) return {};
  std::vector<Finding> findings;
  const Poses master = PosesOf(bundle, 0);
  bool moved = false;
  for (size_t c = 1; c < bundle.cameras.size(); ++c) {
    const Poses camera = PosesOf(bundle, c);
    const int offset = OffsetOf(master, camera);
    if (offset != 0) {
      findings.push_back(Misaligned(bundle.cameras[0].name, bundle.cameras[c].name, offset));
    }
    moved = moved || HasMoved(bundle, c, master, camera);
  }
  if (!findings.empty()) return findings;
  const double displacement = Displacement(bundle);
  findings.push_back(
      {.code = moved ? "rig_not_rigid" : "not_synchronous",
       .role = FindingRole::kRigCause,
       .grade = displacement > kBadDisagreement ? Grade::kBad : Grade::kUsable,
       .cameras = {},
       .value = displacement,
       .limit = displacement > kBadDisagreement ? kBadDisagreement : 0,
       .what =
           moved ? fmt::format("A camera moved on the rig during the recording: the disagreement "
                               "of its poses ({:.2g} px in the images) persists from frame to "
                               "frame.",
                               displacement)
                 : fmt::format("The images of a frame were not taken at the same time: the poses "
                               "of the cameras disagree by {:.2g} px in the images, in each frame "
                               "by another error.",
                               displacement),
       .remedy = moved ? "Fasten the cameras and record again, or calibrate the parts of the "
                         "recording as sessions of their own."
                       : "Trigger the cameras together, or hold the target still for each frame."});
  return findings;
}

}  // namespace

Cause RigMotionCause() { return {CauseStage::kRig, FindRigMotion}; }

}  // namespace plenocal
