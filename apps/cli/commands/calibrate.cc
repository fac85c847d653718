// SPDX-License-Identifier: Apache-2.0
#include "calib/calibrate.h"

#include <fmt/format.h>
#include <malloc.h>

#include <cmath>
#include <cstdio>
#include <map>
#include <memory>
#include <optional>
#include <utility>

#include "apps/cli/calibration_input.h"
#include "apps/cli/command.h"
#include "apps/cli/model_option.h"
#include "apps/cli/options.h"
#include "apps/cli/provenance.h"
#include "apps/cli/session/auto_model.h"
#include "apps/cli/session/earlier_session.h"
#include "apps/cli/session/image_session.h"
#include "apps/cli/session/left_out.h"
#include "apps/cli/session/open_session.h"
#include "apps/cli/session/scene_images.h"
#include "apps/cli/session/scene_session.h"
#include "apps/cli/session/session_targets.h"
#include "apps/cli/session_observations.h"
#include "apps/recording/stores/image_lister.h"
#include "apps/report/report.h"
#include "apps/report/verdict_json.h"
#include "calib/base/error.h"
#include "calib/base/output_folder.h"
#include "calib/describe.h"
#include "calib/files/calibration_file.h"
#include "calib/files/calibration_tables.h"
#include "calib/files/exclusion.h"
#include "calib/files/frame_images.h"
#include "calib/judge/causes/diagnose.h"
#include "calib/judge/target/target_causes.h"
#include "calib/judge/verdict.h"
#include "calib/summary.h"
#include "models/registry.h"

namespace plenocal {
namespace {

struct CalibrateArguments : SessionOptions {
  std::vector<std::string> inputs;  ///< session.yaml, or the images of one camera
  ImageArguments images;            ///< without the images of `inputs`
  std::string model = "auto";       ///< of images
  bool jackknife = false;           ///< standard errors from leaving out frames beside the others
  bool report = true;               ///< write report.html
  bool json = false;                ///< the result on standard output as JSON
  std::string require;              ///< name of the lowest grade that is no failure; empty: any
};

std::string RefinedTarget(const Target& target, const CalibrationRecord& calibration) {
  std::map<int, Eigen::Vector3d> positions, sigmas;
  for (const auto& [number, marker] : calibration.markers) {
    positions[number] = marker.position;
    if (marker.sigma) sigmas[number] = *marker.sigma;
  }
  return RefinedTargetYaml(target, positions, sigmas);
}

Calibration Solve(const CalibrationInput& input,
                  const CalibrateArguments& arguments,
                  int threads,
                  Console* console) {
  Calibration calibration =
      Calibrate(input, {.threads = threads, .progress = [&](const std::string& stage) {
                          console->Progress(stage);
                          return !Interrupted();
                        }});
  if (arguments.jackknife) {
    calibration.jackknife = EstimateByJackknife(
        calibration.bundle,
        {.loss = input.loss, .threads = threads, .progress = [&](size_t done, size_t all) {
           console->Progress("jackknife", done, all);
           return !Interrupted();
         }});
  }
  for (const std::string& line : GroupedByReason(calibration.left_out)) {
    console->Message("  " + line);
  }
  return calibration;
}

// The calibration and what is wrong with the target. Where the calibration fails, the message of
// the error has the causes.
std::pair<Calibration, std::vector<Finding>> SolveWithCauses(const CalibrationInput& input,
                                                             const Target& target,
                                                             const CalibrateArguments& arguments,
                                                             int threads,
                                                             Console* console) {
  const auto find = [&](const Calibration* calibration) {
    console->Progress("causes in the target");
    return FindTargetCauses(input, DoubtsAbout(target), calibration);
  };
  try {
    Calibration calibration = Solve(input, arguments, threads, console);
    std::vector<Finding> causes = find(&calibration);
    return {std::move(calibration), std::move(causes)};
  } catch (const Error& error) {
    if (error.kind() != ErrorKind::kJob) throw;
    const std::vector<Finding> causes = find(nullptr);
    if (causes.empty()) throw;
    throw Error(ErrorKind::kJob,
                fmt::format("{}; the cause is in the target ({}): {}; {}",
                            error.what(),
                            causes.front().code,
                            causes.front().what,
                            causes.front().remedy));
  }
}

void AddLeftOut(const SessionObservations& observations, Calibration* calibration) {
  calibration->left_out.insert(
      calibration->left_out.begin(), observations.left_out.begin(), observations.left_out.end());
}

// The result with the files of the cameras.
CalibrationRecord DescribeAll(const Calibration& calibration,
                              const SessionObservations& observations) {
  CalibrationRecord record = Describe(calibration);
  for (const CameraFile& file : observations.files) {
    for (const auto& [key, member] : kCameraTextKeys) {
      if (file.key == key) record.cameras[file.camera].*member = file.name;
    }
  }
  for (size_t c = 0; c < record.cameras.size(); ++c) {
    CalibratedCamera& camera = record.cameras[c];
    camera.sample_frame = observations.sample_frames[c];
    if (const auto geometry = MicroLensGeometryOf(camera)) {
      camera.lens_type_optics = EstimateLensTypes(observations.blurs[c], *geometry);
    }
  }
  return record;
}

// All but the target or the scene points.
void WriteResult(const CalibrationRecord& record, OutputFolder* out) {
  out->Write("calibration.yaml", CalibrationYaml(record));
  out->Write("poses.csv", PosesCsv(record));
  if (record.cameras.size() > 1) out->Write("view_poses.csv", ViewPosesCsv(record));
  out->Write("residuals.csv", ResidualsCsv(record));
  out->Write("correlations.csv", CorrelationsCsv(record.correlations));
}

void WriteReport(const CalibrationRecord& record,
                 const CameraFiles& files,
                 Console* console,
                 OutputFolder* out) {
  console->Progress("report");
  std::string html;
  // A calibration is not lost because its report fails.
  try {
    html = ReportHtml(record, files);
  } catch (const Error& error) {
    console->Message(fmt::format("report.html was not written: {}", error.what()));
    return;
  }
  out->Write("report.html", html);
}

nlohmann::json ResultJson(const CalibrateArguments& arguments, const CalibrationRecord& record) {
  nlohmann::json cameras = nlohmann::json::object();
  for (const CalibratedCamera& camera : record.cameras) {
    nlohmann::json parameters = nlohmann::json::object(), sigma = nlohmann::json::object();
    for (size_t k = 0; k < camera.params.size(); ++k) {
      const std::string name(camera.model->params[k].name);
      parameters[name] = camera.params[k];
      sigma[name] = std::isfinite(camera.Sigma(k)) ? nlohmann::json(camera.Sigma(k)) : nullptr;
    }
    cameras[camera.name] = {{"model", camera.model->name},
                            {"image_size", camera.image_size},
                            {"parameters", parameters},
                            {"sigma", sigma},
                            {"rms", camera.fit.rms},
                            {"points", camera.fit.points},
                            {"rejected", camera.fit.rejected},
                            {"views", camera.fit.views}};
  }
  return {{"verdict", VerdictJson(*record.verdict)},
          {"cameras", cameras},
          {"frames", record.frames.size()},
          {"output", arguments.out.string()}};
}

void Print(const CalibrateArguments& arguments,
           const Calibration& calibration,
           const CalibrationRecord& record,
           Console* console) {
  if (arguments.json) {
    using Json = nlohmann::json;
    const Json result = ResultJson(arguments, record);
    // Paths may be no UTF-8.
    fmt::print("{}\n", result.dump(2, ' ', false, Json::error_handler_t::replace));
    return;
  }
  console->Print(fmt::format("{}\nwritten to {}\n\n{}",
                             Summary(calibration),
                             arguments.out.string(),
                             VerdictText(*record.verdict)));
}

void CheckRequirement(const CalibrateArguments& arguments, const Verdict& verdict) {
  if (arguments.require.empty() || verdict.grade <= *ParseGrade(arguments.require)) return;
  std::fflush(stdout);
  throw Error(
      ErrorKind::kGrade,
      fmt::format("the calibration is {}, but --require asks for {} (results are in {}): {}",
                  GradeName(verdict.grade),
                  arguments.require,
                  arguments.out.string(),
                  verdict.findings.front().what));
}

const std::vector<std::string> kResults{"calibration.yaml",
                                        "target.yaml",
                                        "points.ply",
                                        "points.csv",
                                        "poses.csv",
                                        "view_poses.csv",
                                        "residuals.csv",
                                        "correlations.csv",
                                        "left_out.csv",
                                        "report.html"};

// A session from its file, or from images, for which model and target are chosen.
struct CalibrateJob {
  std::optional<ImageSession> images;  // without a session file
  const CameraModel* model = nullptr;  // of images; null: to be chosen
  Session session;
  Target target;
  std::vector<Target> several;  // targets; empty: `target` is the only one
  std::vector<SamePrints> same_prints;
};

bool IsSessionFile(const std::vector<std::string>& inputs) {
  return inputs.size() == 1 && std::filesystem::exists(inputs[0]) &&
         !std::filesystem::is_directory(inputs[0]) && !HasImageName(inputs[0]) &&
         SplitStorePattern(inputs[0]).file.empty();
}

// The session file that the arguments name; empty when they name images.
std::string SessionFile(const CalibrateArguments& arguments) {
  const ImageArguments& images = arguments.images;
  const bool image_options = !images.right.empty() || !images.cameras.empty() ||
                             !images.target.empty() || arguments.model != "auto";
  if (arguments.inputs.empty() && images.cameras.empty()) {
    throw Error(ErrorKind::kInput,
                images.right.empty()
                    ? "calibrate: give session.yaml, or images (a glob, files or a folder) with "
                      "--target"
                    : "calibrate: --right takes all that follows; give the first camera's images "
                      "before it");
  }
  const std::string& first = arguments.inputs.empty() ? std::string() : arguments.inputs[0];
  const bool named_so = first.ends_with(".yaml") || first.ends_with(".yml");
  if (!IsSessionFile(arguments.inputs) && !(named_so && arguments.inputs.size() == 1)) return {};
  if (!image_options) return first;
  throw Error(ErrorKind::kInput,
              fmt::format("{}: a session has cameras, target and model itself; --target, --right, "
                          "--camera and --model go with images",
                          first));
}

CalibrateJob MakeCalibrateJob(const CalibrateArguments& arguments,
                              const ConsoleOptions& shared,
                              Console* console) {
  CalibrateJob job;
  if (const std::string file = SessionFile(arguments); !file.empty()) {
    job.session = OpenSession(file);
    AddExcludeRules(arguments.exclude, &job.session);
    UseFrameOptions(arguments, &job.session);
    if (job.session.scene) return job;
    SessionTargets targets = ReadSessionTargets(job.session);
    job.target = std::move(targets.all);
    job.several = std::move(targets.several);
    job.same_prints = std::move(targets.same_prints);
    return job;
  }
  if (arguments.model != "auto") {
    job.model = ModelOfOption("--model", arguments.model);
    if (!job.model->config.empty() || job.model->plenoptic) {
      throw Error(ErrorKind::kInput,
                  fmt::format("--model {}: needs more than images; write a session, for instance "
                              "by 'plenocal init'",
                              arguments.model));
    }
  }
  ImageArguments images = arguments.images;
  images.images = arguments.inputs;
  job.images.emplace(images, arguments.out, shared, console);
  job.target = job.images->target();
  job.session = job.images->With(job.model != nullptr ? *job.model : UsualModel(), {});
  AddExcludeRules(arguments.exclude, &job.session);
  UseFrameOptions(arguments, &job.session);
  return job;
}

// Settles model and target of images, and writes session and target.
void CompleteJob(const CalibrateArguments& arguments,
                 const ConsoleOptions& shared,
                 CalibrateJob* job,
                 SessionObservations* observations,
                 Console* console,
                 OutputFolder* out) {
  if (!job->images) return;
  const ImageChoice choice =
      ChooseByHeldOutFrames(job->model, job->target, *observations, shared, console);
  job->session = job->images->With(*choice.model, choice.refine_target);
  AddExcludeRules(arguments.exclude, &job->session);
  UseCamerasOf(job->session, observations);
  out->Write(ImageSession::kSessionName, job->session.text);
  out->Write(ImageSession::kTargetName, job->images->target_text());
}

// The calibration and its description with a verdict.
struct JudgedCalibration {
  Calibration calibration;
  CalibrationRecord record;
};

// Each of several targets in its own frame, and all of them in that of the first.
void WriteTargets(const CalibrateJob& job, const CalibrationRecord& record, OutputFolder* out) {
  for (size_t k = 0; k < job.several.size(); ++k) {
    out->Write(fmt::format("target_{}.yaml", job.session.targets[k].name),
               RefinedTargetOf(record, job.several[k], k));
  }
  out->Write("target.yaml", RefinedTarget(PlacedTogether(record), record));
}

JudgedCalibration CalibrateWithTarget(const CalibrateArguments& arguments,
                                      const ConsoleOptions& shared,
                                      const CalibrateJob& job,
                                      Console* console,
                                      SessionObservations* found,
                                      OutputFolder* out) {
  // The views are lent to the input: a long recording's are too many for a copy.
  std::vector<CameraInput> cameras = std::move(found->cameras);
  auto [input, held] = MakeInputOnEarlier(job.session, job.target, std::move(cameras), console);
  const SessionObservations& observations = *found;
  auto [calibration, causes] =
      job.several.empty()
          ? SolveWithCauses(input, job.target, arguments, shared.threads, console)
          : std::pair(Solve(input, arguments, shared.threads, console), std::vector<Finding>());
  JudgedCalibration judged{std::move(calibration), {}};
  AddLeftOut(observations, &judged.calibration);
  judged.record = DescribeAll(judged.calibration, observations);
  judged.record.findings.insert(judged.record.findings.begin(), causes.begin(), causes.end());
  judged.record.findings.insert(judged.record.findings.end(), held.begin(), held.end());
  const auto go_on = [&] {
    console->Progress("causes");
    return !Interrupted();
  };
  if (job.several.empty()) {
    Diagnose(input, judged.calibration, observations.traits, CameraModels(), go_on, &judged.record);
    out->Write("target.yaml", RefinedTarget(job.target, judged.record));
  } else {
    judged.record.verdict = Judge(judged.record);
    WriteTargets(job, judged.record, out);
  }
  found->cameras = std::move(input.cameras);
  return judged;
}

JudgedCalibration CalibrateWithScene(const ConsoleOptions& shared,
                                     const Session& session,
                                     const SceneObservations& scene,
                                     Console* console,
                                     OutputFolder* out) {
  const SessionObservations& observations = scene.session;
  SceneCalibrationInput input = MakeSceneInput(session, observations.cameras);
  input.alike = scene.alike;
  input.from_images = FollowsImages(session);
  JudgedCalibration judged{CalibrateScene(input,
                                          {.threads = shared.threads,
                                           .progress =
                                               [&](const std::string& stage) {
                                                 console->Progress(stage);
                                                 return !Interrupted();
                                               }}),
                           {}};
  for (const std::string& line : GroupedByReason(judged.calibration.left_out)) {
    console->Message("  " + line);
  }
  AddLeftOut(observations, &judged.calibration);
  judged.record = DescribeAll(judged.calibration, observations);
  judged.record.verdict = Judge(judged.record);
  out->Write("points.ply", ScenePointsPly(judged.calibration));
  out->Write("points.csv", ScenePointsCsv(judged.record));
  return judged;
}

void RunCalibrate(const CalibrateArguments& arguments, const ConsoleOptions& shared) {
  Console console(shared);
  CalibrateJob job = MakeCalibrateJob(arguments, shared, &console);
  const Session& session = job.session;
  if (session.scene) CheckSceneSession(session, arguments.jackknife);
  OutputFolder out(arguments.out);
  out.RefuseInputs(kResults);

  DetectionCache cache =
      OpenDetectionCache(arguments.cache.empty() ? arguments.out : arguments.cache,
                         session,
                         arguments.fresh ? EarlierDetections::kIgnore : EarlierDetections::kReuse);
  SceneObservations found;
  if (session.scene && FollowsImages(session)) {
    found = FollowSceneImages(session, shared, &console);
  } else {
    found.session = CollectObservations(session,
                                        {job.target, job.several, job.same_prints},
                                        shared,
                                        {&cache, arguments.keep ? &out : nullptr},
                                        &console);
  }
  SessionObservations& observations = found.session;
  CompleteJob(arguments, shared, &job, &observations, &console, &out);
  const auto provenance = ProvenanceOf(shared, "calibrate", session, arguments.out);
  auto [calibration, record] =
      session.scene ? CalibrateWithScene(shared, session, found, &console, &out)
                    : CalibrateWithTarget(arguments, shared, job, &console, &observations, &out);
  // The record holds what follows needs. Tables of a long recording are as large as what the
  // adjustment has used, which glibc would keep.
  calibration.bundle.observations = {};
  malloc_trim(0);
  WriteDetections(session, observations, arguments.out, &out);
  for (CameraInput& camera : observations.cameras) camera.views = {};
  malloc_trim(0);
  record.provenance = provenance;
  WriteResult(record, &out);
  out.Write("left_out.csv", LeftOutCsv(calibration.left_out));
  // An older report beside new results would be wrong.
  out.Remove("report.html");
  if (arguments.report) {
    CameraFiles files{arguments.out, {}};
    for (CameraFile& file : observations.files) {
      files.contents[file.name] = std::move(file.content);
    }
    if (!session.scene)
      AddTarget(job.several.empty() ? job.target : PlacedTogether(record), &record);
    WriteReport(record, files, &console, &out);
  }
  out.Commit();
  // Other runs may need what is in a cache of its own.
  if (arguments.cache.empty()) cache.RemoveUnused();
  Print(arguments, calibration, record, &console);
  CheckRequirement(arguments, *record.verdict);
}

constexpr const char* kCalibrateHelp =
    "From images (or detections) to camera parameters, poses and target.\n\n"
    "  plenocal calibrate session.yaml -o OUT\n"
    "  plenocal calibrate 'images/*.jpg' --target chessboard:9x6:25mm -o OUT\n\n"
    "writes OUT/calibration.yaml, target.yaml (points.csv and points.ply of a session with a scene in place of a target), poses.csv, view_poses.csv (of a rig), residuals.csv, correlations.csv, detections_<camera>.csv, left_out.csv and report.html, and prints a summary. From images it writes OUT/session.yaml and nominal_target.yaml as well, from which the next step can start.";

RunCommand DeclareCalibrate(CLI::App* app, ConsoleOptions* shared) {
  const auto arguments = std::make_shared<CalibrateArguments>();
  app->add_option(
      "input",
      arguments->inputs,
      "session.yaml; or images of a camera: a glob in quotation marks, files or a folder");
  app->add_option(
      "--target",
      arguments->images.target,
      "of images: chessboard:9x6:25mm (inner corners, square), aprilgrid:6x6:88mm:0.3, "
      "charuco:5x7:36mm:18mm:6X6_250, circles:10x7:25mm[:asymmetric], or a target file; "
      "without it, the target is looked for in the images");
  app->add_option("--right",
                  arguments->images.right,
                  "images of a second camera on the same rig; after those of the first");
  app->add_option(
         "--camera", arguments->images.cameras, "NAME=GLOB: images of a camera; several are a rig")
      ->expected(1)
      ->take_all();
  app->add_option("--model",
                  arguments->model,
                  "of images: camera model; auto: the simplest common one that predicts held-out "
                  "frames as well as any")
      ->capture_default_str();
  AddResultOptions(app, arguments.get(), shared);
  app->add_flag("--jackknife",
                arguments->jackknife,
                "print beside each sigma that of a jackknife over frames");
  app->add_flag("!--no-report", arguments->report, "do not write OUT/report.html");
  app->add_flag("--json", arguments->json, "verdict and parameters as JSON on standard output");
  app->add_option(
         "--require", arguments->require, "exit status 3 when the verdict is worse: good or usable")
      ->check(CLI::IsMember({"good", "usable"}));
  return [arguments, shared] { RunCalibrate(*arguments, *shared); };
}

}  // namespace

Command CalibrateCommand() { return {"calibrate", kCalibrateHelp, DeclareCalibrate}; }

}  // namespace plenocal
