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
#include "calib/base/statistics.h"
#include "calib/describe.h"
#include "calib/files/calibration_file.h"
#include "calib/judge/compare.h"
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

double MedianDistance(const Calibration& calibration, size_t camera) {
  std::vector<double> distances;
  const Bundle& bundle = calibration.bundle;
  for (const BundleObservation& observation : bundle.observations) {
    if (observation.camera != static_cast<int>(camera) || !observation.used) continue;
    const RigidTransform T_camera_target =
        bundle.cameras[camera].T_camera_rig *
        bundle.SeenPose(static_cast<size_t>(observation.frame), camera);
    distances.push_back(
        (T_camera_target * bundle.markers[static_cast<size_t>(observation.marker)].position)
            .norm());
  }
  return Median(std::move(distances));
}

std::string WhyNotComparable(const ModelTrial& trial) {
  if (!trial.failure.empty()) return trial.failure;
  if (trial.comparable) return {};
  return fmt::format("does not image {:.1f} % of the held-out points", 100 * trial.unseen);
}

TrialRow MakeRow(const ModelChoice& choice, size_t m) {
  const ModelTrial& trial = choice.trials[m];
  TrialRow row{.trial = &trial,
               .undetermined = {},
               .recommended = m == choice.recommended,
               .why_not = WhyNotComparable(trial)};
  if (!trial.failure.empty()) return row;
  for (const size_t c : choice.varied) {
    const double sigma =
        ImageSigma(DescribeCamera(trial.calibration, c), {MedianDistance(trial.calibration, c)});
    row.image_sigma += sigma * sigma / static_cast<double>(choice.varied.size());
  }
  row.image_sigma = std::sqrt(row.image_sigma);
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

std::string Recommendation(const ModelChoice& choice) {
  const ModelTrial& recommended = choice.trials[choice.recommended];
  const ModelTrial& best = choice.trials[0];
  const bool is_simplest = std::ranges::none_of(choice.trials, [&](const ModelTrial& trial) {
    return trial.comparable && trial.free_parameters < recommended.free_parameters;
  });
  std::string why = is_simplest ? "the best; none is simpler"
                                : "the best; every simpler model is significantly worse";
  if (choice.trials.size() == 1) {
    why = "the only model tried";
  } else if (std::ranges::count(choice.trials, true, &ModelTrial::comparable) == 1) {
    why = "the only model that images what the camera sees";
  } else if (choice.recommended != 0) {
    why = fmt::format("the simplest model that is not significantly worse than the best, {}",
                      best.model->name);
  }
  return fmt::format("{}, {} ({} parameters; {:.4f} +- {:.4f} px on frames that it has not seen)",
                     recommended.model->name,
                     why,
                     recommended.free_parameters,
                     recommended.rms,
                     recommended.rms_sigma);
}

// The table on standard output.
void Print(const ModelChoice& choice, const std::vector<TrialRow>& rows) {
  fmt::print("{} frames, {} folds; {} points count for all models, {} are outliers\n\n",
             choice.frames,
             choice.folds,
             choice.points,
             choice.outliers);
  fmt::print("  {:<18} {:>10} {:>19} {:>12} {:>14} {:>7}  {}\n",
             "model",
             "parameters",
             "held-out RMS px",
             "in-sample px",
             "image sigma px",
             "s",
             "not determined");
  for (const TrialRow& row : rows) {
    const ModelTrial& trial = *row.trial;
    if (!row.why_not.empty()) {
      fmt::print("  {:<18} {}\n", trial.model->name, row.why_not);
      continue;
    }
    fmt::print(
        "{} {:<18} {:>10} {:>19} {:>12.4f} {:>14.4f} {:>7.2f}  {}\n",
        row.recommended ? "*" : " ",
        trial.model->name,
        trial.free_parameters,
        fmt::format("{:.4f} +- {:.4f}", trial.rms, trial.rms_sigma),
        trial.in_sample_rms,
        row.image_sigma,
        trial.seconds,
        row.undetermined.empty() ? "-" : fmt::format("{}", fmt::join(row.undetermined, " ")));
  }
  fmt::print("\nrecommended: {}\n", Recommendation(choice));
}

std::string Quoted(const std::string& text) {
  std::string quoted = "\"";
  for (const char c : text) {
    if (c == '"') quoted += '"';
    quoted += c;
  }
  return quoted + "\"";
}

std::string TableCsv(const std::vector<TrialRow>& rows) {
  std::string text =
      "model,parameters,held_out_rms,held_out_sigma,probability,in_sample_rms,image_sigma,unseen,seconds,recommended,undetermined,failure\n";
  for (const TrialRow& row : rows) {
    const ModelTrial& trial = *row.trial;
    if (!trial.failure.empty()) {
      text += fmt::format("{},,,,,,,,,0,,{}\n", trial.model->name, Quoted(trial.failure));
      continue;
    }
    text += fmt::format(
        "{},{},{},{:.6g},{:.6g},{:.6g},{:.3f},{},{},\n",
        trial.model->name,
        trial.free_parameters,
        trial.comparable
            ? fmt::format("{:.6g},{:.3g},{:.3g}", trial.rms, trial.rms_sigma, trial.probability)
            : ",,",
        trial.in_sample_rms,
        row.image_sigma,
        trial.unseen,
        trial.seconds,
        row.recommended ? 1 : 0,
        fmt::join(row.undetermined, " "));
  }
  return text;
}

std::string TableYaml(const ModelChoice& choice,
                      const Session& session,
                      const std::vector<TrialRow>& rows) {
  std::vector<std::string> cameras;
  for (const size_t c : choice.varied) cameras.push_back(session.cameras[c].name);
  std::string text = fmt::format(
      "plenocal: 1\nsession: {}\ncameras: [{}]\nframes: {}\nfolds: {}\npoints: {}\n"
      "outliers: {}\nrecommended: {}\nwhy: {}\nmodels:\n",
      YamlQuoted(session.path.string()),
      fmt::join(cameras, ", "),
      choice.frames,
      choice.folds,
      choice.points,
      choice.outliers,
      choice.trials[choice.recommended].model->name,
      YamlQuoted(Recommendation(choice)));
  for (const TrialRow& row : rows) {
    const ModelTrial& trial = *row.trial;
    text += fmt::format("  {}:\n", trial.model->name);
    if (!trial.failure.empty()) {
      text += fmt::format("    failure: {}\n", YamlQuoted(trial.failure));
      continue;
    }
    text += fmt::format("    parameters: {}\n", trial.free_parameters);
    if (trial.comparable) {
      text += fmt::format("    held_out: {{rms: {}, sigma: {}, probability: {}}}\n",
                          YamlNumber(trial.rms),
                          YamlNumber(trial.rms_sigma),
                          YamlNumber(trial.probability));
    }
    text += fmt::format(
        "    unseen: {}\n    in_sample_rms: {}\n    image_sigma: {}\n    seconds: {:.3f}\n"
        "    undetermined: [{}]\n    calibration: models/{}/calibration.yaml\n",
        YamlNumber(trial.unseen),
        YamlNumber(trial.in_sample_rms),
        YamlNumber(row.image_sigma),
        trial.seconds,
        fmt::join(row.undetermined, ", "),
        trial.model->name);
  }
  return text;
}

void RunTry(const TryArguments& arguments, const ConsoleOptions& shared) {
  const Session session = OpenSession(arguments.session);
  const auto provenance = ProvenanceOf(shared, "try", session, arguments.out);
  const Target target = ReadTarget(session.target);
  const std::vector<size_t> varied = VariedCameras(session, arguments.camera);
  const std::vector<const CameraModel*> models =
      ModelsToTry(arguments.models, session.cameras[varied[0]]);
  RefuseToReplaceInputs(session, arguments.out, {"try.csv", "try.yaml", "try.html"});
  OutputFolder out(arguments.out);
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
  const ModelChoice choice = TryModels(input,
                                       varied,
                                       models,
                                       {.folds = arguments.folds,
                                        .threads = shared.threads,
                                        .progress = [&](const std::string& stage) {
                                          console.Progress(stage);
                                          return !Interrupted();
                                        }});
  std::vector<TrialRow> rows;
  for (size_t m = 0; m < choice.trials.size(); ++m) {
    rows.push_back(MakeRow(choice, m));
    const ModelTrial& trial = choice.trials[m];
    if (!trial.failure.empty()) continue;
    CalibrationRecord record = Describe(trial.calibration);
    record.provenance = provenance;
    out.Write(fmt::format("models/{}/calibration.yaml", trial.model->name),
              CalibrationYaml(record));
  }
  out.Write("try.csv", TableCsv(rows));
  out.Write("try.yaml", TableYaml(choice, session, rows));
  out.Write("try.html", TrialPage(choice, rows, Recommendation(choice)));
  WriteDetections(session, observations, arguments.out, &out);
  out.Commit();
  cache.RemoveUnused();
  Print(choice, rows);
  fmt::print("\nwritten to {}\n", arguments.out.string());
}

constexpr const char* kHelp =
    "Which camera model fits best: the cameras are calibrated with each model, which is judged by frames that were held out.\n"
    "\n"
    "  plenocal try session.yaml --models A,B,C -o OUT\n"
    "\n"
    "writes OUT/try.csv, try.yaml, try.html and models/<model>/calibration.yaml.";

RunCommand Declare(CLI::App* app, ConsoleOptions* shared) {
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

Command TryCommand() { return {"try", kHelp, Declare}; }

}  // namespace plenocal
