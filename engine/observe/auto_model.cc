// SPDX-License-Identifier: Apache-2.0
#include "engine/observe/auto_model.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <numeric>
#include <set>
#include <string>
#include <string_view>
#include <vector>

#include "assess/model_trial.h"
#include "engine/session/calibration_input.h"
#include "engine/session/open_session.h"
#include "models/registry.h"

namespace plenocal {
namespace {

// Those that other tools read, from narrow lenses to fisheyes.
constexpr std::array<std::string_view, 4> kCommon{
    "pinhole-radtan4", "pinhole-radtan", "pinhole-radtan8", "kannala-brandt4"};
constexpr std::string_view kUsual = "pinhole-radtan";

size_t CountFrames(const SessionObservations& observations) {
  std::set<std::string> frames;
  for (const CameraInput& camera : observations.cameras) {
    for (const View& view : camera.views) frames.insert(view.frame);
  }
  return frames.size();
}

// Held-out RMS of the trial with refined, or with rigid markers; NaN for one that failed.
double RmsOf(const ModelChoice& trials, bool refined) {
  for (const ModelTrial& trial : trials.trials) {
    if (trial.marker_freedom.IsRigid() != refined && trial.failure.empty()) return trial.rms;
  }
  return std::nan("");
}

class Chooser {
 public:
  Chooser(const Target& target, const SessionObservations& observations, const Run& run)
      : target_(target), run_(run) {
    input_.cameras = observations.cameras;
    input_.markers = target.markers;
    input_.marker_freedom = MarkerFreedom::FromSigma(target.tolerance.value_or(0));
    varied_.resize(input_.cameras.size());
    std::iota(varied_.begin(), varied_.end(), size_t{0});
    trial_.threads = run.threads;
  }

  ImageChoice Choose(const CameraModel* given) {
    ImageChoice choice{.model = given != nullptr ? given : BestModel()};
    if (target_.tolerance) {
      if (given == nullptr) run_.Message(model_line_);
      return choice;
    }
    const ModelChoice trial = JudgeTarget(*choice.model);
    const bool refine = !trial.trials[trial.recommended].marker_freedom.IsRigid();
    choice.refine_target = refine;
    if (refine && given == nullptr) {
      // Of a bent target that is held rigid every model is to blame for the bend.
      input_.marker_freedom = RefinedMarkerFreedom(target_);
      choice.model = BestModel();
    }
    if (given == nullptr) run_.Message(model_line_);
    run_.Message(
        refine ? fmt::format("target: its points are refined, as held-out frames are predicted to "
                             "{:.3g} px instead of {:.3g} px (target not flat, or not as stated)",
                             RmsOf(trial, true),
                             RmsOf(trial, false))
               : fmt::format("target: rigid, as stated; refined points would not predict held-out "
                             "frames better ({:.3g} px)",
                             RmsOf(trial, false)));
    return choice;
  }

 private:
  TrialOptions Options(const std::string& what) {
    TrialOptions options = trial_;
    options.progress = [this, what](const std::string& stage) {
      return run_.Progress(fmt::format("{}: {}", what, stage));
    };
    return options;
  }

  const CameraModel* BestModel() {
    std::vector<const CameraModel*> models;
    for (const std::string_view name : kCommon) models.push_back(FindModel(CameraModels(), name));
    const ModelChoice choice =
        TryModels(input_, varied_, models, Options("choosing a camera model"));
    const ModelTrial& best = choice.trials[0];
    const ModelTrial& chosen = choice.trials[choice.recommended];
    model_line_ =
        fmt::format("model: {}, of {} tried on {} held-out frames {}",
                    chosen.model->name,
                    choice.trials.size(),
                    choice.frames,
                    choice.recommended == 0
                        ? fmt::format("the best ({:.3g} px)", best.rms)
                        : fmt::format("the simplest that is not worse ({:.3g} px; {}: {:.3g} px)",
                                      chosen.rms,
                                      best.model->name,
                                      best.rms));
    return chosen.model;
  }

  ModelChoice JudgeTarget(const CameraModel& model) {
    return TryTargets(WithModel(input_, varied_, model),
                      varied_,
                      RefinedMarkerFreedom(target_),
                      Options("judging the target"));
  }

  const Target& target_;
  const Run& run_;
  CalibrationInput input_;
  std::vector<size_t> varied_;
  TrialOptions trial_;
  std::string model_line_;
};

}  // namespace

const CameraModel& UsualModel() { return *FindModel(CameraModels(), kUsual); }

Session WithUsualModels(Session session, const CameraModel& usual) {
  for (SessionCamera& camera : session.cameras) {
    if (camera.model == nullptr) UseModel(usual, &camera);
  }
  return session;
}

ImageChoice ChooseByHeldOutFrames(const CameraModel* model,
                                  const Target& target,
                                  const SessionObservations& observations,
                                  const Run& run) {
  const size_t frames = CountFrames(observations);
  if (frames < kFewestTrialFrames) {
    ImageChoice choice{.model = model != nullptr ? model : &UsualModel()};
    run.Message(fmt::format("{} frame{} are too few to choose by: {} is used{}; record {} or more",
                            frames,
                            frames == 1 ? "" : "s",
                            choice.model->name,
                            target.tolerance ? "" : " and the target is held rigid",
                            kFewestTrialFrames));
    if (!target.tolerance) choice.refine_target = false;
    return choice;
  }
  return Chooser(target, observations, run).Choose(model);
}

void UseCamerasOf(const Session& session, SessionObservations* observations) {
  for (size_t c = 0; c < session.cameras.size(); ++c) {
    UseSessionCamera(session.cameras[c], &observations->cameras[c]);
  }
}

}  // namespace plenocal
