// SPDX-License-Identifier: Apache-2.0
#include "calib/adjust/solver/adjust.h"

#include "calib/adjust/all_unknowns/minimise.h"
#include "calib/adjust/layout.h"
#include "calib/adjust/reduced/minimise.h"

namespace plenocal {

std::string_view ReasonForAllUnknowns(const Bundle& bundle) {
  if (bundle.HasLandmarks()) return "few landmarks are seen in a frame, so that blocks are sparse";
  if (internal::EstimatesLocalModel(bundle)) {
    return "a point depends on few of its camera's parameters, so that blocks are sparse";
  }
  if (internal::MakeLayout(bundle).head == 0) return "frames have no unknowns in common";
  return {};
}

AdjustSummary Adjust(Bundle* bundle, const AdjustOptions& options) {
  return ReasonForAllUnknowns(*bundle).empty() ? internal::MinimiseReduced(options, bundle)
                                               : internal::MinimiseAllUnknowns(options, bundle);
}

}  // namespace plenocal
