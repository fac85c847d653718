// SPDX-License-Identifier: Apache-2.0
//
// White images of another focus or zoom than the raw images of a plenoptic camera.
#include <fmt/format.h>

#include "assess/causes/cause.h"

namespace plenocal {
namespace {

std::vector<Finding> FindWhiteLattice(const CauseEvidence& evidence) {
  std::vector<LatticeShift> images;
  for (const auto& [frame, traits] : *evidence.traits) images.push_back(traits.lattice);
  const std::optional<LatticeShift> shift = SignificantShift(images);
  if (!shift) return {};
  return {{.code = "white_lattice",
           .grade = Grade::kUsable,
           .value = shift->Largest(),
           .limit = kLeastLatticeShift,
           .what = fmt::format("In the raw images {}.", ShiftText(*shift)),
           .remedy = "Record white images with the focus, zoom and stop of the raw images."}};
}

}  // namespace

Cause WhiteLatticeCause() { return {CauseStage::kImageFile, FindWhiteLattice}; }

}  // namespace plenocal
