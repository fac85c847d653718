// SPDX-License-Identifier: Apache-2.0
//
// Single causes in the recording, tested on the truth of a problem in place of a calibration.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>

#include "assess/causes/cause.h"
#include "assess/causes/lens_cause.h"
#include "assess/causes/residual_tests.h"
#include "models/registry.h"
#include "tests/calib/synthetic.h"

namespace plenocal::testing {
namespace TEST_FILE {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

constexpr double kNoise = 0.1;  // px

struct Recording {
  explicit Recording(unsigned seed, int cameras = 1)
      : problem(MakeProblem(seed, {.cameras = cameras, .frames = 24, .noise = kNoise})) {
    calibration.bundle = TrueBundle(problem);
    for (BundleObservation& seen : calibration.bundle.observations) seen.assumed_sigma = kNoise;
    for (const auto& [frame, pose] : problem.T_rig_target) calibration.frames.push_back(frame);
    calibration.fits.resize(static_cast<size_t>(cameras));
    for (CameraFit& fit : calibration.fits) fit.rms = fit.noise_sigma = kNoise;
  }

  // Changes the points of the frames for which `chosen` is true.
  template <typename Chosen, typename Change>
  void Displace(const Chosen& chosen, const Change& change) {
    for (BundleObservation& seen : calibration.bundle.observations) {
      if (chosen(seen)) change(&seen.seen.values[0], &seen.seen.values[1]);
    }
  }

  [[nodiscard]] std::vector<Finding> Find(CauseStage stage) const {
    CauseEvidence evidence{.calibration = &calibration, .name = "cam0"};
    if (stage == CauseStage::kMotion) evidence.views = RowsOfViews(calibration.bundle, 0);
    return FindCauses(stage, evidence);
  }

  SyntheticProblem problem;
  Calibration calibration;
};

TEST(Causes, AreNoneOfTheTruth) {
  for (unsigned seed = 0; seed < 5; ++seed) {
    const Recording recording(900 + seed);
    for (const CauseStage stage :
         {CauseStage::kRig, CauseStage::kImages, CauseStage::kPoints, CauseStage::kMotion}) {
      EXPECT_THAT(CodesOf(recording.Find(stage)), IsEmpty()) << seed;
    }
  }
}

TEST(DuplicateImages, CountsCopiesAndNamesTheirFrames) {
  Recording recording(910);
  auto& observations = recording.calibration.bundle.observations;
  std::vector<BundleObservation> third;
  for (const BundleObservation& seen : observations) {
    if (seen.frame == 3) third.push_back(seen);
  }
  std::erase_if(observations, [](const BundleObservation& seen) { return seen.frame == 4; });
  for (BundleObservation seen : third) {
    seen.frame = 4;
    observations.insert(
        std::ranges::find_if(observations, [](const auto& o) { return o.frame > 4; }), seen);
  }
  recording.calibration.bundle.T_rig_target[4] = recording.calibration.bundle.T_rig_target[3];
  const std::vector<Finding> found = recording.Find(CauseStage::kImages);
  ASSERT_THAT(CodesOf(found), ElementsAre("duplicate_images"));
  EXPECT_THAT(found[0].cameras, ElementsAre("cam0"));
  EXPECT_THAT(found[0].what,
              HasSubstr("cam0: 1 image is the same as another: " + recording.calibration.frames[3] +
                        " = " + recording.calibration.frames[4]));
}

TEST(ImagesRotated, CountsImagesUpsideDown) {
  Recording recording(911);
  const auto [width, height] = recording.problem.input.cameras[0].image_size;
  recording.Displace([](const auto& seen) { return seen.frame % 8 == 1; },
                     [width = width, height = height](double* x, double* y) {
                       *x = width - 1 - *x;
                       *y = height - 1 - *y;
                     });
  const std::vector<Finding> found = recording.Find(CauseStage::kPoints);
  ASSERT_THAT(CodesOf(found), ElementsAre("images_rotated"));
  EXPECT_EQ(found[0].value, 3);
}

TEST(MarkerOutlier, NamesTheMarkerWithItsRejectedPoints) {
  Recording recording(912);
  int index = 0;
  for (BundleObservation& seen : recording.calibration.bundle.observations) {
    if (seen.seen.marker == 33 && ++index % 2 == 0) seen.used = false;
  }
  const std::vector<Finding> found = recording.Find(CauseStage::kPoints);
  ASSERT_THAT(CodesOf(found), ElementsAre("marker_outlier"));
  EXPECT_THAT(found[0].what, HasSubstr("points rejected: 33 ("));
  EXPECT_NEAR(*found[0].value, 0.5, 0.05);
}

TEST(FocusChanged, MeasuresTheStepOfTheMagnification) {
  Recording recording(913);
  const auto [width, height] = recording.problem.input.cameras[0].image_size;
  recording.Displace([](const auto& seen) { return seen.frame >= 10; },
                     [width = width, height = height](double* x, double* y) {
                       *x += 0.01 * (*x - (width - 1) / 2.0);
                       *y += 0.01 * (*y - (height - 1) / 2.0);
                     });
  const std::vector<Finding> found = recording.Find(CauseStage::kMotion);
  ASSERT_THAT(CodesOf(found), ElementsAre("focus_changed"));
  EXPECT_NEAR(*found[0].value, 0.01, 0.001);
  EXPECT_THAT(found[0].what, HasSubstr("from frame " + recording.calibration.frames[10] + " on"));
}

TEST(FrameOutlier, NamesTheFrame) {
  Recording recording(914);
  recording.Displace([](const auto& seen) { return seen.frame == 5; },
                     [](double* x, double* y) { *x += 3 * std::sin(*y / 20); });
  const std::vector<Finding> found = recording.Find(CauseStage::kMotion);
  ASSERT_THAT(CodesOf(found), ElementsAre("frame_outlier"));
  EXPECT_THAT(found[0].what, HasSubstr(": " + recording.calibration.frames[5] + " ("));
}

// The second camera's poses of a rig that is not synchronous, as jitter.
TEST(RigMotion, TellsAStepFromErrorsOfSingleFrames) {
  for (const bool step : {true, false}) {
    Recording recording(915, 2);
    Bundle& bundle = recording.calibration.bundle;
    bundle.jitter.delta.assign(2 * bundle.T_rig_target.size(), Vector6d::Zero());
    for (size_t f = 0; f < bundle.T_rig_target.size(); ++f) {
      const double sign = step ? (f < 12 ? 1 : -1) : (f * 7 % 5 < 3 ? 1 : -1);
      bundle.jitter.delta[bundle.View(f, 1)].setConstant(
          0.001 * (sign + 0.1 * std::sin(static_cast<double>(f))));
    }
    EXPECT_THAT(CodesOf(recording.Find(CauseStage::kRig)),
                ElementsAre(step ? "rig_not_rigid" : "not_synchronous"));
  }
}

TEST(LensCause, NamesTheModelThatFits) {
  SyntheticProblem problem = MakeProblem(775, {.frames = 30, .noise = kNoise});
  CameraInput& camera = problem.input.cameras[0];
  const CameraModel right = *camera.model, wrong = *FindModel(CameraModels(), "pinhole");
  EXPECT_FALSE(FindLensCause(problem.input, 0, {&wrong, 1}).has_value());
  SetModel(wrong, &camera);
  const std::optional<LensCause> cause = FindLensCause(problem.input, 0, {&right, 1});
  ASSERT_TRUE(cause.has_value());
  EXPECT_EQ(cause->finding.code, "strong_distortion_pinhole");
  EXPECT_THAT(cause->finding.remedy, HasSubstr(right.name));
  EXPECT_LT(cause->residual, 3 * kNoise);
  EXPECT_GT(*cause->finding.value, 2 * *cause->finding.limit);
}

TEST(LargestSplit, FindsAStepAndItsProbability) {
  Eigen::VectorXd values(20);
  for (Eigen::Index i = 0; i < values.size(); ++i) {
    values[i] = 100 + std::sin(3.0 * static_cast<double>(i));
  }
  const Eigen::VectorXd equal = Eigen::VectorXd::Ones(values.size());
  EXPECT_GT(LargestSplit(values, equal, 3).Probability(), 0.05);
  values.tail(8).array() -= 4;
  const SequenceSplit split = LargestSplit(values, equal, 3);
  EXPECT_EQ(split.first, 12);
  EXPECT_NEAR(split.step[0], values.tail(8).mean() - values.head(12).mean(), 1e-12);
  EXPECT_NEAR(split.between, 12.0 * 8 / 20 * std::pow(split.step[0], 2), 1e-9);
  EXPECT_LT(split.Probability(), 1e-6);
  // The noise may be known to be larger than the scatter.
  EXPECT_GT(split.Probability(100), 0.5);
  // A part of weight zero cannot differ.
  Eigen::VectorXd first = equal;
  first.tail(8).setConstant(1e-12);
  EXPECT_LT(LargestSplit(values, first, 3).between, split.between / 2);
  EXPECT_EQ(
      LargestSplit(values, equal, 3, [](auto, const auto& step) { return step[0] > 10; }).first, 0);
}

TEST(FirstNames, ListsFive) {
  EXPECT_EQ(FirstNames({"a", "b"}), "a, b");
  EXPECT_EQ(FirstNames({"a", "b", "c", "d", "e", "f"}), "a, b, c, d, e, ...");
}

}  // namespace TEST_FILE
}  // namespace plenocal::testing
