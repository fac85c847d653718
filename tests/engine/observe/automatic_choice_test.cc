// SPDX-License-Identifier: Apache-2.0
//
// The choice of model and target by held-out frames, in the words of `try`.
#include <fmt/format.h>
#include <gmock/gmock.h>

#include <algorithm>

#include "assess/model_trial.h"
#include "assess/text/trial_text.h"
#include "engine/observe/auto_model.h"
#include "engine/session/calibration_input.h"
#include "engine/session/memory_session.h"
#include "models/registry.h"
#include "tests/calib/random.h"

namespace plenocal::testing {
namespace TEST_FILE {

using ::testing::ElementsAre;

constexpr const char* kBoard = "chessboard:4x3:40mm";

// Four frames of a board, seen by cameras with this distortion.
class AutomaticChoiceByFrames : public ::testing::Test {
 protected:
  void See(const std::vector<double>& distortions, double marker_error = 0) {
    Random random(3);
    const Target board = TargetOfWord(kBoard);
    std::vector<RigidTransform> poses;
    for (int frame = 0; frame < 4; ++frame) {
      poses.push_back({ExpRotation(random.Uniforms<3>(-0.5, 0.5)),
                       {random.Uniform(-0.12, 0), random.Uniform(-0.08, 0), 0.25 + 0.03 * frame}});
    }
    std::map<int, Eigen::Vector3d> markers = board.markers;
    for (auto& [number, position] : markers) position += random.Gaussians<3>(marker_error);
    for (const double distortion : distortions) {
      SessionCamera& camera = session_.cameras.emplace_back();
      camera.name = session_.cameras.size() == 1 ? "left" : "right";
      camera.model = FindModel(CameraModels(), "pinhole");
      camera.initial.resize(4);
      camera.fixed.resize(4);
      CameraInput input = InputWithoutViews(camera);
      input.image_size = {640, 480};
      for (size_t frame = 0; frame < poses.size(); ++frame) {
        View view{.frame = std::to_string(frame), .observations = {}};
        for (const auto& [number, position] : markers) {
          Eigen::Vector3d p = poses[frame] * position;
          if (observations_.cameras.size() == 1) p.x() -= 0.02;
          const double x = p.x() / p.z(), y = p.y() / p.z();
          const double factor = 1 + distortion * (x * x + y * y);
          Observation seen{.marker = number, .detector_sigma = 0.05};
          seen.values[0] = 320 + 500 * x * factor + random.Gaussian(0.05);
          seen.values[1] = 240 + 500 * y * factor + random.Gaussian(0.05);
          view.observations.push_back(seen);
        }
        input.views.push_back(std::move(view));
      }
      observations_.cameras.push_back(std::move(input));
    }
    session_.auto_refine = false;
  }

  Finding Choose() {
    plenocal::Run run;
    run.listener.progress = [this](const std::string& stage, size_t done, size_t total) {
      stages_ += stage + (total > 0 && done <= total ? "" : "?");
    };
    const std::optional<Finding> note =
        ChooseByHeldOutFrames(TargetOfWord(kBoard), run, &session_, &observations_);
    EXPECT_TRUE(note);
    return note.value_or(Finding{});
  }

  // The result of a trial of these models and the target.
  [[nodiscard]] ModelAndTarget Tried(const std::vector<size_t>& varied,
                                     bool models,
                                     TargetQuestion question) const {
    std::vector<const CameraModel*> common;
    for (const CameraModel& model : CameraModels()) {
      if (models && model.usage == Usage::kCommon && !model.plenoptic) common.push_back(&model);
    }
    const Target board = TargetOfWord(kBoard);
    return TryModelsAndTarget(MakeCalibrationInput(session_, board, observations_.cameras, {}),
                              varied,
                              common,
                              RefinedMarkerFreedom(board),
                              question,
                              {});
  }

  Session session_;
  SessionObservations observations_;
  std::string stages_;
};

TEST_F(AutomaticChoiceByFrames, TakesTheRecommendedModelForOpenCameras) {
  See({0, -0.3});
  session_.cameras[1].auto_model = true;
  const ModelAndTarget tried = Tried({1}, true, TargetQuestion::kNone);
  const ModelChoice& models = tried.models;
  const Finding note = Choose();
  const CameraModel* const best = models.trials[models.recommended].model;
  EXPECT_EQ(session_.cameras[0].model->name, "pinhole");
  EXPECT_EQ(session_.cameras[1].model, best);
  EXPECT_NE(best->name, "pinhole");
  EXPECT_FALSE(session_.cameras[1].auto_model);
  EXPECT_EQ(observations_.cameras[1].model, best);
  EXPECT_EQ(observations_.cameras[1].initial.size(), best->params.size());
  EXPECT_EQ(observations_.cameras[0].model->name, "pinhole");
  EXPECT_THAT(note.cameras, ElementsAre("right"));
  EXPECT_EQ(note.value, models.disagreement);
  std::string what = fmt::format("Camera model: {}.", ModelRecommendation(models));
  if (models.disagreement >= 0.01) {
    what += fmt::format(
        " Models that predict as well differ from it by {:.2g} px within 90 % of the image.",
        models.disagreement);
  }
  EXPECT_EQ(note.what, what);
  EXPECT_EQ(note.remedy,
            fmt::format("To keep this choice, state it in the session: right: {{model: {}}}.",
                        best->name));
  EXPECT_NE(stages_, "");
  EXPECT_EQ(stages_.find('?'), std::string::npos);
}

TEST_F(AutomaticChoiceByFrames, JudgesTheTargetWithTheModelsOfTheSession) {
  See({0, 0}, 4e-4);
  session_.auto_refine = true;
  const ModelAndTarget tried = Tried({0, 1}, false, TargetQuestion::kChoose);
  const MarkerFreedom freedom = tried.targets.trials[tried.targets.recommended].marker_freedom;
  ASSERT_FALSE(freedom.IsRigid());
  const Finding note = Choose();
  EXPECT_EQ(note.what, fmt::format("Target: {}.", TargetRecommendation(tried.targets, freedom)));
  EXPECT_EQ(session_.refine_target, true);
  EXPECT_EQ(note.remedy, "To keep this choice, state it in the session: refine_target: true.");
  EXPECT_FALSE(session_.auto_refine);
  EXPECT_EQ(session_.cameras[0].model->name, "pinhole");
}

}  // namespace TEST_FILE
}  // namespace plenocal::testing
