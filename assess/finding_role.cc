// SPDX-License-Identifier: Apache-2.0
#include "assess/finding_role.h"

#include <algorithm>
#include <array>

namespace plenocal {
namespace {

constexpr std::array<FindingCode, 13> kCodes{{{"few_images", FindingRole::kCause},
                                              {"many_outliers", FindingRole::kConsequence, true},
                                              {"model_misfit", FindingRole::kCause},
                                              {"no_tilt", FindingRole::kOpenPoses},
                                              {"noise_excess", FindingRole::kConsequence, true},
                                              {"one_distance", FindingRole::kOpenPoses},
                                              {"one_pose", FindingRole::kOpenPoses},
                                              {"projection", FindingRole::kConsequence, true},
                                              {"scene_no_parallax", FindingRole::kCause},
                                              {"scene_no_scale", FindingRole::kCause},
                                              {"scene_no_turning", FindingRole::kCause},
                                              {"scene_one_depth", FindingRole::kCause},
                                              {"strong_distortion_pinhole", FindingRole::kCause}}};

}  // namespace

FindingCode FindCode(std::string_view code, std::span<const FindingCode> causes) {
  for (const std::span<const FindingCode> table : {causes, std::span<const FindingCode>(kCodes)}) {
    const auto found = std::ranges::find(table, code, &FindingCode::code);
    if (found != table.end()) return *found;
  }
  return {code,
          code.starts_with("target_") ? FindingRole::kTargetCause : FindingRole::kConsequence};
}

}  // namespace plenocal
