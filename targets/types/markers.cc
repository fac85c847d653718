// SPDX-License-Identifier: Apache-2.0
#include "targets/types/markers.h"

#include "calib/base/format_error.h"
#include "targets/target.h"

namespace plenocal {

Target MarkersLayout::Read(const YamlNode& /*node*/) {
  Target target;
  target.layout = MarkersLayout{};
  return target;
}

std::vector<TargetPart> MarkersLayout::Draw(const MarkerPositions& /*markers*/, Pieces /*pieces*/) {
  throw InputError(
      "a target of type 'markers' cannot be drawn: its file has positions, but no pattern");
}

}  // namespace plenocal
