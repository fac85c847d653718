// SPDX-License-Identifier: Apache-2.0
#include "calib/adjust/solver/bounds.h"

#include <ceres/manifold.h>

#include <algorithm>
#include <cmath>
#include <utility>

namespace plenocal::internal {

void EstimateFree(const IntrinsicsBlock& block, ceres::Problem* problem) {
  std::vector<int> fixed;
  for (size_t slot = 0; slot < block.Size(); ++slot) {
    if (block.IsFixed(slot)) fixed.push_back(static_cast<int>(slot));
  }
  if (fixed.size() == block.Size()) {
    problem->SetParameterBlockConstant(block.values);
    return;
  }
  problem->SetParameterBlockVariable(block.values);
  problem->SetManifold(
      block.values,
      fixed.empty() ? nullptr : new ceres::SubsetManifold(static_cast<int>(block.Size()), fixed));
}

ActiveSet::ActiveSet(std::vector<IntrinsicsBlock*> blocks,
                     Unknowns* unknowns,
                     ceres::Problem* problem)
    : blocks_(std::move(blocks)),
      unknowns_(*unknowns),
      problem_(*problem),
      feasible_(unknowns->values) {
  int bounded = 0;
  for (const IntrinsicsBlock* block : blocks_) {
    for (size_t slot = 0; slot < block->Size(); ++slot) {
      if (std::isfinite(block->lower[slot]) || std::isfinite(block->upper[slot])) ++bounded;
    }
  }
  // Each bound is taken and given up a few times at most; rounding could go on for ever.
  most_passes_ = 2 * bounded;
}

bool ActiveSet::Update() {
  const int pass = passes_++;
  const Leaver leaver = FirstLeaver();
  bool again = true;
  if (leaver.block != nullptr) {
    StopAtBound(leaver);
  } else {
    again = pass <= most_passes_ && ReleaseThoseThatGoInside();
  }
  feasible_ = unknowns_.values;
  return again;
}

ActiveSet::Leaver ActiveSet::FirstLeaver() const {
  Leaver first;
  for (IntrinsicsBlock* block : blocks_) {
    for (size_t slot = 0; slot < block->Size(); ++slot) {
      const double value = block->values[slot];
      if (block->IsFixed(slot) || (value >= block->lower[slot] && value <= block->upper[slot])) {
        continue;
      }
      const double before =
          feasible_[static_cast<size_t>(block->values - unknowns_.values.data()) + slot];
      const double bound = std::clamp(value, block->lower[slot], block->upper[slot]);
      const double part = (bound - before) / (value - before);
      if (first.block != nullptr && part >= first.part) continue;
      first = {block, slot, part};
    }
  }
  return first;
}

void ActiveSet::StopAtBound(const Leaver& leaver) {
  IntrinsicsBlock& block = *leaver.block;
  const double bound =
      std::clamp(block.values[leaver.slot], block.lower[leaver.slot], block.upper[leaver.slot]);
  std::vector<double>& values = unknowns_.values;
  for (size_t i = 0; i < values.size(); ++i) {
    values[i] = feasible_[i] + leaver.part * (values[i] - feasible_[i]);
  }
  block.values[leaver.slot] = bound;
  block.at_bound[leaver.slot] = true;
}

bool ActiveSet::ReleaseThoseThatGoInside() {
  bool released = false;
  for (IntrinsicsBlock* block : blocks_) {
    if (std::find(block->at_bound.begin(), block->at_bound.end(), true) == block->at_bound.end()) {
      continue;
    }
    problem_.SetParameterBlockVariable(block->values);
    problem_.SetManifold(block->values, nullptr);
    ceres::Problem::EvaluateOptions evaluate;
    evaluate.parameter_blocks = {block->values};
    std::vector<double> gradient;
    problem_.Evaluate(evaluate, nullptr, nullptr, &gradient, nullptr);
    for (size_t slot = 0; slot < block->Size(); ++slot) {
      if (!block->at_bound[slot]) continue;
      const bool at_lower = block->values[slot] == block->lower[slot];
      if (at_lower ? gradient[slot] < 0 : gradient[slot] > 0) {
        block->at_bound[slot] = false;
        released = true;
      }
    }
  }
  return released;
}

}  // namespace plenocal::internal
