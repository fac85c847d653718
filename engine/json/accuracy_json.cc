// SPDX-License-Identifier: Apache-2.0
#include "engine/json/accuracy_json.h"

#include <fmt/format.h>

#include <cmath>

#include "engine/json/calibration_json.h"

namespace plenocal {
namespace {

using Json = nlohmann::json;

Json OptionalJson(const std::optional<double>& value) { return value ? Short(*value) : Json(); }

Json BudgetJson(const ErrorBudget& median, double sigma, double worst) {
  return {{"median", Short(sigma)},
          {"worst", Short(worst)},
          {"noise", Short(median.noise)},
          {"calibration", Short(median.calibration)},
          {"scale", Short(median.scale)},
          {"jitter", Short(median.jitter)}};
}

Json MapJson(const RigAccuracy& accuracy, const AccuracyAtDistance& at) {
  std::vector<Json> sigma(accuracy.grid.Cells());
  for (const AccuracyCell& cell : at.cells) {
    sigma[cell.cell] = Short((accuracy.has_depth ? cell.z : cell.lateral).Sigma(), 3);
  }
  return {{"columns", accuracy.grid.Columns()}, {"rows", accuracy.grid.Rows()}, {"sigma", sigma}};
}

Json DistanceJson(const RigAccuracy& accuracy, const AccuracyAtDistance& at, bool with_maps) {
  Json if_known = Json::object();
  for (size_t i = 0; i < at.z_if_known.size(); ++i) {
    if_known[accuracy.known[i]] = Short(at.z_if_known[i]);
  }
  Json json{{"distance", at.distance},
            {"seen_at", OptionalJson(at.seen_at)},
            {"cells", at.cells.size()},
            {"z", accuracy.has_depth ? BudgetJson(at.z, at.sigma_z, at.worst_z) : Json()},
            {"lateral", BudgetJson(at.lateral, at.sigma_lateral, at.worst_lateral)},
            {"bar_across", OptionalJson(at.across)},
            {"bar_along", OptionalJson(at.along)},
            {"if_known", if_known}};
  if (with_maps) json["map"] = MapJson(accuracy, at);
  return json;
}

}  // namespace

Json AccuracyJson(std::span<const RigAccuracy> accuracies, bool with_maps) {
  Json json = Json::array();
  for (const RigAccuracy& accuracy : accuracies) {
    Json noise = Json::object(), distances = Json::array();
    for (size_t c = 0; c < accuracy.cameras.size(); ++c) {
      noise[accuracy.cameras[c]] = Short(accuracy.noise[c]);
    }
    for (const AccuracyAtDistance& at : accuracy.distances) {
      distances.push_back(DistanceJson(accuracy, at, with_maps));
    }
    json.push_back({{"cameras", accuracy.cameras},
                    {"noise", noise},
                    {"bar", accuracy.bar},
                    {"distances", distances},
                    {"limits",
                     {{"calibration_equals_noise", OptionalJson(accuracy.calibration_equals_noise)},
                      {"relative_1_percent", OptionalJson(accuracy.relative_1_percent)},
                      {"beyond", OptionalJson(accuracy.beyond)}}},
                    {"open", accuracy.open},
                    {"findings", VerdictJson({Grade::kGood, accuracy.findings}).at("findings")}});
  }
  return json;
}

std::string AccuracyLine(const RigAccuracy& accuracy, const AccuracyAtDistance& at) {
  const std::string place =
      fmt::format("{} at {:.3g} m: ", CamerasText(accuracy.cameras), at.distance);
  if (at.cells.empty()) return place + "not in the image of all";
  const ErrorBudget& budget = accuracy.has_depth ? at.z : at.lateral;
  std::string text =
      fmt::format("{}{} {} mm (noise {}, calibration {}",
                  place,
                  accuracy.has_depth ? "z" : "x, y",
                  MillimetresText(accuracy.has_depth ? at.sigma_z : at.sigma_lateral),
                  MillimetresText(budget.noise),
                  MillimetresText(budget.calibration));
  if (budget.scale > 0) text += fmt::format(", scale {}", MillimetresText(budget.scale));
  if (budget.jitter > 0) text += fmt::format(", jitter {}", MillimetresText(budget.jitter));
  text += ")";
  if (at.across) {
    text += fmt::format(
        "; a length of {:.4g} mm across {} mm", 1e3 * accuracy.bar, MillimetresText(*at.across));
  }
  return text;
}

}  // namespace plenocal
