// SPDX-License-Identifier: Apache-2.0
#include "apps/report/trial_page.h"

#include <fmt/format.h>

#include <cmath>
#include <utility>

#include "apps/report/page.h"
#include "engine/json/calibration_json.h"

namespace plenocal {
namespace {

using Json = nlohmann::json;

// Means of the residuals of one camera's held-out points over its image.
Json HeldOutField(const ModelTrial& trial, size_t camera, ImageSize image_size) {
  std::vector<ResidualRow> residuals;
  for (const HeldOutPoint& point : trial.held_out) {
    if (point.camera != camera) continue;
    residuals.push_back(
        {.values = point.seen.values, .residual = {point.residual[0], point.residual[1]}});
  }
  return FieldJson(image_size, std::move(residuals));
}

Json RowJson(const TrialRow& row) {
  const ModelTrial& trial = *row.trial;
  Json json = {{"model", trial.model->name},
               {"why_not", row.why_not},
               {"recommended", row.recommended},
               {"judgement", row.judgement},
               {"undetermined", trial.undetermined}};
  if (!row.why_not.empty()) return json;
  json.update({{"parameters", trial.free_parameters},
               {"rms", trial.rms},
               {"rms_sigma", trial.rms_sigma},
               {"probability", trial.probability},
               {"in_sample_rms", trial.in_sample_rms},
               {"difference", Short(trial.difference)},
               {"sigma", Short(trial.sigma)},
               {"projection", Short(trial.projection)}});
  return json;
}

Json StressJson(const StressTest& test) {
  Json json = {{"camera", test.camera},
               {"what", test.what},
               {"failure", test.failure},
               {"fails", test.Fails()}};
  if (!test.failure.empty()) return json;
  json.update({{"probability", test.probability},
               {"difference", test.difference},
               {"predicted", test.predicted},
               {"factor", test.factor}});
  return json;
}

void AddStress(Json tests, PageText* text) {
  if (tests.empty()) return;
  std::vector<std::vector<std::string>> cells;
  for (Json& test : tests) {
    const std::string failure = test["failure"];
    cells.push_back({fmt::format("{}, {}", std::string(test["camera"]), std::string(test["what"])),
                     !failure.empty() ? failure
                     : test["fails"]  ? "differs"
                                      : "agrees"});
    for (const char* key : {"probability", "difference", "predicted", "factor"}) {
      cells.back().push_back(BriefNumber(test[key], 3));
    }
  }
  text->Table("calibrations from a part of the points against the other points",
              {"", "", "P(by chance)", "difference, px", "predicted, px", "factor"},
              cells);
}

PageText TextOf(const std::vector<TrialRow>& rows,
                const std::string& model,
                const std::string& target,
                const std::string& evidence) {
  PageText text;
  text.Box(
      "good", fmt::format("Recommended: {}", model), {fmt::format("Target: {}", target), evidence});
  std::vector<std::vector<std::string>> cells;
  for (const TrialRow& row : rows) {
    const ModelTrial& trial = *row.trial;
    const bool has_score = row.why_not.empty();
    const Json rms = has_score ? Json(trial.rms) : Json(),
               sigma = has_score ? Json(trial.rms_sigma) : Json();
    cells.push_back({std::string(trial.model->name),
                     has_score ? row.judgement : row.why_not,
                     BriefNumber(rms, 4),
                     BriefNumber(sigma, 2)});
  }
  text.Table("each model on held-out frames",
             {"", "judgement", "held-out RMS, px", "standard error"},
             cells);
  return text;
}

}  // namespace

std::string TrialPage(const SessionTrial& trial) {
  const ModelChoice& choice = trial.models;
  const std::vector<TrialRow>& rows = trial.rows;
  const std::string model = ModelRecommendation(choice);
  const std::string target = TargetRecommendation(trial.targets, trial.marker_freedom);
  const std::string evidence =
      ConfidenceText(choice) + MissingText(trial.missing) + StressReading(trial.stress);
  Json models = Json::array(), cameras = Json::array(), stress = Json::array();
  for (const TrialRow& row : rows) models.push_back(RowJson(row));
  for (const StressTest& test : trial.stress) stress.push_back(StressJson(test));
  const Bundle& any = rows[choice.recommended].trial->calibration.bundle;
  for (const size_t c : choice.varied) {
    Json fields = Json::array();
    for (const TrialRow& row : rows) {
      if (row.why_not.empty()) {
        fields.push_back({{"model", row.trial->model->name},
                          {"field", HeldOutField(*row.trial, c, any.cameras[c].image_size)}});
      }
    }
    cameras.push_back({{"name", any.cameras[c].name},
                       {"image_size", any.cameras[c].image_size},
                       {"fields", fields}});
  }
  const Json data{{"kind", "trial"},
                  {"recommendation", model},
                  {"target", target},
                  {"evidence", evidence},
                  {"frames", choice.frames},
                  {"folds", choice.folds},
                  {"points", choice.points},
                  {"outliers", choice.outliers},
                  {"models", models},
                  {"stress", stress},
                  {"cameras", cameras}};
  PageText text = TextOf(rows, model, target, evidence);
  AddStress(stress, &text);
  return MakePage("Camera models compared", text, data);
}

}  // namespace plenocal
