// SPDX-License-Identifier: Apache-2.0
#include "calib/start_rig.h"

#include <fmt/format.h>

#include <algorithm>
#include <limits>
#include <map>
#include <string>
#include <string_view>
#include <utility>

#include "calib/base/error.h"

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

// The one that agrees best with the others: the smallest sum of distances, of at most 100 tried.
RigidTransform Medoid(const std::vector<RigidTransform>& transforms) {
  constexpr size_t kMostTried = 100;
  const size_t stride = transforms.size() / kMostTried + 1;
  double size = 0;
  for (const RigidTransform& T : transforms) {
    size += T.t.norm() / static_cast<double>(transforms.size());
  }
  const RigidTransform* best = &transforms[0];
  double best_sum = std::numeric_limits<double>::infinity();
  for (size_t i = 0; i < transforms.size(); i += stride) {
    double sum = 0;
    for (size_t j = 0; j < transforms.size(); j += stride) {
      const RigidTransform difference = transforms[i].Inverse() * transforms[j];
      sum += LogRotation(difference.R).norm() +
             difference.t.norm() / std::max(size, std::numeric_limits<double>::min());
    }
    if (sum < best_sum) {
      best_sum = sum;
      best = &transforms[i];
    }
  }
  return *best;
}

[[noreturn]] void FailUnlinked(std::span<const CameraInput> cameras,
                               const std::vector<bool>& linked) {
  std::string open, reached;
  for (size_t c = 0; c < cameras.size(); ++c) {
    std::string& list = linked[c] ? reached : open;
    list += (list.empty() ? "" : ", ") + cameras[c].name;
  }
  throw Error(
      ErrorKind::kJob,
      fmt::format("no frame in which {} sees the target together with {}: their mutual pose cannot "
                  "be determined. Frames are matched by name (what the last '*' of the glob stands "
                  "for); check the names, or add frames that both see",
                  open,
                  reached));
}

}  // namespace

std::vector<RigidTransform> GuessRig(std::span<const CameraInput> cameras,
                                     std::span<const CameraGuess> guesses) {
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
    if (best.empty()) FailUnlinked(cameras, linked);
    T_camera_rig[best_to] = Medoid(best) * T_camera_rig[best_from];
    linked[best_to] = true;
  }
  return T_camera_rig;
}

}  // namespace plenocal
