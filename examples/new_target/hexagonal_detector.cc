// SPDX-License-Identifier: Apache-2.0
#include "detectors/boards/hexagonal_detector.h"

#include "detectors/boards/markers_detector.h"
#include "detectors/templates/board_templates.h"

namespace plenocal {

std::unique_ptr<MarkerDetector> MakeDetector(const HexagonalLayout& /*layout*/,
                                             const Target& /*target*/) {
  FailWithoutDetector("hexagonal");
}

std::vector<internal::MarkerTemplate> internal::MakeTemplates(
    const HexagonalLayout& layout, const Target& target, const std::vector<Observation>& found) {
  return DiscTemplates({.nearest = layout.spacing, .radius = layout.spacing / 4}, target, found);
}

}  // namespace plenocal
