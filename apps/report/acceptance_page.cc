// SPDX-License-Identifier: Apache-2.0
#include "apps/report/acceptance_page.h"

#include "apps/report/page.h"
#include "engine/json/calibration_json.h"

namespace plenocal {

using Json = nlohmann::json;

std::string AcceptancePage(const Acceptance& acceptance) {
  Json lengths = Json::array();
  for (const AcceptedLength& each : acceptance.lengths) {
    lengths.push_back({{"line", each.reference->line},
                       {"of", each.reference->Of()},
                       {"frame", each.frame},
                       {"reference", Short(each.reference->length, 7)},
                       {"measured", Short(each.measured, 7)},
                       {"sigma", Short(std::hypot(each.sigma, each.reference->sigma), 3)},
                       {"deviation", Short(each.Deviation(), 3)},
                       {"limit", Short(each.limit, 3)}});
  }
  Json data = AcceptanceJson(acceptance);
  data.update({{"kind", "acceptance"}, {"measured", lengths}});
  PageText text;
  text.Box(acceptance.passes ? "good" : "bad", AcceptanceText(acceptance), {});
  return MakePage("Acceptance test", text, data);
}

}  // namespace plenocal
