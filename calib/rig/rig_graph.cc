// SPDX-License-Identifier: Apache-2.0
#include "calib/rig/rig_graph.h"

#include <algorithm>
#include <limits>
#include <map>
#include <utility>

namespace plenocal {
namespace {

// Motions of two groups need three instants.
constexpr size_t kFewestMotionFrames = 3;
// One wrong pose among so many frames is outvoted; a pose from few points at the rim of an image
// may be wrong. Motion has twice as many unknowns.
constexpr size_t kSureFrames = 3, kSureMotionFrames = 6;

// A group of cameras and one of targets, and in which frames the one saw the other:
// T_cameras_targets.
using GroupPair = std::pair<size_t, size_t>;
using GroupPoses = std::map<GroupPair, std::map<int, RigidTransform>>;

// Two groups that can be joined, with their mutual pose in each common frame.
struct Candidate {
  size_t into = 0, from = 0;               // groups
  std::vector<RigidTransform> transforms;  // T_from_into of cameras, T_into_from of targets
};

class RigLinker {
 public:
  RigLinker(std::span<const Sighting> sightings,
            size_t cameras,
            std::span<const GraphTarget> targets)
      : sightings_(sightings), targets_(targets) {
    for (size_t c = 0; c < cameras; ++c) graph_.camera_group.push_back(c);
    for (size_t k = 0; k < targets.size(); ++k) graph_.target_group.push_back(k);
    graph_.T_camera_group.resize(cameras);
    graph_.T_group_target.resize(targets.size());
    JoinKnownTargets();
  }

  void JoinKnownCameras(std::span<const std::optional<RigidTransform>> earlier) {
    std::vector<size_t> known;
    for (size_t c = 0; c < earlier.size(); ++c) {
      if (earlier[c]) known.push_back(c);
    }
    for (size_t i = 1; i < known.size(); ++i) {
      const size_t c = known[i];
      graph_.camera_group[c] = known[0];
      graph_.T_camera_group[c] = *earlier[c] * earlier[known[0]]->Inverse();
    }
    if (known.size() < 2) return;
    graph_.links.push_back(
        {.by = RigLink::By::kEarlier, .cameras = {known.begin() + 1, known.end()}, .targets = {}});
  }

  RigGraph Run() {
    while (JoinOnce()) {
    }
    return std::move(graph_);
  }

 private:
  void JoinKnownTargets() {
    std::optional<size_t> first;
    for (size_t k = 0; k < targets_.size(); ++k) {
      if (!targets_[k].known) continue;
      if (!first) {
        first = k;
        continue;
      }
      graph_.target_group[k] = *first;
      graph_.T_group_target[k] = targets_[*first].known->Inverse() * *targets_[k].known;
    }
  }

  // Takes the surest of all joints that are possible now; false when there is none.
  bool JoinOnce() {
    CollectPoses();
    return JoinDirectly(kSureFrames) || JoinByMotion(kSureMotionFrames) || JoinDirectly(1) ||
           JoinByMotion(kFewestMotionFrames);
  }

  bool JoinDirectly(size_t fewest_frames) {
    const Candidate cameras = BestCameras(), targets = BestTargets();
    if (cameras.transforms.size() >= std::max(fewest_frames, targets.transforms.size())) {
      graph_.links.push_back({.by = RigLink::By::kSameTarget,
                              .cameras = MembersOf(graph_.camera_group, cameras.from),
                              .targets = {},
                              .frames = cameras.transforms.size()});
      JoinCameras(cameras.into, cameras.from, Medoid(cameras.transforms));
      return true;
    }
    if (targets.transforms.size() >= fewest_frames) {
      graph_.links.push_back({.by = RigLink::By::kSameCamera,
                              .cameras = {},
                              .targets = MembersOf(graph_.target_group, targets.from),
                              .frames = targets.transforms.size()});
      JoinTargets(targets.into, targets.from, Medoid(targets.transforms));
      return true;
    }
    return false;
  }

  void CollectPoses() {
    poses_.clear();
    for (const Sighting& sighting : sightings_) {
      const GroupPair pair{graph_.camera_group[sighting.camera],
                           graph_.target_group[sighting.target]};
      poses_[pair].try_emplace(sighting.frame,
                               graph_.T_camera_group[sighting.camera].Inverse() *
                                   sighting.T_camera_target *
                                   graph_.T_group_target[sighting.target].Inverse());
    }
  }

  static std::vector<size_t> MembersOf(const std::vector<size_t>& group_of, size_t group) {
    std::vector<size_t> members;
    for (size_t i = 0; i < group_of.size(); ++i) {
      if (group_of[i] == group) members.push_back(i);
    }
    return members;
  }

  // Groups of cameras that see one group of targets in the same frames.
  [[nodiscard]] Candidate BestCameras() const {
    Candidate best;
    for (const auto& [a, poses_a] : poses_) {
      for (const auto& [b, poses_b] : poses_) {
        if (a.second != b.second || a.first >= b.first) continue;
        Candidate candidate{a.first, b.first, {}};
        for (const auto& [frame, T_a] : poses_a) {
          const auto other = poses_b.find(frame);
          if (other == poses_b.end()) continue;
          candidate.transforms.push_back(other->second * T_a.Inverse());
        }
        if (candidate.transforms.size() > best.transforms.size()) best = std::move(candidate);
      }
    }
    return best;
  }

  // Groups of targets that one group of cameras sees in the same frames.
  [[nodiscard]] Candidate BestTargets() const {
    Candidate best;
    for (const auto& [a, poses_a] : poses_) {
      for (const auto& [b, poses_b] : poses_) {
        if (a.first != b.first || a.second >= b.second || Moves(a.second) || Moves(b.second)) {
          continue;
        }
        Candidate candidate{a.second, b.second, {}};
        for (const auto& [frame, T_a] : poses_a) {
          const auto other = poses_b.find(frame);
          if (other == poses_b.end()) continue;
          candidate.transforms.push_back(T_a.Inverse() * other->second);
        }
        if (candidate.transforms.size() > best.transforms.size()) best = std::move(candidate);
      }
    }
    return best;
  }

  [[nodiscard]] bool Moves(size_t target_group) const { return targets_[target_group].moves; }

  // Instants in which one group of cameras sees one group of targets and another another.
  bool JoinByMotion(size_t fewest_instants) {
    struct Pair {
      GroupPair a, b;
      std::vector<HandEyePair> instants;
    };
    std::vector<Pair> pairs;
    for (const auto& [a, poses_a] : poses_) {
      for (const auto& [b, poses_b] : poses_) {
        if (a.first >= b.first || a.second == b.second || Moves(a.second) || Moves(b.second)) {
          continue;
        }
        Pair pair{a, b, {}};
        for (const auto& [frame, T_a] : poses_a) {
          const auto other = poses_b.find(frame);
          if (other != poses_b.end()) pair.instants.push_back({other->second, T_a});
        }
        if (pair.instants.size() >= fewest_instants) pairs.push_back(std::move(pair));
      }
    }
    // The most certain pair first: cameras that see a target with its cameras are placed by it
    // later.
    const Pair* best = nullptr;
    std::optional<HandEye> found;
    for (const Pair& pair : pairs) {
      const std::optional<HandEye> each = SolveHandEye(pair.instants);
      if (!each || each->gap == HandEyeGap::kTranslation) continue;
      if (found && each->error >= found->error) continue;
      best = &pair;
      found = each;
    }
    if (best == nullptr) return false;
    const Pair& pair = *best;
    graph_.links.push_back({.by = RigLink::By::kMotion,
                            .cameras = MembersOf(graph_.camera_group, pair.b.first),
                            .targets = MembersOf(graph_.target_group, pair.b.second),
                            .frames = pair.instants.size()});
    JoinCameras(pair.a.first, pair.b.first, found->X);
    // T_b = X T_a Y with Y = T_a's targets to b's.
    const auto [into, from] = std::minmax(pair.a.second, pair.b.second);
    JoinTargets(into, from, into == pair.a.second ? found->Y : found->Y.Inverse());
    return true;
  }

  void JoinCameras(size_t into, size_t from, const RigidTransform& T_from_into) {
    for (size_t c = 0; c < graph_.camera_group.size(); ++c) {
      if (graph_.camera_group[c] != from) continue;
      graph_.camera_group[c] = into;
      graph_.T_camera_group[c] = graph_.T_camera_group[c] * T_from_into;
    }
  }

  void JoinTargets(size_t into, size_t from, const RigidTransform& T_into_from) {
    for (size_t k = 0; k < graph_.target_group.size(); ++k) {
      if (graph_.target_group[k] != from) continue;
      graph_.target_group[k] = into;
      graph_.T_group_target[k] = T_into_from * graph_.T_group_target[k];
    }
  }

  std::span<const Sighting> sightings_;
  std::span<const GraphTarget> targets_;
  RigGraph graph_;
  GroupPoses poses_;
};

}  // namespace

RigGraph LinkRig(std::span<const Sighting> sightings,
                 size_t cameras,
                 std::span<const GraphTarget> targets,
                 std::span<const std::optional<RigidTransform>> earlier) {
  RigLinker linker(sightings, cameras, targets);
  linker.JoinKnownCameras(earlier);
  return linker.Run();
}

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

}  // namespace plenocal
