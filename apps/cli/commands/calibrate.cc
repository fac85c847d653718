// SPDX-License-Identifier: Apache-2.0
#include "calib/calibrate.h"

#include <fmt/format.h>

#include <map>
#include <memory>
#include <utility>

#include "apps/cli/calibration_input.h"
#include "apps/cli/command.h"
#include "apps/cli/options.h"
#include "apps/cli/provenance.h"
#include "apps/cli/session_observations.h"
#include "apps/report/report.h"
#include "calib/base/error.h"
#include "calib/base/output_folder.h"
#include "calib/describe.h"
#include "calib/files/calibration_file.h"
#include "calib/files/calibration_tables.h"
#include "calib/judge/target/target_causes.h"
#include "calib/summary.h"
#include "models/registry.h"

namespace plenocal {
namespace {

struct CalibrateArguments : SessionOptions {
  bool jackknife = false;  ///< standard errors from leaving out frames beside the others
  bool report = true;      ///< write report.html
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
  for (const LeftOut& item : calibration.left_out) {
    console->Message(fmt::format("  left out {}: {}", item.where, item.reason));
  }
  return calibration;
}

// "code: what", then the remedy, of each.
std::string CausesText(const std::vector<Finding>& causes) {
  std::string text;
  for (const Finding& cause : causes) {
    text += fmt::format("\n{}: {}\n  {}\n", cause.code, cause.what, cause.remedy);
  }
  return text;
}

// The calibration and what is wrong with the target. Where the calibration fails, the message of
// the error has the causes.
std::pair<Calibration, std::vector<Finding>> SolveWithCauses(const CalibrationInput& input,
                                                             const Target& target,
                                                             const CalibrateArguments& arguments,
                                                             int threads,
                                                             Console* console) {
  const auto find = [&](const Calibration* calibration) {
    return FindTargetCauses(input, DoubtsAbout(target), calibration, [&] {
      console->Progress("causes in the target");
      return !Interrupted();
    });
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

// The result with the files of the cameras, and with the images and markers left out.
CalibrationRecord DescribeAll(Calibration calibration, const SessionObservations& observations) {
  calibration.left_out.insert(
      calibration.left_out.begin(), observations.left_out.begin(), observations.left_out.end());
  CalibrationRecord record = Describe(calibration);
  for (const CameraFile& file : observations.files) {
    for (const auto& [key, member] : kCameraTextKeys) {
      if (file.key == key) record.cameras[file.camera].*member = file.name;
    }
  }
  for (size_t c = 0; c < record.cameras.size(); ++c) {
    record.cameras[c].sample_frame = observations.sample_frames[c];
  }
  return record;
}

void WriteResult(const CalibrationRecord& record, const Target& target, OutputFolder* out) {
  out->Write("calibration.yaml", CalibrationYaml(record));
  out->Write("target.yaml", RefinedTarget(target, record));
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
  // A calibration is not lost because its report fails.
  try {
    out->Write("report.html", ReportHtml(record, files));
  } catch (const Error& error) {
    console->Message(fmt::format("report.html was not written: {}", error.what()));
  }
}

void RunCalibrate(const CalibrateArguments& arguments, const ConsoleOptions& shared) {
  const Session session = ReadSession(arguments.session, CameraModels());
  const auto provenance = ProvenanceOf(shared, "calibrate", session, arguments.out);
  const Target target = ReadTarget(session.target);
  RefuseToReplaceInputs(session,
                        arguments.out,
                        {"calibration.yaml",
                         "target.yaml",
                         "poses.csv",
                         "view_poses.csv",
                         "residuals.csv",
                         "correlations.csv",
                         "report.html"});
  OutputFolder out(arguments.out);
  Console console(shared);

  DetectionCache cache =
      OpenDetectionCache(arguments.out,
                         session,
                         arguments.fresh ? EarlierDetections::kIgnore : EarlierDetections::kReuse);
  SessionObservations observations = CollectObservations(
      session, target, shared, {&cache, arguments.keep ? &out : nullptr}, &console);
  const CalibrationInput input =
      MakeCalibrationInput(session, target, observations.cameras, &console);
  const auto [calibration, causes] =
      SolveWithCauses(input, target, arguments, shared.threads, &console);
  CalibrationRecord record = DescribeAll(calibration, observations);
  record.provenance = provenance;
  WriteResult(record, target, &out);
  WriteDetections(session, observations, arguments.out, &out);
  // An older report beside new results would be wrong.
  out.Remove("report.html");
  if (arguments.report) {
    CameraFiles files{arguments.out, {}};
    for (CameraFile& file : observations.files) {
      files.contents[file.name] = std::move(file.content);
    }
    AddTarget(target, &record);
    WriteReport(record, files, &console, &out);
  }
  out.Commit();
  cache.RemoveUnused();
  fmt::print(
      "{}{}\nwritten to {}\n", Summary(calibration), CausesText(causes), arguments.out.string());
}

constexpr const char* kHelp =
    "From images (or detections) to camera parameters, poses and target.\n\n"
    "  plenocal calibrate session.yaml -o OUT\n\n"
    "writes OUT/calibration.yaml, target.yaml, poses.csv, view_poses.csv (of a rig), residuals.csv, correlations.csv, detections_<camera>.csv and report.html, and prints a summary.";

RunCommand Declare(CLI::App* app, ConsoleOptions* shared) {
  const auto arguments = std::make_shared<CalibrateArguments>();
  AddSessionOptions(app, arguments.get(), shared);
  app->add_flag("--jackknife",
                arguments->jackknife,
                "print beside each sigma that of a jackknife over frames");
  app->add_flag("!--no-report", arguments->report, "do not write OUT/report.html");
  return [arguments, shared] { RunCalibrate(*arguments, *shared); };
}

}  // namespace

Command CalibrateCommand() { return {"calibrate", kHelp, Declare}; }

}  // namespace plenocal
