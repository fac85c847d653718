// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <memory>

#include "apps/cli/calibration_input.h"
#include "apps/cli/command.h"
#include "apps/cli/model_option.h"
#include "apps/cli/options.h"
#include "apps/cli/provenance.h"
#include "apps/cli/session/open_session.h"
#include "apps/cli/session_observations.h"
#include "apps/report/trial_page.h"
#include "calib/base/error.h"
#include "calib/base/number_text.h"
#include "calib/base/output_folder.h"
#include "calib/base/quoted_text.h"
#include "calib/describe.h"
#include "calib/files/calibration_file.h"
#include "calib/judge/model_trial.h"
#include "calib/noise/weak_directions.h"
#include "models/registry.h"

namespace plenocal {
namespace {

/// A session and the camera models to compare on it.
struct TryArguments {
  std::filesystem::path session;
  std::filesystem::path out;
  std::vector<std::string> models;  ///< empty: all that measure what the cameras measure
  std::string camera;               ///< the camera whose model is varied; empty: all of one type
  int folds = 5;                    ///< of the cross-validation
  bool fresh = false;               ///< ignore detections of earlier runs
};

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
    throw Error(ErrorKind::kInput,
                fmt::format("--camera {}: {} has no such camera{}",
                            name,
                            session.path.string(),
                            SuggestName(name, names)));
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

std::vector<const CameraModel*> ModelsToTry(const std::vector<std::string>& names,
                                            const SessionCamera& camera) {
  std::vector<const CameraModel*> models;
  for (const std::string& name : names) {
    const CameraModel* model = ModelOfOption("--models", name);
    if (!OfOneKind(*model, *camera.model)) {
      throw Error(ErrorKind::kInput,
                  fmt::format("--models {}: cannot take the place of {}, the model of '{}'; they "
                              "do not measure the same in an image",
                              name,
                              camera.model->name,
                              camera.name));
    }
    if (std::ranges::find(models, model) != models.end()) {
      throw Error(ErrorKind::kInput, fmt::format("--models {}: named twice", name));
    }
    models.push_back(model);
  }
  if (!names.empty()) return models;
  for (const CameraModel& model : CameraModels()) {
    if (OfOneKind(model, *camera.model)) models.push_back(&model);
  }
  return models;
}

void WarnOfSettings(const Session& session, const std::vector<size_t>& varied, Console* console) {
  for (const size_t c : varied) {
    const SessionCamera& camera = session.cameras[c];
    const bool any = !camera.rules.empty() ||
                     std::ranges::any_of(camera.initial, [](const auto& v) { return bool(v); });
    if (!any) continue;
    console->Message(
        fmt::format("{}: what the session says of parameters holds for {} alone; the other models "
                    "start without",
                    camera.name,
                    camera.model->name));
  }
}

std::string WhyNotComparable(const ModelTrial& trial) {
  if (!trial.failure.empty()) return trial.failure;
  if (trial.comparable) return {};
  return fmt::format("does not image {:.1f} % of the held-out points", 100 * trial.unseen);
}

std::string Judgement(const ModelChoice& choice, size_t m) {
  const ModelTrial& trial = choice.trials[m];
  if (m == choice.recommended) return "recommended";
  if (!trial.comparable) return {};
  if (trial.outweighed_by) {
    const std::string_view simpler = choice.trials[*trial.outweighed_by].model->name;
    if (!(trial.gain > 0)) return fmt::format("sigma grows without a gain over {}", simpler);
    return fmt::format(
        "sigma grows by more than its gain of {:.2g} px over {}", trial.gain, simpler);
  }
  if (m == choice.reference) return "best";
  if (trial.practically_equal) return "practically equal to the best";
  return trial.probability < kSignificant ? "worse than the best" : "not distinguishable";
}

TrialRow MakeRow(const ModelChoice& choice, size_t m) {
  const ModelTrial& trial = choice.trials[m];
  TrialRow row{.trial = &trial,
               .undetermined = {},
               .recommended = m == choice.recommended,
               .judgement = Judgement(choice, m),
               .why_not = WhyNotComparable(trial)};
  if (!trial.failure.empty()) return row;
  for (const WeakUnknowns& weak :
       FindWeakUnknowns(trial.calibration.bundle, trial.calibration.uncertainty)) {
    if (!weak.open) continue;
    for (const std::string& name : weak.names) {
      if (std::ranges::find(row.undetermined, name) == row.undetermined.end()) {
        row.undetermined.push_back(name);
      }
    }
  }
  return row;
}

std::vector<TrialRow> MakeRows(const ModelChoice& choice) {
  std::vector<TrialRow> rows;
  for (size_t m = 0; m < choice.trials.size(); ++m) rows.push_back(MakeRow(choice, m));
  return rows;
}

// The difference of the recommended from the reference, beside what it is compared with.
std::string DifferenceText(const ModelChoice& choice) {
  return fmt::format(
      "projections differ by {:.4f} px; the noise is {:.4f} px, the projection's "
      "sigma {:.4f} px",
      choice.trials[choice.recommended].difference,
      choice.noise,
      choice.trials[choice.reference].sigma);
}

// Why the reference is recommended.
std::string ReasonOfReference(const ModelChoice& choice) {
  const ModelTrial& recommended = choice.trials[choice.recommended];
  bool any_simpler = false, any_good = false;
  for (const ModelTrial& trial : choice.trials) {
    if (!trial.comparable || trial.free_parameters >= recommended.free_parameters) continue;
    any_simpler = true;
    any_good |= trial.practically_equal || trial.probability >= kSignificant;
  }
  return fmt::format("{}; {}",
                     choice.reference == 0 ? "the best" : "the best that is worth its uncertainty",
                     !any_simpler ? "none is simpler"
                     : any_good   ? "simpler ones are worse or of rarer use"
                                  : "every simpler model is significantly worse");
}

std::string Reason(const ModelChoice& choice) {
  const ModelTrial& recommended = choice.trials[choice.recommended];
  if (choice.trials.size() == 1) return "the only model tried";
  if (std::ranges::count(choice.trials, true, &ModelTrial::comparable) == 1) {
    return "the only model that images what the camera sees";
  }
  if (choice.recommended == choice.reference) return ReasonOfReference(choice);
  return fmt::format(
      "the simplest {}model that is {} the best, {} ({})",
      recommended.model->usage == Usage::kCommon ? "common " : "",
      recommended.practically_equal ? "practically equal to" : "not significantly worse than",
      choice.trials[choice.reference].model->name,
      DifferenceText(choice));
}

std::string Recommendation(const ModelChoice& choice) {
  constexpr size_t kFew = 10;  // frames: tests over fewer find little
  const ModelTrial& recommended = choice.trials[choice.recommended];
  return fmt::format("{}, {}{}; {}, {:.4f} +- {:.4f} px on frames that it has not seen",
                     recommended.model->name,
                     Reason(choice),
                     choice.frames < kFew ? "; but so few frames can hardly tell models apart" : "",
                     Counted(static_cast<size_t>(recommended.free_parameters), "parameter"),
                     recommended.rms,
                     recommended.rms_sigma);
}

// "held" or "refined", as in session and try.yaml.
std::string_view TargetName(const ModelTrial& trial) {
  return trial.marker_sigma > 0 ? "refined" : "held";
}

// `session_sigma`: the prior's standard deviation that the session gives the markers, 0: held.
std::string TargetRecommendation(const ModelChoice& targets, double session_sigma) {
  const ModelTrial& recommended = targets.trials[targets.recommended];
  const auto other = std::ranges::find_if(targets.trials, [&](const ModelTrial& trial) {
    return TargetName(trial) != TargetName(recommended);
  });
  if (!other->failure.empty() || !other->comparable) {
    return fmt::format("{}; {}, it cannot be judged", TargetName(recommended), TargetName(*other));
  }
  const std::string_view reason =
      recommended.marker_sigma > 0    ? "held rigid it predicts held-out frames worse"
      : other->outweighed_by          ? "to refine it gains less than it costs in uncertainty"
      : recommended.practically_equal ? "to refine it makes practically no difference"
                                      : "refined it predicts held-out frames no better";
  const bool refined = recommended.marker_sigma > 0;
  const std::string remedy =
      refined == (session_sigma > 0)
          ? ""
          : fmt::format("; the session's options lack refine_target: {}", refined);
  return fmt::format(
      "{}, {} ({:.4f} +- {:.4f} px, {} {:.4f} +- {:.4f} px; projections differ by {:.4f} px){}",
      TargetName(recommended),
      reason,
      recommended.rms,
      recommended.rms_sigma,
      TargetName(*other),
      other->rms,
      other->rms_sigma,
      std::max(recommended.difference, other->difference),
      remedy);
}

std::string HeldOutText(const ModelTrial& trial) {
  return fmt::format("{:.4f} +- {:.4f}", trial.rms, trial.rms_sigma);
}

std::string PixelText(double value) {
  constexpr double kMost = 1000;  // more is no image of this camera
  return value < kMost ? fmt::format("{:.4f}", value) : std::isinf(value) ? "inf" : "> 1000";
}

// The tables on standard output.
std::string Table(const ModelChoice& choice, const std::vector<TrialRow>& rows) {
  std::string text =
      fmt::format("{}, {}; {} count, {}\n\n  {:<18} {:>10} {:>19} {:>12} {:>8} {:>14} {:>7}  {}\n",
                  Counted(choice.frames, "frame"),
                  Counted(choice.folds, "fold"),
                  Counted(choice.points, "point"),
                  Counted(choice.outliers, "outlier"),
                  "model",
                  "parameters",
                  "held-out RMS px",
                  "from best px",
                  "sigma px",
                  "image sigma px",
                  "s",
                  "judgement");
  for (const TrialRow& row : rows) {
    const ModelTrial& trial = *row.trial;
    if (!row.why_not.empty()) {
      text += fmt::format("  {:<18} {}\n", trial.model->name, row.why_not);
      continue;
    }
    text += fmt::format("{} {:<18} {:>10} {:>19} {:>12} {:>8} {:>14} {:>7.2f}  {}\n",
                        row.recommended ? "*" : " ",
                        trial.model->name,
                        trial.free_parameters,
                        HeldOutText(trial),
                        PixelText(trial.difference),
                        PixelText(trial.sigma),
                        PixelText(trial.image_sigma),
                        trial.seconds,
                        row.judgement);
    if (row.undetermined.empty()) continue;
    text += fmt::format("    not determined: {}\n", fmt::join(row.undetermined, " "));
  }
  return text;
}

std::string QuotedField(const std::string& text) {
  std::string quoted = "\"";
  for (const char c : text) {
    if (c == '"') quoted += '"';
    quoted += c;
  }
  return quoted + "\"";
}

std::string TableCsv(const std::vector<TrialRow>& rows) {
  std::string text =
      "model,parameters,held_out_rms,held_out_sigma,probability,difference,sigma,in_sample_rms,image_sigma,unseen,recommended,judgement,undetermined,failure\n";
  for (const TrialRow& row : rows) {
    const ModelTrial& trial = *row.trial;
    if (!trial.failure.empty()) {
      text += fmt::format("{},,,,,,,,,,0,,,{}\n", trial.model->name, QuotedField(trial.failure));
      continue;
    }
    text += fmt::format("{},{},{},{:.6g},{},{:.6g},{},{},{},\n",
                        trial.model->name,
                        trial.free_parameters,
                        trial.comparable ? fmt::format("{:.6g},{:.3g},{:.3g},{:.3g},{:.3g}",
                                                       trial.rms,
                                                       trial.rms_sigma,
                                                       trial.probability,
                                                       trial.difference,
                                                       trial.sigma)
                                         : ",,,,",
                        trial.in_sample_rms,
                        trial.comparable ? fmt::format("{:.6g}", trial.image_sigma) : "",
                        trial.unseen,
                        row.recommended ? 1 : 0,
                        QuotedField(row.judgement),
                        fmt::join(row.undetermined, " "));
  }
  return text;
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
  for (const std::string& name : row.undetermined) undetermined.push_back(YamlText(name));
  std::string text = fmt::format("  {}:\n", trial.model->name);
  if (!trial.failure.empty()) {
    return text + fmt::format("    failure: {}\n", YamlQuoted(trial.failure));
  }
  text += fmt::format("    parameters: {}\n", trial.free_parameters);
  if (trial.comparable) {
    text += fmt::format(
        "    {}    difference: {}\n    sigma: {}\n    image_sigma: {}\n    judgement: {}\n",
        HeldOutYaml(trial),
        YamlNumber(trial.difference),
        YamlNumber(trial.sigma),
        YamlNumber(trial.image_sigma),
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

std::string TargetYaml(const ModelChoice& targets, double session_sigma) {
  std::string text = fmt::format("target:\n  recommended: {}\n  why: {}\n",
                                 TargetName(targets.trials[targets.recommended]),
                                 YamlQuoted(TargetRecommendation(targets, session_sigma)));
  for (const ModelTrial& trial : targets.trials) {
    if (!trial.comparable) continue;
    text += fmt::format("  {}:\n    tolerance: {}\n    {}    difference: {}\n    sigma: {}\n",
                        TargetName(trial),
                        YamlNumber(trial.marker_sigma),
                        HeldOutYaml(trial),
                        YamlNumber(trial.difference),
                        YamlNumber(trial.sigma));
  }
  return text;
}

/// All that a trial of a session found.
struct SessionTrial {
  const Session& session;
  double marker_sigma = 0;  ///< that the session gives the target, m
  ModelChoice models;
  ModelChoice targets;         ///< with the recommended model
  std::vector<TrialRow> rows;  ///< of `models`
};

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
      YamlQuoted(Recommendation(choice)),
      choice.trials[choice.reference].model->name,
      YamlNumber(choice.noise));
  text += TargetYaml(trial.targets, trial.marker_sigma) + "models:\n";
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
  out->Write("try.csv", TableCsv(trial.rows));
  out->Write("try.yaml", TrialYaml(trial));
  out->Write("try.html",
             TrialPage(trial.models,
                       trial.rows,
                       {Recommendation(trial.models),
                        TargetRecommendation(trial.targets, trial.marker_sigma)}));
}

void RunTry(const TryArguments& arguments, const ConsoleOptions& shared) {
  const Session session = OpenSession(arguments.session);
  RefuseSeveralTargets(session, "try");
  const auto provenance = ProvenanceOf(shared, "try", session, arguments.out);
  const Target target = ReadTarget(session.target);
  const std::vector<size_t> varied = VariedCameras(session, arguments.camera);
  const std::vector<const CameraModel*> models =
      ModelsToTry(arguments.models, session.cameras[varied[0]]);
  OutputFolder out(arguments.out);
  out.RefuseInputs({"try.csv", "try.yaml", "try.html"});
  Console console(shared);
  DetectionCache cache =
      OpenDetectionCache(arguments.out,
                         session,
                         arguments.fresh ? EarlierDetections::kIgnore : EarlierDetections::kReuse);
  const SessionObservations observations =
      CollectObservations(session, target, shared, {&cache, nullptr}, &console);
  WarnOfSettings(session, varied, &console);
  const CalibrationInput input =
      MakeCalibrationInput(session, target, observations.cameras, &console);
  const TrialOptions options{.folds = arguments.folds,
                             .threads = shared.threads,
                             .progress = [&](const std::string& stage) {
                               console.Progress(stage);
                               return !Interrupted();
                             }};
  SessionTrial trial{
      session, input.marker_sigma, TryModels(input, varied, models, options), {}, {}};
  trial.targets =
      TryTargets(WithModel(input, varied, *trial.models.trials[trial.models.recommended].model),
                 varied,
                 RefinedMarkerSigma(target),
                 options);
  trial.rows = MakeRows(trial.models);
  WriteTrial(trial, provenance, &out);
  WriteDetections(session, observations, arguments.out, &out);
  out.Commit();
  cache.RemoveUnused();
  console.Print(fmt::format("{}\nrecommended: {}\ntarget: {}\n\nwritten to {}\n",
                            Table(trial.models, trial.rows),
                            Recommendation(trial.models),
                            TargetRecommendation(trial.targets, trial.marker_sigma),
                            arguments.out.string()));
}

constexpr const char* kTryHelp =
    "Which camera model fits best: the cameras are calibrated with each model, which is judged by frames that were held out; the target likewise, held rigid and refined.\n"
    "\n"
    "  plenocal try session.yaml --models A,B,C -o OUT\n"
    "\n"
    "writes OUT/try.csv, try.yaml, try.html and models/<model>/calibration.yaml.";

RunCommand DeclareTry(CLI::App* app, ConsoleOptions* shared) {
  const auto arguments = std::make_shared<TryArguments>();
  app->add_option("session", arguments->session, "session.yaml: cameras, images, target")
      ->required();
  app->add_option("--models",
                  arguments->models,
                  "camera models, separated by commas (default: all of the cameras' kind)")
      ->delimiter(',');
  app->add_option("--camera",
                  arguments->camera,
                  "of a rig: whose model is varied (default: all ordinary cameras)");
  app->add_option("--folds", arguments->folds, "parts of the frames that are held out in turn")
      ->check(CLI::Range(2, 1000))
      ->capture_default_str();
  app->add_option("-o,--out", arguments->out, "folder for the results")->required();
  AddThreads(app, shared);
  AddQuiet(app, shared);
  app->add_flag("--fresh", arguments->fresh, "detect again in all images");
  return [arguments, shared] { RunTry(*arguments, *shared); };
}

}  // namespace

Command TryCommand() { return {"try", kTryHelp, DeclareTry}; }

}  // namespace plenocal
