// SPDX-License-Identifier: Apache-2.0
#include "assess/verdict.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdio>

#include "assess/causes/diagnose.h"
#include "assess/pose_spread.h"
#include "calib/estimate/describe.h"
#include "models/registry.h"
#include "tests/calib/synthetic.h"

namespace plenocal::testing {
namespace TEST_FILE {

using ::testing::Contains;
using ::testing::Not;

constexpr double kNoise = 0.1;  // px

SyntheticProblem GoodProblem(unsigned seed, int cameras) {
  SyntheticProblem problem = MakeProblem(seed, {.cameras = cameras, .frames = 30, .noise = kNoise});
  for (CameraInput& camera : problem.input.cameras) {
    for (View& view : camera.views) {
      for (Observation& seen : view.observations) seen.detector_sigma = kNoise;
    }
  }
  return problem;
}

Verdict VerdictOf(const SyntheticProblem& problem) {
  const Calibration calibration = Calibrate(problem.input, {});
  CalibrationRecord record = Describe(calibration);
  Diagnose(
      problem.input, calibration, {}, CameraModels(), [] { return true; }, &record);
  return *record.verdict;
}

// Moves all points of the chosen views.
template <typename Change>
void Displace(SyntheticProblem* problem, size_t camera, const Change& change) {
  CameraInput& input = problem->input.cameras[camera];
  for (size_t v = 0; v < input.views.size(); ++v) {
    for (Observation& seen : input.views[v].observations)
      change(v, &seen.values[0], &seen.values[1]);
  }
}

// Their random poses may leave a corner without points, but there is nothing to blame.
TEST(Verdict, OfGoodRecordingsNamesNoCause) {
  constexpr int kSets = 20;
  int good = 0;
  for (unsigned seed = 0; seed < kSets; ++seed) {
    const Verdict verdict = VerdictOf(GoodProblem(700 + seed, 1 + static_cast<int>(seed % 2)));
    good += verdict.grade == Grade::kGood ? 1 : 0;
    for (const Finding& finding : verdict.findings) {
      if (finding.grade == Grade::kGood) continue;
      EXPECT_TRUE(finding.code == "projection" || finding.code.starts_with("coverage"))
          << seed << ": " << VerdictText(verdict);
    }
  }
  EXPECT_GT(good, 0);
}

TEST(Verdict, NamesTheSameImageTwice) {
  SyntheticProblem problem = GoodProblem(720, 1);
  std::vector<View>& views = problem.input.cameras[0].views;
  views[7].observations = views[3].observations;
  const Verdict verdict = VerdictOf(problem);
  EXPECT_EQ(verdict.grade, Grade::kUsable);
  EXPECT_EQ(CodesOf(verdict.findings).front(), "duplicate_images") << VerdictText(verdict);
}

TEST(Verdict, NamesAZoomThatChanged) {
  for (unsigned seed = 0; seed < 3; ++seed) {
    SyntheticProblem problem = GoodProblem(730 + seed, 1);
    const auto [width, height] = problem.input.cameras[0].image_size;
    Displace(&problem, 0, [width = width, height = height](size_t view, double* x, double* y) {
      if (view < 14) return;
      *x += 0.01 * (*x - width / 2.0);
      *y += 0.01 * (*y - height / 2.0);
    });
    const Verdict verdict = VerdictOf(problem);
    EXPECT_EQ(CodesOf(verdict.findings).front(), "focus_changed") << VerdictText(verdict);
  }
}

TEST(Verdict, NamesARollingShutter) {
  for (unsigned seed = 0; seed < 3; ++seed) {
    SyntheticProblem problem = GoodProblem(740 + seed, 1);
    const int height = problem.input.cameras[0].image_size[1];
    Displace(&problem, 0, [&](size_t view, double* x, double* y) {
      const double row = *y / height - 0.5;
      *x += row * (4.0 * static_cast<double>(view % 5) - 8);  // px from the first row to the last
      *y += row * (3.0 * static_cast<double>(view % 3) - 3);
    });
    const Verdict verdict = VerdictOf(problem);
    EXPECT_EQ(CodesOf(verdict.findings).front(), "rolling_shutter") << VerdictText(verdict);
  }
}

TEST(Verdict, NamesAFrameThatDisagrees) {
  SyntheticProblem problem = GoodProblem(750, 1);
  Displace(&problem, 0, [&](size_t view, double* x, double* y) {
    if (view != 11) return;
    *x += 3 * std::sin(*y / 20);
    *y += 3 * std::sin(*x / 30);
  });
  const Verdict verdict = VerdictOf(problem);
  EXPECT_EQ(CodesOf(verdict.findings).front(), "frame_outlier") << VerdictText(verdict);
}

TEST(Verdict, NamesFramesThatArePairedWrongly) {
  SyntheticProblem problem = GoodProblem(760, 2);
  std::vector<View>& views = problem.input.cameras[1].views;
  for (size_t v = 0; v + 1 < views.size(); ++v) views[v].observations = views[v + 1].observations;
  views.pop_back();
  const Verdict verdict = VerdictOf(problem);
  EXPECT_EQ(verdict.grade, Grade::kBad);
  EXPECT_EQ(CodesOf(verdict.findings).front(), "frames_misaligned") << VerdictText(verdict);
  EXPECT_EQ(verdict.findings.front().value, -1);
}

TEST(Verdict, TellsImagesAtDifferentTimesFromACameraThatMoved) {
  SyntheticOptions options{.cameras = 2, .frames = 30, .noise = kNoise};
  options.jitter_translation = 0.002;
  options.jitter_rotation = 0.005;
  EXPECT_THAT(CodesOf(VerdictOf(MakeProblem(770, options)).findings), Contains("not_synchronous"));
}

// From the middle of the recording on its points are those of a rotated camera, to first order.
TEST(Verdict, NamesACameraThatWasKnocked) {
  SyntheticProblem problem = GoodProblem(771, 2);
  Displace(&problem, 1, [](size_t view, double* x, double* y) {
    if (view < 15) return;
    *x += 3, *y -= 2;
  });
  EXPECT_THAT(CodesOf(VerdictOf(problem).findings), Contains("rig_not_rigid"));
}

TEST(Verdict, NamesTheModelThatALensNeeds) {
  SyntheticProblem problem = GoodProblem(775, 1);
  CameraInput& camera = problem.input.cameras[0];
  SetModel(*FindModel(CameraModels(), "pinhole"), &camera);
  const Verdict verdict = VerdictOf(problem);
  EXPECT_EQ(CodesOf(verdict.findings).front(), "strong_distortion_pinhole") << VerdictText(verdict);
}

TEST(Verdict, NamesABentBoard) {
  SyntheticProblem problem = GoodProblem(776, 1);
  for (auto& [number, p] : problem.input.markers) p.z() += 0.003 * std::pow(p.x() / 0.135 - 1, 2);
  const Verdict verdict = VerdictOf(problem);
  EXPECT_EQ(CodesOf(verdict.findings).front(), "target_not_flat") << VerdictText(verdict);
}

// A wrong lens makes the poses of two cameras disagree as well.
TEST(Verdict, NamesTheLensBeforeTheRig) {
  SyntheticProblem problem = GoodProblem(777, 2);
  CameraInput& camera = problem.input.cameras[1];
  SetModel(*FindModel(CameraModels(), "pinhole"), &camera);
  const Verdict verdict = VerdictOf(problem);
  EXPECT_EQ(CodesOf(verdict.findings).front(), "strong_distortion_pinhole") << VerdictText(verdict);
  EXPECT_THAT(CodesOf(verdict.findings), Not(Contains("not_synchronous")));
}

TEST(Verdict, NamesImagesUpsideDown) {
  SyntheticProblem problem = GoodProblem(778, 1);
  const auto [width, height] = problem.input.cameras[0].image_size;
  // The principal point is off the middle in the other images.
  Displace(&problem, 0, [width = width, height = height](size_t view, double* x, double* y) {
    *x += 0.03 * width;
    *y += 0.03 * height;
    if (view % 6 != 0) return;
    *x = width - 1 - *x;
    *y = height - 1 - *y;
  });
  const Verdict verdict = VerdictOf(problem);
  EXPECT_EQ(CodesOf(verdict.findings).front(), "images_rotated") << VerdictText(verdict);
  EXPECT_EQ(verdict.findings.front().value, 5);
}

TEST(Verdict, NamesAMarkerThatDisagrees) {
  SyntheticProblem problem = GoodProblem(779, 1);
  for (View& view : problem.input.cameras[0].views) {
    for (Observation& seen : view.observations) {
      if (seen.marker == 33) seen.values[0] += 5 * std::sin(seen.values[1]);
    }
  }
  const Verdict verdict = VerdictOf(problem);
  EXPECT_EQ(CodesOf(verdict.findings).front(), "marker_outlier") << VerdictText(verdict);
  EXPECT_THAT(verdict.findings.front().what, ::testing::HasSubstr("33 ("));
}

TEST(Verdict, NamesPointsWhoseWindowsTheBorderCutsOff) {
  SyntheticProblem problem = GoodProblem(781, 1);
  constexpr double kCrop = 200, kHalf = 12, kPull = 1;  // px
  CameraInput& camera = problem.input.cameras[0];
  for (int& pixels : camera.image_size) pixels -= static_cast<int>(2 * kCrop);
  for (View& view : camera.views) {
    std::erase_if(view.observations, [&](Observation& seen) {
      bool outside = false;
      for (size_t axis = 0; axis < 2; ++axis) {
        const double near = seen.values[axis] - kCrop, far = camera.image_size[axis] - 1 - near;
        outside = outside || near < 0 || far < 0;
        seen.values[axis] =
            near + kPull * (std::max(0.0, 1 - near / kHalf) - std::max(0.0, 1 - far / kHalf));
      }
      return outside;
    });
  }
  const Verdict verdict = VerdictOf(problem);
  EXPECT_EQ(CodesOf(verdict.findings).front(), "border_points") << VerdictText(verdict);
}

// The coefficients of a rational model replace each other in a lens of little distortion.
TEST(Verdict, IsAboutTheProjectionWhereCoefficientsAreOpen) {
  constexpr int kSets = 6;
  int open = 0;
  for (unsigned seed = 0; seed < kSets; ++seed) {
    SyntheticProblem problem = GoodProblem(790 + seed, 1);
    CameraInput& camera = problem.input.cameras[0];
    SetModel(*FindModel(CameraModels(), "pinhole-radtan8"), &camera);
    for (const Finding& finding : VerdictOf(problem).findings) {
      if (finding.code != "undetermined") continue;
      ++open;
      EXPECT_NE(finding.grade, Grade::kBad) << finding.what;
    }
  }
  EXPECT_GT(open, 0);
}

// The middle of the image alone has points; the rest is extrapolated.
TEST(Verdict, CountsTheWholeImage) {
  SyntheticProblem problem = GoodProblem(781, 1);
  CameraInput& camera = problem.input.cameras[0];
  camera.views.resize(4);
  const Eigen::Vector2d size(camera.image_size[0], camera.image_size[1]);
  for (View& view : camera.views) {
    std::erase_if(view.observations, [&](const Observation& seen) {
      const Eigen::Array2d off = Eigen::Vector2d(seen.values[0], seen.values[1]) / size.x();
      return (off - (size / size.x() / 2).array()).abs().maxCoeff() > 0.2;
    });
  }
  const Verdict verdict = VerdictOf(problem);
  EXPECT_EQ(verdict.grade, Grade::kBad) << VerdictText(verdict);
  const auto projection = std::ranges::find(verdict.findings, "projection", &Finding::code);
  ASSERT_NE(projection, verdict.findings.end());
  EXPECT_EQ(projection->grade, Grade::kBad);
  EXPECT_GT(*projection->value, 1);
}

TEST(Verdict, CountsThePatternOfTheResiduals) {
  SyntheticProblem problem = GoodProblem(782, 1);
  const auto waves = [](size_t, double* x, double*) { *x += 0.2 * std::sin(*x / 40); };
  Displace(&problem, 0, waves);
  const Calibration calibration = Calibrate(problem.input, {});
  const Verdict verdict = Judge(Describe(calibration));
  const auto projection = std::ranges::find(verdict.findings, "projection", &Finding::code);
  ASSERT_NE(projection, verdict.findings.end());
  EXPECT_GT(*projection->value, 0.1);
  EXPECT_THAT(projection->what, ::testing::HasSubstr("error of the model"));
}

TEST(Verdict, OfOnePoseIsNotGood) {
  SyntheticProblem problem = GoodProblem(780, 1);
  std::vector<View>& views = problem.input.cameras[0].views;
  for (View& view : views) view.observations = views[0].observations;
  Displace(&problem, 0, [](size_t view, double* x, double*) { *x += 0.2 * (view % 2); });
  const Verdict verdict = VerdictOf(problem);
  EXPECT_NE(verdict.grade, Grade::kGood);
  EXPECT_THAT(CodesOf(verdict.findings), Contains("one_pose"));
}

// Grade and value of `projection`.
std::pair<Grade, double> ProjectionIn(const Verdict& verdict) {
  const auto found = std::ranges::find(verdict.findings, "projection", &Finding::code);
  return {found->grade, found->value.value()};
}

TEST(Verdict, JudgesTheImageCircleAlone) {
  const SyntheticProblem problem = GoodProblem(790, 1);
  CalibrationRecord record = Describe(Calibrate(problem.input, {}));
  const double whole = ProjectionIn(Judge(record)).second;
  CalibratedCamera& camera = record.cameras[0];
  camera.image_circle = ImageCircle{{camera.image_size[0] / 2.0, camera.image_size[1] / 2.0},
                                    {camera.image_size[1] / 3.0, camera.image_size[1] / 3.0}};
  const double circle = ProjectionIn(Judge(record)).second;
  EXPECT_LT(circle, 0.8 * whole);
  EXPECT_EQ(MeasurePoseSpread(record, 0).coverage, 1);
}

TEST(Verdict, CountsTheDifferenceFromModelsThatPredictAsWell) {
  const SyntheticProblem problem = GoodProblem(791, 1);
  CalibrationRecord record = Describe(Calibrate(problem.input, {}));
  const double sigma = ProjectionIn(Judge(record)).second;
  record.findings.push_back(
      {.code = "automatic_choice", .cameras = {record.cameras[0].name}, .value = 0.7});
  EXPECT_EQ(ProjectionIn(Judge(record)).first, Grade::kUsable);
  EXPECT_NEAR(ProjectionIn(Judge(record)).second, std::hypot(0.7, sigma), 1e-9);
  record.findings.back().value = 1.1;
  EXPECT_EQ(ProjectionIn(Judge(record)).first, Grade::kBad);
}

TEST(Verdict, NamesAPartWhosePointsWereRejected) {
  const SyntheticProblem problem = GoodProblem(792, 1);
  CalibrationRecord record = Describe(Calibrate(problem.input, {}));
  CalibratedCamera& camera = record.cameras[0];
  const auto reject = [&](bool one_frame) {
    for (ResidualRow& row : camera.residuals) {
      const bool in_corner =
          row.values[0] < 0.4 * camera.image_size[0] && row.values[1] < 0.4 * camera.image_size[1];
      row.used = !in_corner || (one_frame && row.frame != 0);
      if (in_corner) row.residual = {1.5, 1.5};
    }
  };
  reject(false);
  const Verdict verdict = Judge(record);
  const auto finding = std::ranges::find(verdict.findings, "rejected_part", &Finding::code);
  ASSERT_NE(finding, verdict.findings.end());
  const auto rejected =
      std::ranges::count_if(camera.residuals, [](const ResidualRow& row) { return !row.used; });
  int count = 0, points = 0;
  ASSERT_EQ(std::sscanf(finding->what.c_str(),
                        (camera.name + ": %d of %d points were rejected around").c_str(),
                        &count,
                        &points),
            2)
      << finding->what;
  EXPECT_LE(count, rejected);
  EXPECT_GT(count, 0.3 * static_cast<double>(rejected));
  EXPECT_GE(points, count) << "of the places that it names";
  EXPECT_LT(points, 2 * count);
  reject(true);
  EXPECT_THAT(CodesOf(Judge(record).findings), Not(Contains("rejected_part")));
}

TEST(Verdict, MergesOneFindingOfSeveralCameras) {
  CalibrationRecord record;
  for (const char* camera : {"left", "right"}) {
    record.findings.push_back({.code = "many_outliers",
                               .grade = Grade::kUsable,
                               .cameras = {camera},
                               .value = camera[0] == 'l' ? 0.1 : 0.2,
                               .limit = 0.05,
                               .what = camera});
  }
  const Verdict verdict = Judge(record);
  ASSERT_EQ(verdict.findings.size(), 1);
  EXPECT_EQ(verdict.findings[0].cameras, std::vector<std::string>({"left", "right"}));
  EXPECT_EQ(verdict.findings[0].value, 0.2);
}

TEST(Verdict, HasNoRemediesForConsequencesOfAWrongTarget) {
  CalibrationRecord record;
  record.findings = {{.code = "noise_excess", .grade = Grade::kBad, .remedy = "Try a model."},
                     {.code = "target_spacing",
                      .role = FindingRole::kTargetCause,
                      .grade = Grade::kBad,
                      .remedy = "Set spacing."}};
  const Verdict verdict = Judge(record);
  EXPECT_EQ(verdict.findings[0].code, "target_spacing");
  EXPECT_EQ(verdict.findings[0].remedy, "Set spacing.");
  EXPECT_EQ(verdict.findings[1].remedy, "");
}

TEST(Verdict, GivesACauseTheGradeOfItsConsequences) {
  CalibrationRecord record;
  const auto cause = [](const char* code, const char* camera) -> Finding {
    return {
        .code = code, .role = FindingRole::kCause, .grade = Grade::kUsable, .cameras = {camera}};
  };
  record.findings = {{.code = "noise_excess", .grade = Grade::kBad, .cameras = {"left"}},
                     cause("rolling_shutter", "left"),
                     cause("focus_changed", "right")};
  const Verdict verdict = Judge(record);
  EXPECT_EQ(verdict.findings[0].code, "rolling_shutter");
  EXPECT_EQ(verdict.findings[0].grade, Grade::kBad);
  EXPECT_EQ(verdict.findings.back().grade, Grade::kUsable);
}

}  // namespace TEST_FILE
}  // namespace plenocal::testing
