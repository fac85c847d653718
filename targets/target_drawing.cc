// SPDX-License-Identifier: Apache-2.0
#include "targets/target_drawing.h"

#include <variant>

#include "targets/target.h"

namespace plenocal {

std::vector<TargetPart> DrawTarget(const Target& target, Pieces pieces) {
  return std::visit([&](const auto& layout) { return layout.Draw(target.markers, pieces); },
                    target.layout);
}

}  // namespace plenocal
