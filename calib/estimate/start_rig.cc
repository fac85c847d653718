// SPDX-License-Identifier: Apache-2.0
#include "calib/estimate/start_rig.h"

#include <algorithm>
#include <map>
#include <string>
#include <string_view>
#include <utility>

#include "calib/base/format_error.h"
#include "calib/rig/rig_graph.h"

namespace plenocal {
namespace {

using FramePoses = std::map<std::string_view, const RigidTransform*>;  // T_camera_target

FramePoses PosesOf(const CameraInput& camera, const CameraGuess& guess) {
  FramePoses poses;
  for (size_t v = 0; v < camera.views.size(); ++v) {
    const auto& pose = guess.T_camera_target[v];
    if (pose) poses.emplace(camera.views[v].frame, &*pose);
  }
  return poses;
}

// T_a_b from every common frame.
std::vector<RigidTransform> RelativePoses(const FramePoses& a, const FramePoses& b) {
  std::vector<RigidTransform> transforms;
  for (const auto& [frame, T_a_target] : a) {
    const auto other = b.find(frame);
    if (other != b.end()) transforms.push_back(*T_a_target * other->second->Inverse());
  }
  return transforms;
}

[[noreturn]] void FailUnlinked(std::span<const CameraInput> cameras,
                               const std::vector<bool>& linked) {
  std::string open, reached;
  for (size_t c = 0; c < cameras.size(); ++c) {
    std::string& list = linked[c] ? reached : open;
    list += (list.empty() ? "" : ", ") + cameras[c].name;
  }
  throw JobError(
      "no frame in which {} sees the target together with {}: their mutual pose cannot "
      "be determined. Frames are matched by name (what the last '*' of the glob stands "
      "for); check the names, or add frames that both see. Cameras that never see it together "
      "need a second target ('targets'), or an earlier calibration of both ('from')",
      open,
      reached);
}

// T_camera_rig of a camera that is not linked, by a linked camera of the same earlier calibration,
// and the index of that one; nothing when there is none.
std::pair<std::optional<RigidTransform>, size_t> EarlierPlace(
    std::span<const std::optional<RigidTransform>> earlier,
    const std::vector<bool>& linked,
    const std::vector<RigidTransform>& T_camera_rig) {
  for (size_t from = 0; from < earlier.size(); ++from) {
    if (!linked[from] || !earlier[from]) continue;
    for (size_t to = 0; to < earlier.size(); ++to) {
      if (linked[to] || !earlier[to]) continue;
      return {*earlier[to] * earlier[from]->Inverse() * T_camera_rig[from], to};
    }
  }
  return {};
}

}  // namespace

std::vector<RigidTransform> GuessRig(std::span<const CameraInput> cameras,
                                     std::span<const CameraGuess> guesses,
                                     std::span<const std::optional<RigidTransform>> earlier) {
  const size_t count = cameras.size();
  std::vector<FramePoses> poses;
  for (size_t c = 0; c < count; ++c) poses.push_back(PosesOf(cameras[c], guesses[c]));
  std::vector<RigidTransform> T_camera_rig(count);
  std::vector<bool> linked(count, false);
  linked[0] = true;
  for (size_t step = 1; step < count; ++step) {
    size_t best_from = 0, best_to = 0;
    std::vector<RigidTransform> best;
    for (size_t from = 0; from < count; ++from) {
      if (!linked[from]) continue;
      for (size_t to = 0; to < count; ++to) {
        if (linked[to]) continue;
        std::vector<RigidTransform> transforms = RelativePoses(poses[to], poses[from]);
        if (transforms.size() > best.size()) {
          best = std::move(transforms);
          best_from = from;
          best_to = to;
        }
      }
    }
    if (best.empty()) {
      const auto [known, to] = EarlierPlace(earlier, linked, T_camera_rig);
      if (!known) FailUnlinked(cameras, linked);
      best = {*known};  // from the first camera, whose frame is the rig's
      best_to = to;
    }
    T_camera_rig[best_to] = Medoid(best) * T_camera_rig[best_from];
    linked[best_to] = true;
  }
  return T_camera_rig;
}

}  // namespace plenocal
