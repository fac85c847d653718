// SPDX-License-Identifier: Apache-2.0
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <random>

#include "assess/causes/cause.h"
#include "assess/causes/diagnose.h"
#include "assess/verdict.h"
#include "calib/estimate/describe.h"
#include "tests/calib/synthetic.h"

namespace plenocal::testing {
namespace TEST_FILE {

using ::testing::Contains;
using ::testing::ElementsAre;
using ::testing::IsEmpty;
using ::testing::Not;

constexpr double kNoise = 0.05;  // px
constexpr double kWorse = 5;     // noise of bad images over that of others

/// 24 images of one camera, every fourth of them bad, and what the images show.
struct Recording {
  SyntheticProblem problem;
  CameraTraits traits;

  explicit Recording(unsigned seed) {
    problem = MakeProblem(seed, {.frames = 24, .noise = kNoise});
    std::mt19937 random(seed);
    std::uniform_real_distribution<double> blur(0.6, 0.8);
    for (View& view : problem.input.cameras[0].views) {
      traits[view.frame].blur = blur(random);
      for (Observation& seen : view.observations) seen.detector_sigma = kNoise;
    }
  }

  template <typename Change>
  void ForBadImages(const Change& change) {
    std::vector<View>& views = problem.input.cameras[0].views;
    for (size_t v = 1; v < views.size(); v += 4) change(&views[v]);
  }

  /// Noise of the bad images; `stated`: the detector states it.
  void AddNoise(bool stated) {
    std::mt19937 random(1);
    std::normal_distribution<double> noise(0, kWorse * kNoise);
    ForBadImages([&](View* view) {
      for (Observation& seen : view->observations) {
        for (int axis = 0; axis < 2; ++axis) seen.values[axis] += noise(random);
        if (stated) seen.detector_sigma = kWorse * kNoise;
      }
    });
  }

  void Blur() {
    ForBadImages([&](View* view) { traits[view->frame].blur = 3; });
  }

  [[nodiscard]] std::vector<Finding> Worse() const {
    const Calibration calibration = Calibrate(problem.input, {});
    return FindCauses(CauseStage::kNoise,
                      {.calibration = &calibration, .name = "left", .traits = &traits});
  }

  [[nodiscard]] Verdict Judged(const CameraTraits& known) const {
    const Calibration calibration = Calibrate(problem.input, {});
    CalibrationRecord record = Describe(calibration);
    Diagnose(
        problem.input, calibration, {{known}}, {}, [] { return true; }, &record);
    return *record.verdict;
  }
};

TEST(ImageCauses, NamesBlurThatMakesPointsWorse) {
  for (const bool stated : {false, true}) {
    Recording recording(800);
    recording.AddNoise(stated);
    EXPECT_THAT(recording.Worse(), IsEmpty());
    recording.Blur();
    const std::vector<Finding> worse = recording.Worse();
    ASSERT_THAT(CodesOf(worse), ElementsAre("blurred_images"));
    EXPECT_NEAR(*worse[0].value, kWorse, 0.3 * kWorse);
    EXPECT_THAT(worse[0].what,
                ::testing::HasSubstr("left: 6 images in which the target is blurred"));
  }
}

TEST(ImageCauses, NamesSaturationThatMakesPointsWorse) {
  Recording recording(801);
  recording.AddNoise(true);
  recording.ForBadImages([&](View* view) { recording.traits[view->frame].saturated = 0.3; });
  EXPECT_THAT(CodesOf(recording.Worse()), ElementsAre("saturated_images"));
}

// Bad images from three times the distance.
TEST(ImageCauses, NamesATargetThatIsTooSmall) {
  Recording recording(802);
  SyntheticProblem& problem = recording.problem;
  recording.ForBadImages([&](View* view) {
    RigidTransform T = problem.T_camera_rig[0] * problem.T_rig_target.at(view->frame);
    T.t *= 3;
    for (Observation& seen : view->observations) {
      ASSERT_TRUE(problem.input.cameras[0].model->Project(problem.params[0].data(),
                                                          nullptr,
                                                          nullptr,
                                                          T * problem.markers.at(seen.marker),
                                                          seen.values.data()));
    }
  });
  EXPECT_THAT(recording.Worse(), IsEmpty());
  recording.AddNoise(true);
  EXPECT_THAT(CodesOf(recording.Worse()), ElementsAre("few_pixels"));
}

// Random blur and saturation in which points are as good as in others.
TEST(ImageCauses, NamesNothingWithoutConsequences) {
  for (unsigned seed = 0; seed < 10; ++seed) {
    Recording recording(810 + seed);
    recording.Blur();
    recording.ForBadImages([&](View* view) { recording.traits[view->frame].saturated = 0.4; });
    EXPECT_THAT(CodesOf(recording.Worse()), IsEmpty()) << seed;
  }
}

TEST(ImageCauses, AreNamedFirstWhereTheCalibrationIsWorseForThem) {
  Recording recording(803);
  recording.AddNoise(false);
  recording.Blur();
  const Verdict verdict = recording.Judged(recording.traits);
  EXPECT_EQ(verdict.findings.front().code, "blurred_images") << VerdictText(verdict);
  EXPECT_NE(verdict.grade, Grade::kGood);
  EXPECT_THAT(CodesOf(recording.Judged({}).findings), Not(Contains("blurred_images")));
}

TEST(ImageCauses, GetTheGradeOfWhatNoiseMakesWorse) {
  const Finding blurred{
      .code = "blurred_images", .role = FindingRole::kImageDefect, .cameras = {"left"}};
  for (const bool follows : {true, false}) {
    CalibrationRecord record;
    record.findings = {{.code = "noise_excess",
                        .follows_from_noise = follows,
                        .grade = Grade::kBad,
                        .cameras = {"left"}},
                       blurred};
    EXPECT_EQ(CodesOf(Judge(record).findings).front() == "blurred_images", follows);
    record.findings[0].grade = Grade::kGood;
    EXPECT_EQ(Judge(record).grade, Grade::kGood);
  }
}

TEST(ImageCauses, NamesWhiteImagesOfAnotherFocus) {
  CameraTraits traits;
  const auto find = [&] {
    return FindCauses(CauseStage::kImageFile, {.name = "raw", .traits = &traits});
  };
  for (const char* frame : {"0", "1", "2", "3", "4", "5"}) {
    LatticeShift& lattice = traits[frame].lattice;
    lattice.corner = 1000;
    lattice.sigma.setConstant(0.01);
    lattice.value = {0.01, 0, 0.02, 0};
  }
  EXPECT_THAT(find(), IsEmpty());
  for (auto& [frame, image] : traits) image.lattice.value[2] = 0.3;
  const std::vector<Finding> found = find();
  ASSERT_THAT(CodesOf(found), ElementsAre("white_lattice"));
  EXPECT_EQ(found[0].grade, Grade::kUsable);
  EXPECT_NEAR(*found[0].value, 0.31, 1e-9);
  EXPECT_THAT(found[0].what, ::testing::HasSubstr("pitch +3.0e-04"));
}

TEST(ImageCauses, CountsOrientationTags) {
  CameraTraits traits;
  traits["0"].orientation = 6;
  traits["1"].orientation = 1;
  const auto find = [](const CameraTraits& of_images) {
    return FindCauses(CauseStage::kImageFile, {.name = "left", .traits = &of_images});
  };
  EXPECT_THAT(find({{"1", {}}}), IsEmpty());
  const std::vector<Finding> found = find(traits);
  ASSERT_THAT(CodesOf(found), ElementsAre("orientation_tag"));
  EXPECT_EQ(found[0].grade, Grade::kGood);
  EXPECT_EQ(found[0].value, 1);
}

}  // namespace TEST_FILE
}  // namespace plenocal::testing
