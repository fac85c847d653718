// SPDX-License-Identifier: Apache-2.0
#include "apps/report/accuracy_page.h"

#include "apps/report/page.h"
#include "engine/json/accuracy_json.h"

namespace plenocal {

using Json = nlohmann::json;

std::string AccuracyPage(const std::vector<RigAccuracy>& accuracies) {
  const Json accuracy = AccuracyJson(accuracies, true);
  Json sizes = Json::object();
  PageText text;
  for (size_t i = 0; i < accuracies.size(); ++i) {
    const RigAccuracy& each = accuracies[i];
    sizes[each.cameras[0]] = each.image_size;
    text.Heading(CamerasText(each.cameras));
    for (const AccuracyAtDistance& at : each.distances) text.Paragraph(AccuracyLine(each, at));
    text.Findings(accuracy.at(i).at("findings"));
  }
  return MakePage("Accuracy in space",
                  text,
                  {{"kind", "accuracy"}, {"accuracy", accuracy}, {"image_sizes", sizes}});
}

}  // namespace plenocal
