// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <fmt/format.h>

#include <string>
#include <string_view>

#include "apps/simulate/simulate.h"
#include "calib/files/calibration_record.h"

namespace plenocal::simulate {

inline constexpr std::string_view kTrueParameters = "the parameters are true, not estimated";

/// How a file of a simulation was made; `what` it holds, in words.
inline Provenance SimulationProvenance(const SimulateRequest& request,
                                       const std::string& program,
                                       std::string_view what) {
  return {{"plenocal_version", PLENOCAL_VERSION},
          {"command",
           fmt::format("{} simulate {} -o {}{}",
                       program,
                       request.spec.string(),
                       request.out.string(),
                       request.points ? " --points" : "")},
          {"simulation", std::string(what)}};
}

}  // namespace plenocal::simulate
