// SPDX-License-Identifier: Apache-2.0
#include "engine/try_session.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <iterator>

#include "calib/base/format_error.h"
#include "calib/base/number_limits.h"
#include "calib/base/number_text.h"
#include "calib/base/quoted_text.h"
#include "calib/estimate/describe.h"
#include "calib/files/calibration_file.h"
#include "calib/io/input_file.h"
#include "engine/observe/session_observations.h"
#include "engine/session/calibration_input.h"
#include "engine/session/open_session.h"
#include "engine/session/run_provenance.h"
#include "models/registry.h"

namespace plenocal {
namespace {

// The cameras whose model is varied: the one named, else all ordinary ones, else all plenoptic
// ones.
std::vector<size_t> VariedCameras(const Session& session, const std::string& name) {
  std::vector<size_t> varied;
  if (!name.empty()) {
    std::vector<std::string_view> names;
    for (size_t c = 0; c < session.cameras.size(); ++c) {
      if (session.cameras[c].name == name) return {c};
      names.push_back(session.cameras[c].name);
    }
    throw InputError("--camera {}: {} has no such camera{}",
                     name,
                     session.path.string(),
                     SuggestName(name, names));
  }
  const auto ordinary = std::ranges::find_if(
      session.cameras, [](const SessionCamera& camera) { return camera.model->context.empty(); });
  const CameraModel& kind =
      *(ordinary != session.cameras.end() ? *ordinary : session.cameras.front()).model;
  for (size_t c = 0; c < session.cameras.size(); ++c) {
    if (OfOneKind(*session.cameras[c].model, kind)) varied.push_back(c);
  }
  return varied;
}

// Splines of more and more knots (of order 3), whose full cells are square in the image, as far as
// they have fewer coefficients than half of the points' coordinates.
std::vector<std::string> KnotLadder(const CameraInput& input) {
  const int width = input.image_size[0], height = input.image_size[1];
  const bool wide = width >= height;
  const double aspect =
      wide ? static_cast<double>(height) / width : static_cast<double>(width) / height;
  size_t points = 0;
  for (const View& view : input.views) points += view.observations.size();
  std::vector<std::string> names;
  for (const int along : {7, 9, 11, 15, 20, 30}) {
    const int across = 3 + std::max(1, static_cast<int>(std::lround((along - 3) * aspect)));
    if (!names.empty() && static_cast<size_t>(2 * along * across) > points) break;
    names.push_back(fmt::format("splined-{}x{}", wide ? along : across, wide ? across : along));
  }
  return names;
}

std::vector<const CameraModel*> ModelsToTry(const std::vector<std::string>& requested,
                                            const SessionCamera& camera,
                                            const CameraInput& input) {
  std::vector<std::string> names;
  for (const std::string& name : requested) {
    if (name == "splined-all") {
      std::ranges::move(KnotLadder(input), std::back_inserter(names));
    } else {
      names.push_back(name);
    }
  }
  std::vector<const CameraModel*> models;
  for (const std::string& name : names) {
    const CameraModel* model = ModelNamed("--models", name);
    if (!OfOneKind(*model, *camera.model)) {
      throw InputError(
          "--models {}: cannot take the place of {}, the model of '{}'; they "
          "do not measure the same in an image",
          name,
          camera.model->name,
          camera.name);
    }
    if (std::ranges::find(models, model) != models.end()) {
      throw InputError("--models {}: named twice", name);
    }
    models.push_back(model);
  }
  if (!names.empty()) return models;
  for (const CameraModel& model : CameraModels()) {
    if (OfOneKind(model, *camera.model)) models.push_back(&model);
  }
  return models;
}

void WarnOfSettings(const Session& session, const std::vector<size_t>& varied, const Run& run) {
  for (const size_t c : varied) {
    const SessionCamera& camera = session.cameras[c];
    const bool any = !camera.rules.empty() ||
                     std::ranges::any_of(camera.initial, [](const auto& v) { return bool(v); });
    if (!any) continue;
    run.Message(fmt::format(
        "{}: what the session states about parameters holds for {} alone; the other models "
        "start without",
        camera.name,
        camera.model->name));
  }
}

std::string HeldOutYaml(const ModelTrial& trial) {
  return fmt::format("held_out: {{rms: {}, sigma: {}, probability: {}}}\n",
                     YamlNumber(trial.rms),
                     YamlNumber(trial.rms_sigma),
                     YamlNumber(trial.probability));
}

std::string ModelYaml(const TrialRow& row) {
  const ModelTrial& trial = *row.trial;
  std::vector<std::string> undetermined;
  for (const std::string& name : trial.undetermined) undetermined.push_back(YamlText(name));
  std::string text = fmt::format("  {}:\n", trial.model->name);
  if (!trial.failure.empty()) {
    return text + fmt::format("    failure: {}\n", YamlQuoted(trial.failure));
  }
  text += fmt::format("    parameters: {}\n", trial.free_parameters);
  if (trial.comparable) {
    text += fmt::format(
        "    {}    difference: {}\n    sigma: {}\n    image_sigma: {}\n    projection: {}\n    judgement: {}\n",
        HeldOutYaml(trial),
        YamlNumber(trial.difference),
        YamlNumber(trial.sigma),
        YamlNumber(trial.image_sigma),
        YamlNumber(trial.projection),
        YamlQuoted(row.judgement));
  }
  return text + fmt::format(
                    "    unseen: {}\n    in_sample_rms: {}\n"
                    "    undetermined: [{}]\n    calibration: models/{}/calibration.yaml\n",
                    YamlNumber(trial.unseen),
                    YamlNumber(trial.in_sample_rms),
                    fmt::join(undetermined, ", "),
                    trial.model->name);
}

std::string MissingYaml(const std::vector<MissingFamily>& missing) {
  std::string text = missing.empty() ? "missing: []\n" : "missing:\n";
  for (const MissingFamily& each : missing) {
    text += fmt::format(
        "  - {{camera: {}, family: {}, probability: {}, gain: {}, degrees: {}, remedy: {}}}\n",
        YamlText(each.camera),
        each.family,
        YamlNumber(each.probability),
        YamlNumber(each.gain),
        each.degrees,
        YamlQuoted(each.remedy));
  }
  return text;
}

std::string StressYaml(const std::vector<StressTest>& stress) {
  std::string text = stress.empty() ? "" : "stress:\n";
  for (const StressTest& each : stress) {
    text += fmt::format("  - {{camera: {}, test: {}, what: {}, ",
                        YamlText(each.camera),
                        StressKindName(each.kind),
                        each.what);
    text += each.failure.empty()
                ? fmt::format("probability: {}, difference: {}, predicted: {}, factor: {}}}\n",
                              YamlNumber(each.probability),
                              YamlNumber(each.difference),
                              YamlNumber(each.predicted),
                              YamlNumber(each.factor))
                : fmt::format("failure: {}}}\n", YamlQuoted(each.failure));
  }
  return text;
}

std::string TargetYaml(const ModelChoice& targets, MarkerFreedom of_session) {
  std::string text = fmt::format("target:\n  recommended: {}\n  why: {}\n",
                                 TargetName(targets.trials[targets.recommended]),
                                 YamlQuoted(TargetRecommendation(targets, of_session)));
  for (const ModelTrial& trial : targets.trials) {
    if (!trial.comparable) continue;
    text += fmt::format("  {}:\n    tolerance: {}\n    {}    difference: {}\n    sigma: {}\n",
                        TargetName(trial),
                        YamlNumber(trial.marker_freedom.Sigma()),
                        HeldOutYaml(trial),
                        YamlNumber(trial.difference),
                        YamlNumber(trial.sigma));
  }
  return text;
}

std::string TrialYaml(const SessionTrial& trial) {
  const ModelChoice& choice = trial.models;
  std::vector<std::string> cameras;
  for (const size_t c : choice.varied) {
    cameras.push_back(YamlText(trial.session.cameras[c].name));
  }
  std::string text = fmt::format(
      "plenocal: 1\nsession: {}\ncameras: [{}]\nframes: {}\nfolds: {}\npoints: {}\n"
      "outliers: {}\nrecommended: {}\nwhy: {}\nreference: {}\nnoise: {}\n",
      YamlQuoted(trial.session.path.string()),
      fmt::join(cameras, ", "),
      choice.frames,
      choice.folds,
      choice.points,
      choice.outliers,
      choice.trials[choice.recommended].model->name,
      YamlQuoted(ModelRecommendation(choice)),
      choice.trials[choice.reference].model->name,
      YamlNumber(choice.noise));
  std::vector<std::string_view> among;
  for (const size_t m : choice.confidence_set) among.push_back(choice.trials[m].model->name);
  text += fmt::format("confidence_set: [{}]\n", fmt::join(among, ", "));
  text += MissingYaml(trial.missing) + StressYaml(trial.stress);
  text += TargetYaml(trial.targets, trial.marker_freedom) + "models:\n";
  for (const TrialRow& row : trial.rows) text += ModelYaml(row);
  return text;
}

void WriteTrial(const SessionTrial& trial,
                const std::vector<std::pair<std::string, std::string>>& provenance,
                OutputFolder* out) {
  for (const ModelTrial& model : trial.models.trials) {
    if (!model.failure.empty()) continue;
    CalibrationRecord record = Describe(model.calibration);
    record.provenance = provenance;
    out->Write(fmt::format("models/{}/calibration.yaml", model.model->name),
               CalibrationYaml(record));
  }
  out->Write("try.csv", TrialCsv(trial.rows));
  out->Write("try.yaml", TrialYaml(trial));
}

}  // namespace

SessionTrial TrySession(const Session& given, const TryRequest& request, const Run& run) {
  const RunScope inputs;
  SessionTrial trial;
  RequireWithin("folds", request.folds, 2, 1000);
  trial.session = given;
  const Session& session = trial.session;
  RefuseSeveralTargets(session, "try");
  const auto provenance = ProvenanceOf(request.command, session, request.out);
  const Target target = ReadTarget(session.target);
  const std::vector<size_t> varied = VariedCameras(session, request.camera);
  const auto models_for = [&](const CameraInput& camera) {
    return ModelsToTry(request.models, session.cameras[varied[0]], camera);
  };
  CameraInput without_images;
  without_images.image_size = {4, 3};
  models_for(without_images);  // a wrong name ends the run before the images are read
  trial.folders = std::make_unique<RunFolders>(
      request, session, std::vector<std::string>{"try.csv", "try.yaml", "try.html"});
  const SessionObservations observations =
      CollectObservations(session, target, run, {trial.folders->cache(), nullptr});
  WarnOfSettings(session, varied, run);
  const CalibrationInput input = MakeCalibrationInput(session, target, observations.cameras, run);
  const TrialOptions options{.folds = request.folds,
                             .threads = run.threads,
                             .progress = [&](const std::string& stage, size_t done, size_t total) {
                               return run.Progress(stage, done, total);
                             }};
  const bool is_open = session.auto_refine && !target.tolerance;
  ModelAndTarget tried =
      TryModelsAndTarget(input,
                         varied,
                         models_for(input.cameras[varied[0]]),
                         RefinedMarkerFreedom(target),
                         is_open ? TargetQuestion::kChoose : TargetQuestion::kJudge,
                         options);
  trial.models = std::move(tried.models);
  trial.targets = std::move(tried.targets);
  trial.marker_freedom = trial.models.trials[trial.models.recommended].marker_freedom;
  trial.rows = MakeRows(trial.models);
  const Calibration& recommended = trial.models.trials[trial.models.recommended].calibration;
  for (const size_t c : trial.models.varied) {
    std::ranges::move(FindMissingFamilies(recommended, c), std::back_inserter(trial.missing));
  }
  if (request.stress) {
    trial.stress = TestStress(recommended,
                              trial.models.varied,
                              {.loss = input.loss, .threads = run.threads, .go_on = [&] {
                                 return run.Progress("stress tests");
                               }});
  }
  if (OutputFolder* const out = trial.folders->out()) {
    WriteTrial(trial, provenance, out);
    WriteDetections(session, observations, request.out, out);
  }
  return trial;
}

}  // namespace plenocal
