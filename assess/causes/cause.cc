// SPDX-License-Identifier: Apache-2.0
#include "assess/causes/cause.h"

namespace plenocal {

std::vector<Finding> FindCauses(CauseStage stage, const CauseEvidence& evidence) {
  std::vector<Finding> findings;
  for (const Cause& cause : Causes()) {
    if (cause.stage == stage) Append(cause.find(evidence), &findings);
  }
  if (evidence.name.empty()) return findings;
  for (Finding& finding : findings) {
    finding.cameras = {evidence.name};
    finding.what.insert(0, evidence.name + ": ");
  }
  return findings;
}

}  // namespace plenocal
