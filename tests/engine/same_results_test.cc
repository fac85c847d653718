// SPDX-License-Identifier: Apache-2.0
//
// What is made of one pair of cameras: is any number of the results another than before?
#include <gtest/gtest.h>

#include <Eigen/Core>
#include <algorithm>
#include <string>
#include <vector>

#include "assess/text/compare_text.h"
#include "assess/text/trial_text.h"
#include "calib/base/run.h"
#include "calib/files/calibration_file.h"
#include "engine/calibrate_session.h"
#include "engine/check_session.h"
#include "engine/compare_files.h"
#include "engine/json/calibration_json.h"
#include "engine/rigs/merge_calibrations.h"
#include "engine/rigs/predict_accuracy.h"
#include "engine/rigs/triangulate_points.h"
#include "engine/session/memory_session.h"
#include "engine/suggest_views.h"
#include "engine/try_session.h"
#include "models/registry.h"
#include "targets/target.h"
#include "tests/calib/random.h"
#include "tests/digest.h"
#include "tests/temporary_folder.h"

namespace plenocal::testing {
namespace TEST_FILE {

constexpr const char* kTarget = "chessboard:9x6:30mm";
constexpr double kTolerance = 1e-3;  // of all numbers together: digits that round the other way
using EngineRun = plenocal::Run;     // GoogleTest has a function of this name

/// Points of two cameras with distortion of different kinds, some of them missing and some wrong.
/// `baseline`: m.
std::vector<MemoryCamera> Pair(unsigned seed, int frames, double baseline = 0.12) {
  Random random(seed);
  const Target board = TargetOfWord(kTarget);
  std::vector<MemoryCamera> cameras{
      {.name = "left", .model = FindModel(CameraModels(), "pinhole-radtan4")},
      {.name = "right", .model = FindModel(CameraModels(), "kannala-brandt4")}};
  const std::vector<std::vector<double>> params{{610, 612, 322, 238, -0.12, 0.03, 5e-4, -3e-4},
                                                {590, 588, 317, 244, 0.02, -0.01, 0.004, 0}};
  const std::vector<RigidTransform> T_camera_rig{
      {}, {ExpRotation({0.01, -0.06, 0.005}), {-baseline, 0.002, 0.004}}};
  for (MemoryCamera& camera : cameras) camera.image_size = {640, 480};
  for (int frame = 0; frame < frames; ++frame) {
    const Eigen::Vector3d turn = random.Uniforms<3>(-0.5, 0.5);
    const RigidTransform T_rig_target{
        ExpRotation(turn),
        {random.Uniform(-0.2, 0), random.Uniform(-0.15, 0), random.Uniform(0.35, 0.7)}};
    for (size_t c = 0; c < cameras.size(); ++c) {
      View view{.frame = std::to_string(frame), .observations = {}};
      for (const auto& [marker, position] : board.markers) {
        const Eigen::Vector3d p = T_camera_rig[c] * (T_rig_target * position);
        Observation seen{.marker = marker, .detector_sigma = 0.1};
        const bool inside =
            cameras[c].model->Project(params[c].data(), nullptr, nullptr, p, seen.values.data());
        for (double& value : {std::ref(seen.values[0]), std::ref(seen.values[1])}) {
          value += random.Gaussian(0.1);
        }
        if (random.Uniform(0, 1) < 0.01) seen.values[0] += 4;
        const bool missing = random.Uniform(0, 1) < 0.1;
        if (!inside || missing || seen.values[0] < 0 || seen.values[0] > 639 ||
            seen.values[1] < 0 || seen.values[1] > 479) {
          continue;
        }
        view.observations.push_back(seen);
      }
      if (view.observations.size() > 10) cameras[c].views.push_back(std::move(view));
    }
  }
  return cameras;
}

Session SessionOf(unsigned seed, int frames, double baseline = 0.12) {
  return SessionInMemory(kTarget, Pair(seed, frames, baseline));
}

class SameResults : public InTemporaryFolder {
 protected:
  /// Calibration of a session in a folder.
  SessionCalibration Calibrated(const std::string& folder, const Session& session) const {
    CalibrateRequest request;
    request.session = session;
    request.out = Path(folder);
    SessionCalibration found = CalibrateSession(request, one_thread_);
    found.folders->Commit();
    return found;
  }
  /// Of texts without the folder's name, which is another one in each run.
  double Of(const std::vector<std::string>& texts) const {
    Digest digest;
    for (std::string text : texts) {
      for (size_t at = 0; (at = text.find(folder_.string(), at)) != std::string::npos;) {
        text.erase(at, folder_.string().size());
      }
      digest.AddNumbersOf(text);
    }
    return digest.Sum();
  }
  const EngineRun one_thread_{.threads = 1};
};

TEST_F(SameResults, OfACalibration) {
  CalibrateRequest request;
  request.session = SessionOf(1, 12);
  request.jackknife = true;
  const CalibrationRecord record = CalibrateSession(request, one_thread_).record;
  EXPECT_NEAR(Of({CalibrationYaml(record)}), -26.4352, kTolerance);
  EXPECT_NEAR(Of({CalibrationJson(record).dump()}), -13.0555, kTolerance);
  EXPECT_NEAR(Of({SpaceJson(record).dump()}), 108.7367, kTolerance);
  EXPECT_NEAR(Of({SigmaMapsJson(record, 1).dump()}), -18.2742, kTolerance);
}

TEST_F(SameResults, OfModelsAndStressTests) {
  TryRequest request;
  request.models = {"pinhole", "pinhole-radtan4", "kannala-brandt4"};
  request.stress = true;
  const SessionTrial trial =
      TrySession(SessionInMemory(kTarget, {Pair(2, 10)[0]}), request, one_thread_);
  EXPECT_NEAR(Of({TrialCsv(trial.rows)}), -14.6846, kTolerance);
  EXPECT_NEAR(Of({ConfidenceText(trial.models), TargetRecommendation(trial.targets, {})}),
              -3.8068,
              kTolerance);
  EXPECT_NEAR(Of({StressText(trial.stress)}), -17.9084, kTolerance);
}

TEST_F(SameResults, OfACheckAndAComparison) {
  const CalibrationRecord old = Calibrated("old", SessionOf(3, 10)).record;
  CheckRequest request;
  request.distances = {0.5, 2};
  request.in_space = true;
  request.out = Path("check");
  const SessionCheck made = CheckSession(SessionOf(4, 8, 0.1205), old, request, one_thread_);
  EXPECT_NEAR(Of({CheckJson(made.check).dump()}), -31.1564, kTolerance);
  EXPECT_NEAR(Of({CheckText(made.check)}), -15.4175, kTolerance);
  ASSERT_TRUE(made.comparison && made.space);
  EXPECT_NEAR(Of({ComparisonCsv(*made.comparison)}), 9.8360, kTolerance);
  EXPECT_NEAR(Of({ComparisonText(*made.comparison, "a", "b")}), 46.3227, kTolerance);
  EXPECT_NEAR(Of({SpaceCsv(*made.space), SpaceText(*made.space)}), -4.3155, kTolerance);
}

TEST_F(SameResults, InSpace) {
  Calibrated("out", SessionOf(5, 10));
  AccuracyRequest accuracy;
  accuracy.calibration = Path("out");
  accuracy.distances = {0.4, 1, 5};
  accuracy.cells = 8;
  const auto predicted = PredictAccuracy(accuracy, one_thread_);
  std::vector<std::string> contents;
  for (const auto& [name, content] : AccuracyFiles(accuracy, predicted))
    contents.push_back(content);
  EXPECT_NEAR(Of(contents), -7.1354, kTolerance);
  EXPECT_NEAR(Of({AccuracyText(predicted)}), -24.9929, kTolerance);

  TriangulateRequest points;
  points.calibration = Path("out");
  points.adjust = true;
  points.lengths = {{PositionNamed("0"), PositionNamed("8")}};
  points.angles = {{PositionNamed("8"), PositionNamed("0"), PositionNamed("45")}};
  points.planes = {
      {PositionNamed("0"), PositionNamed("8"), PositionNamed("45"), PositionNamed("53")}};
  const Triangulation made = TriangulatePoints(SessionOf(6, 3), points, one_thread_);
  EXPECT_NEAR(Of({TriangulationJson(made)}), 222.5722, kTolerance);
  EXPECT_NEAR(Of({TriangulationText(made)}), 24.7428, kTolerance);
}

TEST_F(SameResults, OfSuggestedViews) {
  SuggestRequest request;
  request.count = 3;
  const SuggestedViews made = SuggestViews(SessionOf(7, 4), request, one_thread_);
  Digest digest;
  for (const NextView& view : made.views.views) {
    digest.Add(view.T_rig_target);
    for (const double sigma :
         {view.sigma_before, view.sigma_after, view.region_before, view.region_after}) {
      digest.Add(std::min(sigma, 1e3));  // infinite where something is not determined
    }
    digest.Add(static_cast<double>(view.region));
    for (const auto& [camera, outlines] : view.outlines) {
      for (const auto& outline : outlines) {
        for (const Eigen::Vector2d& corner : outline) digest.AddAll(0.01 * corner);
      }
    }
  }
  digest.Add(std::min(made.views.sigma, 1e3));
  digest.Add(made.views.goal);
  digest.AddAll(made.views.distances);
  EXPECT_NEAR(digest.Sum(), 973.9786, kTolerance) << made.views.views.size();
}

TEST_F(SameResults, OfMergedCalibrations) {
  Calibrated("first", SessionOf(8, 8));
  Calibrated("second", SessionOf(9, 7));
  MergeRequest request;
  request.calibrations = {Path("first"), Path("second")};
  const MergedFiles made = MergeFiles(request, one_thread_);
  EXPECT_NEAR(Of({CalibrationYaml(made.merged.record)}), -96.5595, kTolerance);
  EXPECT_NEAR(Of({MergeText(made)}), -16.1287, kTolerance);
}

}  // namespace TEST_FILE
}  // namespace plenocal::testing
