// SPDX-License-Identifier: Apache-2.0
#include "engine/suggest/live_calibration.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <iterator>

#include "assess/views/view_information.h"
#include "calib/base/error.h"
#include "calib/estimate/calibrate.h"
#include "calib/estimate/describe.h"
#include "engine/suggest/view_target.h"
#include "tests/calib/synthetic.h"

namespace plenocal::testing {
namespace TEST_FILE {

constexpr size_t kFirst = 8, kAll = 11;

// A camera after its first frames, and the others.
struct Recording {
  SyntheticProblem problem;
  LiveCalibration live;

  explicit Recording(const SyntheticOptions& options)
      : problem(MakeProblem(5, options)), live(Begin(problem)) {}

  static LiveCalibration Begin(const SyntheticProblem& problem) {
    CalibrationInput input = problem.input;
    for (CameraInput& camera : input.cameras) camera.views.resize(kFirst);
    CalibrationRecord record = Describe(Calibrate(input, {}));
    const Target target = TargetOfWord("chessboard:10x7:30mm");
    RigEstimate rig = MakeRigEstimate(record);
    SetFactors(record, MakeViewTarget(target), &rig);
    return {std::move(record), target, std::move(rig), {.count = 1}};
  }

  [[nodiscard]] std::vector<View> Frame(size_t index) const {
    std::vector<View> views;
    for (const CameraInput& camera : problem.input.cameras) views.push_back(camera.views[index]);
    return views;
  }
};

TEST(LiveCalibration, IsTheCalibrationOfAllFrames) {
  for (const double tolerance : {0.0, 0.0005}) {
    Recording recording({.cameras = 1,
                         .frames = static_cast<int>(kAll),
                         .noise = 0.1,
                         .marker_tolerance = tolerance});
    double sigma = recording.live.Suggested().views.sigma;
    for (size_t f = kFirst; f < kAll; ++f) {
      const std::vector<View> frame = recording.Frame(f);
      recording.live.Add(frame[0].frame, frame);
      EXPECT_LT(recording.live.Suggested().views.sigma, 1.05 * sigma);
      sigma = recording.live.Suggested().views.sigma;
      EXPECT_EQ(recording.live.Suggested().views.views.size(), 1U);
    }
    const CalibrationRecord& live = recording.live.Record();
    const CalibrationRecord whole = Describe(Calibrate(recording.problem.input, {}));
    ASSERT_EQ(live.frames.size(), kAll);
    for (size_t c = 0; c < whole.cameras.size(); ++c) {
      const CalibratedCamera &a = live.cameras[c], &b = whole.cameras[c];
      for (size_t k = 0; k < b.params.size(); ++k) {
        if (b.Sigma(k) == 0) continue;
        EXPECT_LT(std::abs(a.params[k] - b.params[k]), 0.1 * b.Sigma(k)) << b.model->params[k].name;
        EXPECT_NEAR(a.Sigma(k) / b.Sigma(k), 1, 0.05) << b.model->params[k].name;
      }
    }
  }
}

// By the noise that was found in those before, not by what the detector states.
TEST(LiveCalibration, WeighsAFrameLikeThoseBeforeUnderItsOwnName) {
  const SyntheticOptions options{.frames = static_cast<int>(kAll), .noise = 0.1};
  Recording stated(options), as_found(options);
  std::vector<View> frame = stated.Frame(kFirst);
  as_found.live.Add("new", frame);
  for (Observation& seen : frame[0].observations) seen.detector_sigma *= 30;
  stated.live.Add("new", frame);
  EXPECT_EQ(stated.live.Record().cameras[0].params, as_found.live.Record().cameras[0].params);
  EXPECT_EQ(stated.live.Record().frames.back().name, "new");
}

TEST(LiveCalibration, KeepsWhatItHasAfterAFrameThatItCannotUse) {
  Recording recording({.frames = static_cast<int>(kAll), .noise = 0.1});
  const double sigma = recording.live.Suggested().views.sigma;
  const std::vector<View> frame = recording.Frame(kFirst - 1);
  EXPECT_THROW(recording.live.Add(frame[0].frame, frame), Error) << "it is there already";
  EXPECT_EQ(recording.live.Record().frames.size(), kFirst);
  EXPECT_EQ(recording.live.Suggested().views.sigma, sigma);
  // What shows nothing adds nothing.
  recording.live.Add("empty", {View{}});
  EXPECT_EQ(recording.live.Record().frames.size(), kFirst);
}

}  // namespace TEST_FILE
}  // namespace plenocal::testing
