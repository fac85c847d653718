// SPDX-License-Identifier: Apache-2.0
#include "calib/adjust/all_unknowns/parameter_blocks.h"

#include <algorithm>
#include <utility>

namespace plenocal::internal {
namespace {

// Fixed parameters in a block cost Ceres a dense product for each residual block. Cameras with many
// free parameters beside some fixed ones have a block without these.
bool LeavesOutFixed(const BundleCamera& camera) {
  const auto fixed = std::count(camera.fixed.begin(), camera.fixed.end(), true);
  return camera.model->support_size > 0 && fixed > 0 && fixed < std::ssize(camera.fixed);
}

// Distributes the parameters of all cameras over blocks; cameras that have a parameter in common
// share one.
class BlockMaker {
 public:
  BlockMaker(const Bundle& bundle, std::deque<IntrinsicsBlock>* blocks)
      : bundle_(bundle),
        blocks_(*blocks),
        first_(bundle.cameras.size()),
        tied_(bundle.cameras.size(), false),
        slots_(bundle.cameras.size()) {}

  std::vector<Intrinsics> Make() {
    FindTies();
    const size_t count = bundle_.cameras.size();
    std::vector<Intrinsics> all(count);
    for (size_t c = 0; c < count; ++c) {
      if (first_[c] == c) blocks_.emplace_back();
      all[c].block = first_[c] == c ? &blocks_.back() : all[first_[c]].block;
      slots_[c].resize(bundle_.cameras[c].params.size());
      AddOwnParams(c, all[c].block);
    }
    for (size_t c = 0; c < count; ++c) AddTiedParams(c, all[c].block);
    AddPriors(all);
    for (size_t c = 0; c < count; ++c) {
      if (tied_[c] || LeavesOutFixed(bundle_.cameras[c])) all[c].slots = slots_[c];
    }
    return all;
  }

 private:
  void FindTies() {
    for (size_t c = 0; c < first_.size(); ++c) first_[c] = c;
    for (size_t c = 0; c < first_.size(); ++c) {
      for (size_t k = 0; k < bundle_.cameras[c].params.size(); ++k) {
        const ParamIndex root = bundle_.Root(c, k);
        if (root == ParamIndex{c, k}) continue;
        tied_[c] = tied_[root.camera] = true;
        const size_t from = std::max(first_[c], first_[root.camera]);
        const size_t to = std::min(first_[c], first_[root.camera]);
        std::replace(first_.begin(), first_.end(), from, to);
      }
    }
  }

  void AddOwnParams(size_t c, IntrinsicsBlock* block) {
    const BundleCamera& camera = bundle_.cameras[c];
    for (size_t k = 0; k < camera.params.size(); ++k) {
      if (bundle_.Root(c, k) != ParamIndex{c, k}) continue;
      if (!tied_[c] && camera.fixed[k] && LeavesOutFixed(camera)) {
        slots_[c][k] = kNoSlot;
        continue;
      }
      slots_[c][k] = block->initial.size();
      block->initial.push_back(camera.params[k]);
      block->fixed.push_back(camera.fixed[k]);
      block->lower.push_back(-std::numeric_limits<double>::infinity());
      block->upper.push_back(std::numeric_limits<double>::infinity());
      AddRule(c, k, block);
    }
  }

  void AddTiedParams(size_t c, IntrinsicsBlock* block) {
    for (size_t k = 0; k < bundle_.cameras[c].params.size(); ++k) {
      const ParamIndex root = bundle_.Root(c, k);
      if (root == ParamIndex{c, k}) continue;
      slots_[c][k] = slots_[root.camera][root.param];
      AddRule(c, k, block);
    }
  }

  void AddRule(size_t c, size_t k, IntrinsicsBlock* block) {
    const std::vector<ParamRule>& rules = bundle_.cameras[c].rules;
    const size_t slot = slots_[c][k];
    if (rules.empty() || slot == kNoSlot) return;
    block->lower[slot] = std::max(block->lower[slot], rules[k].lower);
    block->upper[slot] = std::min(block->upper[slot], rules[k].upper);
  }

  // Parameters that are in no block are fixed: they change the sum's value.
  void AddPriors(const std::vector<Intrinsics>& all) {
    for (const ParamPrior& prior : ParamPriors(bundle_)) {
      SlotPrior own{.terms = {}, .value = prior.value, .sigma = prior.sigma};
      for (const auto& [param, weight] : prior.terms) {
        const size_t slot = slots_[param.camera][param.param];
        if (slot != kNoSlot)
          own.terms.emplace_back(slot, weight);
        else
          own.value -= weight * bundle_.cameras[param.camera].params[param.param];
      }
      if (own.terms.empty()) continue;
      all[prior.terms[0].param.camera].block->priors.push_back(std::move(own));
    }
  }

  const Bundle& bundle_;
  std::deque<IntrinsicsBlock>& blocks_;
  std::vector<size_t> first_;  // camera -> the first camera of its block
  std::vector<bool> tied_;     // per camera: to another, or another to it
  std::vector<std::vector<size_t>> slots_;
};

}  // namespace

Unknowns::Unknowns(const Bundle& bundle) {
  const auto per_block = static_cast<size_t>(MarkersPerBlock(bundle));
  marker_block_size = 3 * per_block;
  const size_t marker_blocks = (bundle.markers.size() + per_block - 1) / per_block;
  size_t size = 6 * (bundle.T_rig_target.size() + bundle.cameras.size() + bundle.targets.size() +
                     bundle.jitter.delta.size()) +
                marker_block_size * marker_blocks;
  intrinsics = BlockMaker(bundle, &blocks_).Make();
  for (const IntrinsicsBlock& block : blocks_) size += block.Size();
  values.assign(size, 0.0);
  double* next = values.data();
  const auto take = [&](size_t count) { return std::exchange(next, next + count); };

  for (const RigidTransform& T : bundle.T_rig_target) poses.push_back({T, take(6)});
  for (size_t c = 0; c < bundle.cameras.size(); ++c) {
    extrinsics.push_back({bundle.cameras[c].T_camera_rig, take(6)});
    IntrinsicsBlock& block = *intrinsics[c].block;
    if (block.values != nullptr) continue;
    block.values = take(block.Size());
    std::copy(block.initial.begin(), block.initial.end(), block.values);
  }
  for (const BundleTarget& target : bundle.targets) {
    targets.push_back({target.T_target_own, take(6)});
  }
  jitter = take(6 * bundle.jitter.delta.size());
  for (size_t i = 0; i < bundle.jitter.delta.size(); ++i) {
    Eigen::Map<Vector6d>(Jitter(i)) = bundle.jitter.delta[i];
  }
  markers = take(marker_block_size * marker_blocks);
  nominal_markers.assign(marker_block_size * marker_blocks, 0.0);
  for (size_t i = 0; i < bundle.markers.size(); ++i) {
    Eigen::Map<Eigen::Vector3d>(markers + 3 * i) = bundle.markers[i].position;
    Eigen::Map<Eigen::Vector3d>(nominal_markers.data() + 3 * i) = bundle.markers[i].nominal;
  }
}

void Unknowns::WriteTo(Bundle* bundle) const {
  for (size_t c = 0; c < bundle->cameras.size(); ++c) {
    BundleCamera& camera = bundle->cameras[c];
    for (size_t k = 0; k < camera.params.size(); ++k) {
      const size_t slot = intrinsics[c].Slot(k);
      if (slot != kNoSlot) camera.params[k] = intrinsics[c].block->values[slot];
    }
    camera.T_camera_rig = extrinsics[c].Value();
  }
  for (size_t i = 0; i < poses.size(); ++i) bundle->T_rig_target[i] = poses[i].Value();
  for (size_t i = 0; i < bundle->jitter.delta.size(); ++i) {
    bundle->jitter.delta[i] = Eigen::Map<const Vector6d>(jitter + 6 * i);
  }
  for (size_t i = 0; i < bundle->markers.size(); ++i) {
    BundleMarker& marker = bundle->markers[i];
    marker.position = Eigen::Map<const Eigen::Vector3d>(markers + 3 * i);
    marker.nominal = Eigen::Map<const Eigen::Vector3d>(nominal_markers.data() + 3 * i);
  }
  for (size_t k = 0; k < targets.size(); ++k) {
    if (bundle->targets[k].is_fixed) continue;
    bundle->targets[k].T_target_own = targets[k].origin;
    MoveTarget(k, targets[k].Value(), bundle);
  }
}

}  // namespace plenocal::internal
