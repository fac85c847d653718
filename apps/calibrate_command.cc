// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>

#include <algorithm>

#include "apps/calibration_input.h"
#include "apps/commands.h"
#include "apps/image_module.h"
#include "apps/observations.h"
#include "apps/provenance.h"
#include "apps/report/report.h"
#include "calib/calibrate.h"
#include "calib/error.h"
#include "calib/number_text.h"
#include "calib/output_folder.h"
#include "calib/result_files.h"
#include "models/registry.h"

namespace plenocal {
namespace {

std::string RefinedTarget(const Target& target, const Calibration& calibration) {
  std::map<int, Eigen::Vector3d> positions, sigmas;
  for (size_t i = 0; i < calibration.bundle.markers.size(); ++i) {
    const BundleMarker& marker = calibration.bundle.markers[i];
    positions[marker.number] = marker.position;
    // Markers that are held have no uncertainty of their own.
    sigmas[marker.number] = calibration.uncertainty.markers.empty()
                                ? Eigen::Vector3d(Eigen::Vector3d::Zero())
                                : calibration.uncertainty.markers[i];
  }
  return RefinedTargetYaml(target, positions, sigmas);
}

}  // namespace

void RunCalibrate(const SessionCommand& command, const ConsoleOptions& options) {
  const Session session = ReadSession(command.session, CameraModels());
  const auto provenance = ProvenanceOf(options, "calibrate", session, command.out);
  const Target target = ReadTarget(session.target);
  RefuseToReplaceInputs(session,
                        command.out,
                        {"calibration.yaml",
                         "target.yaml",
                         "poses.csv",
                         "view_poses.csv",
                         "residuals.csv",
                         "correlations.csv",
                         "report.html"});
  OutputFolder out(command.out);
  Console console(options.quiet);

  StageStore store = OpenStageStore(command.out, session, command.fresh);
  SessionObservations observations = CollectObservations(
      session, target, options, {&store, command.keep ? &out : nullptr}, &console);
  const CalibrationInput input =
      MakeCalibrationInput(session, target, observations.cameras, &console);

  Calibration calibration =
      Calibrate(input, {.threads = options.threads, .progress = [&](const std::string& stage) {
                          console.Progress(stage);
                          return !Interrupted();
                        }});
  if (command.jackknife) {
    calibration.jackknife = EstimateByJackknife(
        calibration.bundle,
        {.loss = input.loss, .threads = options.threads, .progress = [&](size_t done, size_t all) {
           console.Progress("jackknife", done, all);
           return !Interrupted();
         }});
  }
  for (const LeftOut& item : calibration.left_out) {
    console.Message(fmt::format("  left out {}: {}", item.where, item.reason));
  }
  calibration.left_out.insert(
      calibration.left_out.begin(), observations.left_out.begin(), observations.left_out.end());

  calibration.camera_files.resize(session.cameras.size());
  for (const CameraFile& file : observations.files) {
    calibration.camera_files[file.camera].emplace_back(file.key, file.name);
  }
  for (size_t c = 0; c < session.cameras.size(); ++c) {
    const std::string& frame = observations.sample_frames[c];
    if (frame.empty()) continue;
    calibration.camera_files[c].emplace_back("sample_frame", YamlQuoted(frame));
  }
  ResultFiles files;
  files["calibration.yaml"] = CalibrationYaml(calibration, provenance);
  files["target.yaml"] = RefinedTarget(target, calibration);
  files["poses.csv"] = PosesCsv(calibration);
  if (session.cameras.size() > 1) files["view_poses.csv"] = ViewPosesCsv(calibration);
  files["residuals.csv"] = ResidualsCsv(calibration);
  files["correlations.csv"] = CorrelationsCsv(calibration);
  for (const auto& [name, content] : files) out.Write(name, content);
  WriteDetections(session, observations, command.out, &out);
  // An older page beside new results would be wrong.
  out.Remove("report.html");
  if (command.report) {
    console.Progress("report");
    for (CameraFile& file : observations.files) files[file.name] = std::move(file.content);
    // A calibration is not lost for want of its picture.
    try {
      out.Write("report.html", ReportHtml(files, command.out.string(), ReadAttenuationMapByModule));
    } catch (const Error& error) {
      console.Message(fmt::format("report.html was not written: {}", error.what()));
    }
  }
  out.Commit();
  store.RemoveUnused();
  fmt::print("{}\nwritten to {}\n", Summary(calibration), command.out.string());
}

}  // namespace plenocal
