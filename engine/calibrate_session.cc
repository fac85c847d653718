// SPDX-License-Identifier: Apache-2.0
#include "engine/calibrate_session.h"

#include <fmt/format.h>
#include <malloc.h>

#include <map>
#include <tuple>
#include <utility>

#include "assess/causes/diagnose.h"
#include "assess/verdict.h"
#include "calib/base/format_error.h"
#include "calib/base/names.h"
#include "calib/estimate/describe.h"
#include "calib/files/calibration_file.h"
#include "calib/files/calibration_tables.h"
#include "calib/io/input_file.h"
#include "engine/observe/auto_model.h"
#include "engine/observe/left_out.h"
#include "engine/observe/scene_images.h"
#include "engine/observe/scene_session.h"
#include "engine/session/earlier_session.h"
#include "engine/session/open_session.h"
#include "engine/session/run_provenance.h"
#include "engine/session/session_targets.h"
#include "models/registry.h"

namespace plenocal {
namespace {

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

std::string RefinedTarget(const Target& target, const CalibrationRecord& calibration) {
  std::map<int, Eigen::Vector3d> positions, sigmas;
  for (const auto& [number, marker] : calibration.markers) {
    positions[number] = marker.position;
    if (marker.sigma) sigmas[number] = *marker.sigma;
  }
  return RefinedTargetYaml(target, positions, sigmas);
}

Calibration Solve(const CalibrationInput& input, bool jackknife, const Run& run) {
  Calibration calibration =
      Calibrate(input, {.threads = run.threads, .progress = [&](const std::string& stage) {
                          return run.Progress(stage);
                        }});
  if (jackknife) {
    calibration.jackknife = EstimateByJackknife(
        calibration.bundle,
        {.loss = input.loss, .threads = run.threads, .progress = [&](size_t done, size_t all) {
           return run.Progress("jackknife", done, all);
         }});
  }
  for (const std::string& line : GroupedByReason(calibration.left_out)) run.Message("  " + line);
  return calibration;
}

// The calibration and what is wrong with the target. Where the calibration fails, the message of
// the error has the causes.
std::pair<Calibration, std::vector<Finding>> SolveWithCauses(const CalibrationInput& input,
                                                             const Target& target,
                                                             bool jackknife,
                                                             const Run& run) {
  const auto find = [&](const Calibration* calibration) {
    run.Progress("causes in the target");
    return FindTargetCauses(input, DoubtsAbout(target), calibration);
  };
  try {
    Calibration calibration = Solve(input, jackknife, run);
    std::vector<Finding> causes = find(&calibration);
    return {std::move(calibration), std::move(causes)};
  } catch (const Error& error) {
    if (error.kind() != ErrorKind::kJob) throw;
    const std::vector<Finding> causes = find(nullptr);
    if (causes.empty()) throw;
    throw JobError("{}; the cause is in the target ({}): {}; {}",
                   error.what(),
                   causes.front().code,
                   causes.front().what,
                   causes.front().remedy);
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

// A session, from its file, from images or as given, with its targets.
class CalibrationRun {
 public:
  CalibrationRun(const CalibrateRequest& request, const Run& run) : request_(request), run_(run) {
    result_.session = Open();
    UseOptions(request, &result_.session);
    if (result_.session.scene) {
      CheckSceneSession(result_.session, request.jackknife);
    } else if (!images_) {
      SessionTargets targets = ReadSessionTargets(result_.session);
      target_ = std::move(targets.all);
      several_ = std::move(targets.several);
      identical_boards_ = std::move(targets.identical_boards);
    }
  }

  SessionCalibration Calibrate() {
    const Session& session = result_.session;
    result_.folders = std::make_unique<RunFolders>(request_, session, kResults);
    OutputFolder* const out = result_.folders->out();
    SceneObservations found;
    if (session.scene && FollowsImages(session)) {
      found = FollowSceneImages(session, run_);
    } else {
      found.session =
          CollectObservations(session,
                              {target_, several_, identical_boards_},
                              run_,
                              {result_.folders->cache(), request_.keep ? out : nullptr});
    }
    SessionObservations& observations = found.session;
    note_ = ChooseByHeldOutFrames(target_, run_, &result_.session, &observations);
    if (images_) {
      const std::optional<bool> refine = result_.session.refine_target;
      result_.session = images_->With(result_.session.cameras[0].model->name,
                                      !refine   ? ""
                                      : *refine ? "true"
                                                : "false");
      UseOptions(request_, &result_.session);
      Write(ImageSession::kSessionName, [&] { return result_.session.text; });
      Write(ImageSession::kTargetName, [&] { return images_->target_text(); });
    }
    const auto provenance = ProvenanceOf(request_.command, session, request_.out);
    if (session.scene) {
      SolveScene(found);
    } else {
      SolveTarget(&observations);
    }
    // The record holds what follows needs. Tables of a long recording are as large as what the
    // adjustment has used, which glibc would keep.
    result_.calibration.bundle.observations = {};
    malloc_trim(0);
    if (out != nullptr) WriteDetections(session, observations, request_.out, out);
    observations.cameras.clear();
    malloc_trim(0);
    result_.record.provenance = provenance;
    result_.files = std::move(observations.files);
    if (out != nullptr) WriteResult(result_.record, out);
    Write("left_out.csv", [&] { return LeftOutCsv(result_.calibration.left_out); });
    // An older report beside new results would be wrong.
    if (out != nullptr) out->Remove("report.html");
    if (!session.scene)
      result_.target = several_.empty() ? target_ : PlacedTogether(result_.record);
    return std::move(result_);
  }

 private:
  Session Open() {
    const CameraModel* const model =
        request_.model == kAuto ? nullptr : ModelNamed("--model", request_.model);
    if (request_.session) {
      Session session = *request_.session;
      for (SessionCamera& camera : session.cameras) {
        if (camera.auto_model && model != nullptr) UseModel(*model, &camera);
      }
      return session;
    }
    if (model != nullptr && (!model->config.empty() || model->plenoptic)) {
      throw InputError(
          "--model {}: needs more than images; write a session, for instance by 'plenocal init'",
          request_.model);
    }
    images_.emplace(request_.images, request_.out, run_);
    target_ = images_->target();
    return images_->With(request_.model, kAuto);
  }

  void SolveTarget(SessionObservations* observations) {
    // The views are lent to the input: a long recording's are too many for a copy.
    auto [input, held] =
        MakeInputOnEarlier(result_.session, target_, std::move(observations->cameras), run_);
    std::vector<Finding> causes;
    if (several_.empty()) {
      std::tie(result_.calibration, causes) =
          SolveWithCauses(input, target_, request_.jackknife, run_);
    } else {
      result_.calibration = Solve(input, request_.jackknife, run_);
    }
    Describe(*observations);
    std::vector<Finding>& findings = result_.record.findings;
    findings.insert(findings.begin(), causes.begin(), causes.end());
    findings.insert(findings.end(), held.begin(), held.end());
    if (note_) findings.push_back(*note_);
    if (several_.empty()) {
      Diagnose(
          input,
          result_.calibration,
          observations->traits,
          CameraModels(),
          [&] { return run_.Progress("causes"); },
          &result_.record);
    } else {
      result_.record.verdict = Judge(result_.record);
    }
    WriteTargets();
    observations->cameras = std::move(input.cameras);
  }

  // Each of several targets in its own frame, and all of them in that of the first.
  void WriteTargets() {
    const CalibrationRecord& record = result_.record;
    for (size_t k = 0; k < several_.size(); ++k) {
      Write(fmt::format("target_{}.yaml", result_.session.targets[k].name),
            [&] { return RefinedTargetOf(record, several_[k], k); });
    }
    Write("target.yaml", [&] {
      return RefinedTarget(several_.empty() ? target_ : PlacedTogether(record), record);
    });
  }

  void SolveScene(const SceneObservations& scene) {
    SceneCalibrationInput input = MakeSceneInput(result_.session, scene.session.cameras);
    input.alike = scene.alike;
    input.from_images = FollowsImages(result_.session);
    result_.calibration =
        CalibrateScene(input, {.threads = run_.threads, .progress = [&](const std::string& stage) {
                                 return run_.Progress(stage);
                               }});
    for (const std::string& line : GroupedByReason(result_.calibration.left_out)) {
      run_.Message("  " + line);
    }
    Describe(scene.session);
    result_.record.verdict = Judge(result_.record);
    Write("points.ply", [&] { return ScenePointsPly(result_.calibration); });
    Write("points.csv", [&] { return ScenePointsCsv(result_.record); });
  }

  void Describe(const SessionObservations& observations) {
    AddLeftOut(observations, &result_.calibration);
    result_.record = DescribeAll(result_.calibration, observations);
  }

  // Makes and writes a file where there is a folder.
  template <typename Text>
  void Write(const std::string& name, const Text& text) {
    if (OutputFolder* const out = result_.folders->out()) out->Write(name, text());
  }

  const CalibrateRequest& request_;
  const Run& run_;
  std::optional<ImageSession> images_;  // without a session
  std::optional<Finding> note_;         // what was chosen
  Target target_;
  std::vector<Target> several_;  // targets; empty: `target_` is the only one
  std::vector<IdenticalBoards> identical_boards_;
  SessionCalibration result_;
};

}  // namespace

SessionCalibration CalibrateSession(const CalibrateRequest& request, const Run& run) {
  const RunScope inputs;
  return CalibrationRun(request, run).Calibrate();
}

}  // namespace plenocal
