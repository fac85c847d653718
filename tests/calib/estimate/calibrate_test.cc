// SPDX-License-Identifier: Apache-2.0
//
// Whole calibrations of problems with known truth (synthetic.h), without start values.
#include "calib/estimate/calibrate.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <iostream>
#include <numbers>
#include <optional>
#include <random>
#include <set>
#include <span>
#include <sstream>
#include <tuple>

#include "calib/start/camera_guess.h"
#include "models/registry.h"
#include "tests/calib/synthetic.h"
#include "tests/refusal.h"

namespace plenocal {
namespace TEST_FILE {

using testing::LargestShift;
using testing::MakeProblem;
using testing::SyntheticOptions;
using testing::SyntheticProblem;
using testing::TargetShape;

// ---------------------------------------------------------------------------------------------
// Exact detections

// Rounding leaves less than 1e-8 of all parameters together. A_1 and A_2 act on the image by some
// 1e-3 and 1e-5 of it, so that their own size says little: all parameters together are judged by
// what they do to the image.
constexpr double kRelative = 1e-8;
constexpr double kShift = 1e-7;  // px

using ExactCase = std::tuple<double, TargetShape, int>;

class ExactDetections : public ::testing::TestWithParam<ExactCase> {};

INSTANTIATE_TEST_SUITE_P(RandomCameras,
                         ExactDetections,
                         ::testing::Combine(::testing::Values(10.0, 20.0, 40.0, 60.0, 90.0, 120.0),
                                            ::testing::Values(TargetShape::kPlane,
                                                              TargetShape::kCorner),
                                            ::testing::Values(1, 2, 3)),
                         [](const auto& test) {
                           std::ostringstream name;
                           name << std::get<0>(test.param) << "deg_"
                                << (std::get<1>(test.param) == TargetShape::kPlane ? "plane"
                                                                                   : "corner")
                                << "_" << std::get<2>(test.param) << "cameras";
                           return name.str();
                         });

TEST_P(ExactDetections, GiveTheParametersBackWithoutAStartValue) {
  const auto& [fov_deg, shape, cameras] = GetParam();
  for (unsigned seed = 0; seed < 2; ++seed) {
    SCOPED_TRACE(::testing::Message() << "seed " << seed);
    // The second has partial views and frames that some cameras, the master too, do not see.
    const SyntheticProblem problem = MakeProblem(100 * seed + static_cast<unsigned>(fov_deg),
                                                 {.shape = shape,
                                                  .cameras = cameras,
                                                  .frames = cameras == 1 ? 12 : 15,
                                                  .fov_deg = fov_deg,
                                                  .visible = seed == 0 ? 1 : 0.75,
                                                  .partial = seed == 0 ? 0 : 0.3});
    const Calibration calibration = Calibrate(problem.input, {});
    EXPECT_TRUE(calibration.converged);
    EXPECT_TRUE(calibration.uncertainty.open.empty());
    for (size_t c = 0; c < problem.params.size(); ++c) {
      const BundleCamera& estimate = calibration.bundle.cameras[c];
      EXPECT_LT(LargestShift(problem, calibration, c), kShift) << "camera " << c;
      for (size_t i = 0; i < 4; ++i) {
        EXPECT_NEAR(estimate.params[i] / problem.params[c][i], 1, kRelative)
            << "camera " << c << " " << estimate.model->params[i].name;
      }
      const RigidTransform& truth = problem.T_camera_rig[c];
      EXPECT_LT(LogRotation(truth.R * estimate.T_camera_rig.R.transpose()).norm(), kRelative);
      // Relative to the distance of the target, about 0.3 m / tan(fov / 2).
      const double distance = 0.1 + 0.3 / std::tan(fov_deg / 360 * std::numbers::pi);
      EXPECT_LT((truth.t - estimate.T_camera_rig.t).norm(), kRelative * distance);
      EXPECT_EQ(calibration.fits[c].rejected, 0);
    }
  }
}

// ---------------------------------------------------------------------------------------------
// Noisy detections

// Sums of (error / sigma)^2 with their count.
struct ChiSquare {
  double sum = 0;
  int count = 0;

  void Add(double error, double sigma) {
    sum += std::pow(error / sigma, 2);
    ++count;
  }
  [[nodiscard]] double Mean() const { return sum / count; }
};

struct Errors {
  ChiSquare params, mounts, markers;

  void Add(const SyntheticProblem& problem, const Calibration& calibration) {
    const Uncertainty& uncertainty = calibration.uncertainty;
    for (size_t c = 0; c < problem.params.size(); ++c) {
      const BundleCamera& estimate = calibration.bundle.cameras[c];
      for (size_t i = 0; i < estimate.params.size(); ++i) {
        if (uncertainty.param_std_errors[c][i] == 0) continue;  // held
        params.Add(estimate.params[i] - problem.params[c][i], uncertainty.param_std_errors[c][i]);
      }
      if (c == 0) continue;
      Vector6d d;
      d << problem.T_camera_rig[c].t - estimate.T_camera_rig.t,
          LogRotation(problem.T_camera_rig[c].R * estimate.T_camera_rig.R.transpose());
      for (int i = 0; i < 6; ++i)
        mounts.Add(d[i], std::sqrt(uncertainty.extrinsics_covariance[c](i, i)));
    }
    for (size_t m = 0; m < uncertainty.marker_std_errors.size(); ++m) {
      const BundleMarker& marker = calibration.bundle.markers[m];
      const Eigen::Vector3d d = marker.position - problem.markers.at(marker.number);
      for (int i = 0; i < 3; ++i) markers.Add(d[i], uncertainty.marker_std_errors[m][i]);
    }
  }
};

// Largest |error| / sigma of the intrinsics that a good calibration shows: one in 15000 is
// beyond 4.
constexpr double kSigmas = 4;

void ExpectWithinSigma(const SyntheticProblem& problem, const Calibration& calibration) {
  for (size_t c = 0; c < problem.params.size(); ++c) {
    for (size_t i = 0; i < problem.params[c].size(); ++i) {
      const double sigma = calibration.uncertainty.param_std_errors[c][i];
      EXPECT_GT(sigma, 0);
      EXPECT_NEAR(calibration.bundle.cameras[c].params[i], problem.params[c][i], kSigmas * sigma)
          << "camera " << c << " " << calibration.bundle.cameras[c].model->params[i].name;
    }
  }
}

// Mean of (error / sigma)^2 over all parameters of 100 random problems.
constexpr double kLowest = 0.85, kHighest = 1.15;
// Some 1300 intrinsics and 500 extrinsics are strongly correlated within a problem; about 3 of a
// camera's 7 and of a mount's 6 are independent, 500 and 300 in all: sqrt(2 / 300) = 8 %, here
// three times that.
constexpr double kGroupLowest = 0.75, kGroupHighest = 1.25;

TEST(NoisyDetections, HaveErrorsAsLargeAsTheirSigmas) {
  Errors errors;
  std::mt19937 engine(1);
  constexpr std::array kFovs{20.0, 40.0, 60.0, 90.0};
  for (unsigned seed = 0; seed < 100; ++seed) {
    const SyntheticOptions options{
        .shape = seed % 3 == 0 ? TargetShape::kCorner : TargetShape::kPlane,
        .cameras = 1 + static_cast<int>(seed % 3 == 1 ? 2 : seed % 2),
        .frames = 12,
        .fov_deg = kFovs[(seed / 2) % kFovs.size()],
        .noise = 0.1,
        .marker_tolerance = seed % 5 == 4 ? 0 : 0.0002,
        .visible = 0.9,
        .partial = 0.1};
    const SyntheticProblem problem = MakeProblem(1000 + seed, options);
    errors.Add(problem, Calibrate(problem.input, {}));
  }
  const double all = (errors.params.sum + errors.mounts.sum + errors.markers.sum) /
                     (errors.params.count + errors.mounts.count + errors.markers.count);
  RecordProperty("all", std::to_string(all));
  std::cout << "mean of (error / sigma)^2: " << all << ", intrinsics " << errors.params.Mean()
            << " (" << errors.params.count << "), extrinsics " << errors.mounts.Mean() << " ("
            << errors.mounts.count << "), markers " << errors.markers.Mean() << " ("
            << errors.markers.count << ")\n";
  EXPECT_THAT(all, ::testing::AllOf(::testing::Ge(kLowest), ::testing::Le(kHighest)));
  for (const ChiSquare& group : {errors.params, errors.mounts}) {
    EXPECT_THAT(group.Mean(),
                ::testing::AllOf(::testing::Ge(kGroupLowest), ::testing::Le(kGroupHighest)));
  }
  EXPECT_THAT(errors.markers.Mean(),
              ::testing::AllOf(::testing::Ge(kLowest), ::testing::Le(kHighest)));
}

// Without noise the markers' tolerance is all that is known of the target's place and size, with
// which that of the cameras goes.
TEST(ExactDetections, LeavePlaceAndSizeOfTheTargetToItsTolerance) {
  Errors errors;
  for (unsigned seed = 0; seed < 12; ++seed) {
    const SyntheticProblem problem =
        MakeProblem(seed, {.cameras = 2, .frames = 8, .marker_tolerance = 0.0005});
    errors.Add(problem, Calibrate(problem.input, {}));
  }
  // Seven numbers of each problem are independent: sqrt(2 / 84) = 15 %, four of them.
  EXPECT_THAT(errors.markers.Mean(), ::testing::AllOf(::testing::Ge(0.4), ::testing::Le(1.6)));
  // Of a camera's place its distance from the other, one number a problem.
  EXPECT_LT(errors.mounts.Mean(), 1);
  EXPECT_GT(errors.mounts.Mean(), 0.01);
}

int misfit_calls = 0;

TEST(InitialGuess, LooksForAnotherLensOnlyBeyondWhatTheTargetsToleranceExplains) {
  constexpr double kTolerance = 0.002;  // m; several pixels
  const SyntheticProblem problem = MakeProblem(4, {.noise = 0.1, .marker_tolerance = kTolerance});
  CameraInput camera = problem.input.cameras[0];
  CameraModel model = *camera.model;
  model.functions.misfit =
      [](const CameraModel&, const StartProblem&, std::span<const double>, double) {
        ++misfit_calls;
        return Misfit();
      };
  camera.model = &model;
  misfit_calls = 0;
  const MarkerFreedom tolerance = MarkerFreedom::FromSigma(kTolerance);
  EXPECT_GT(GuessCamera(camera, problem.input.markers, tolerance).median_error, 1);
  EXPECT_EQ(misfit_calls, 0);
  GuessCamera(camera, problem.input.markers, MarkerFreedom::Rigid());
  EXPECT_EQ(misfit_calls, 1);
}

// No candidate explains them: without a pose or with residuals that are not finite.
TEST(InitialGuess, OfWhatNoCameraSeesEndsInAMessage) {
  const auto expect_message = [](const char* what, const auto& spoil) {
    SCOPED_TRACE(what);
    SyntheticProblem problem = MakeProblem(4, {.frames = 3});
    spoil(&problem.input);
    EXPECT_THAT(testing::RefusalOf(
                    [&] {
                      GuessCamera(problem.input.cameras[0],
                                  problem.input.markers,
                                  MarkerFreedom::FromSigma(0.0005));
                    },
                    ErrorKind::kJob),
                ::testing::HasSubstr("no initial guess of model pinhole-radial3"));
  };
  const auto move_markers = [](const auto& place) {
    return [=](CalibrationInput* input) {
      for (auto& [number, position] : input->markers) position = place(position);
    };
  };
  expect_message("markers on one line",
                 move_markers([](const auto& p) { return Eigen::Vector3d(p.x(), 0, 0); }));
  expect_message("markers in one place", move_markers([](const auto&) -> Eigen::Vector3d {
                   return {0, 0, 0};
                 }));
  expect_message("pixels far outside of any image", [](CalibrationInput* input) {
    for (View& view : input->cameras[0].views) {
      for (Observation& seen : view.observations) seen.values[0] = 1e300;
    }
  });
}

TEST(NoisyDetections, TellTheNoiseOfEachCamera) {
  SyntheticProblem problem =
      MakeProblem(3, {.cameras = 2, .frames = 20, .noise = 0.3, .marker_tolerance = 0.0002});
  for (View& view : problem.input.cameras[1].views) {
    for (Observation& observation : view.observations) observation.detector_sigma = 0;  // not given
  }
  const Calibration calibration = Calibrate(problem.input, {});
  // 20 views of 70 points: 2800 coordinates give sigma to 1.3 %; four times that.
  constexpr double kTolerance = 0.055;
  for (const CameraFit& fit : calibration.fits) {
    EXPECT_NEAR(fit.noise_sigma, 0.3, kTolerance * 0.3);
    EXPECT_LT(fit.rms, std::sqrt(2) * fit.noise_sigma);  // what the unknowns took away
  }
  EXPECT_EQ(calibration.fits[0].detector_sigma, 0.3);
  EXPECT_EQ(calibration.fits[1].detector_sigma, 0) << "no sigma was given";
}

TEST(NoisyDetections, OfFramesThatAreNotSynchronousDoNotSpoilTheCameras) {
  constexpr double kTranslation = 0.004, kRotation = 0.01;  // some 10 px in the image
  Errors errors;
  double translation2 = 0, rotation2 = 0;
  constexpr int kProblems = 12;
  for (unsigned seed = 0; seed < kProblems; ++seed) {
    SCOPED_TRACE(::testing::Message() << "seed " << seed);
    SyntheticOptions options{.cameras = 2 + static_cast<int>(seed % 2),
                             .frames = 25,
                             .noise = 0.1,
                             .marker_tolerance = seed % 3 == 2 ? 0.0002 : 0,
                             .visible = 0.9};
    // Rigid ones are taken as such.
    EXPECT_EQ(Calibrate(MakeProblem(400 + seed, options).input, {}).bundle.jitter.delta.size(), 0U);
    options.jitter_translation = kTranslation;
    options.jitter_rotation = kRotation;
    const SyntheticProblem problem = MakeProblem(400 + seed, options);
    const Calibration calibration = Calibrate(problem.input, {});
    errors.Add(problem, calibration);
    const Jitter& jitter = calibration.bundle.jitter;
    translation2 += std::pow(jitter.translation_sigma / kTranslation, 2) / kProblems;
    rotation2 += std::pow(jitter.rotation_sigma / kRotation, 2) / kProblems;
    EXPECT_THAT(testing::CodesOf(calibration.findings), ::testing::Contains("rig_disagrees"));
    for (size_t c = 0; c < problem.params.size(); ++c) {
      EXPECT_NEAR(calibration.fits[c].noise_sigma, 0.1, 0.01);
      if (seed > 1) continue;
      // As good as alone: the rig says little of the intrinsics of a camera.
      CalibrationInput alone = problem.input;
      alone.cameras = {problem.input.cameras[c]};
      const Uncertainty own = Calibrate(alone, {}).uncertainty;
      for (size_t i = 0; i < problem.params[c].size(); ++i) {
        EXPECT_LT(calibration.uncertainty.param_std_errors[c][i], 1.1 * own.param_std_errors[0][i]);
      }
    }
  }
  std::cout << "mean of (error / sigma)^2: intrinsics " << errors.params.Mean() << " ("
            << errors.params.count << "), extrinsics " << errors.mounts.Mean() << " ("
            << errors.mounts.count << "), markers " << errors.markers.Mean() << "; jitter "
            << translation2 << " " << rotation2 << "\n";
  // 108 extrinsics (and 210 intrinsics) of 12 problems: strongly correlated within a problem.
  for (const ChiSquare& group : {errors.params, errors.mounts}) {
    EXPECT_THAT(group.Mean(), ::testing::AllOf(::testing::Ge(0.6), ::testing::Le(1.5)));
  }
  // Some 12 * 25 * 3 differences between views: their mean square to 5 %; four times that.
  EXPECT_NEAR(translation2, 1, 0.2);
  EXPECT_NEAR(rotation2, 1, 0.2);
}

TEST(NoisyDetections, OfAViewThatIsFarOffCountForItsCameraOnly) {
  SyntheticOptions options{.cameras = 2, .frames = 20, .noise = 0.1};
  options.jitter_translation = 0.002;
  options.jitter_rotation = 0.005;
  SyntheticProblem problem = MakeProblem(430, options);
  const double sigma = Calibrate(problem.input, {}).bundle.jitter.translation_sigma;
  auto& views = problem.input.cameras[1].views;
  std::swap(views[4].frame, views[9].frame);  // as if files had been misnamed
  const Calibration calibration = Calibrate(problem.input, {});
  EXPECT_LT(calibration.bundle.jitter.translation_sigma, 1.3 * sigma);
  EXPECT_THAT(testing::CodesOf(calibration.findings), ::testing::Contains("rig_disagrees"));
  EXPECT_EQ(calibration.fits[1].views, 20);
  ExpectWithinSigma(problem, calibration);
}

TEST(NoisyDetections, KeepHeldParametersAtTheirInitialValue) {
  SyntheticProblem problem = MakeProblem(4, {.frames = 12, .noise = 0.1});
  CameraInput& camera = problem.input.cameras[0];
  camera.initial[0] = problem.params[0][0];
  camera.fixed[0] = true;
  camera.initial[6] = problem.params[0][6];
  camera.fixed[6] = true;
  const Calibration calibration = Calibrate(problem.input, {});
  for (const size_t i : {0, 6}) {
    EXPECT_EQ(calibration.bundle.cameras[0].params[i], problem.params[0][i]);
    EXPECT_EQ(calibration.uncertainty.param_std_errors[0][i], 0);
  }
  EXPECT_GT(calibration.uncertainty.param_std_errors[0][1], 0);
}

// ---------------------------------------------------------------------------------------------
// Outliers

TEST(Outliers, AreRejectedAndLeaveTheResultWithinItsSigmas) {
  for (unsigned seed = 0; seed < 6; ++seed) {
    SCOPED_TRACE(::testing::Message() << "seed " << seed);
    SyntheticProblem problem = MakeProblem(
        200 + seed, {.cameras = 1 + static_cast<int>(seed % 2), .frames = 15, .noise = 0.1});
    std::mt19937 engine(seed);
    std::uniform_real_distribution<double> uniform(0, 1);
    std::set<std::tuple<int, std::string, int>> moved;  // camera, frame, marker
    for (size_t c = 0; c < problem.input.cameras.size(); ++c) {
      for (View& view : problem.input.cameras[c].views) {
        for (Observation& observation : view.observations) {
          if (uniform(engine) > 0.05) continue;
          const double angle = 2 * std::numbers::pi * uniform(engine);
          const double distance = 5 + 45 * uniform(engine);  // px; 50 to 500 sigma
          observation.values[0] += distance * std::cos(angle);
          observation.values[1] += distance * std::sin(angle);
          moved.emplace(static_cast<int>(c), view.frame, observation.marker);
        }
      }
    }
    ASSERT_GT(moved.size(), 20);
    const Calibration calibration = Calibrate(problem.input, {});
    int good_rejected = 0;
    for (const BundleObservation& observation : calibration.bundle.observations) {
      const bool is_moved =
          moved.contains({observation.camera,
                          calibration.frames[static_cast<size_t>(observation.frame)],
                          observation.seen.marker});
      if (is_moved) {
        EXPECT_FALSE(observation.used);
      } else {
        good_rejected += observation.used ? 0 : 1;
      }
    }
    // The rule loses a good observation in one calibration of twenty.
    EXPECT_LE(good_rejected, 1);
    ExpectWithinSigma(problem, calibration);
    for (const CameraFit& fit : calibration.fits) EXPECT_NEAR(fit.noise_sigma, 0.1, 0.01);
  }
}

// Errors that the points of a frame share: each frame has a lens of its own.
TEST(FrameScatter, OfAModelWithVeryManyUnknownsIsNamed) {
  const CameraModel* const splined = FindModel(CameraModels(), "splined");
  for (const double own_lens : {0.0, 5e-9}) {
    SyntheticProblem problem = MakeProblem(11, {.frames = 20, .noise = 0.1});
    CameraInput& camera = problem.input.cameras[0];
    testing::SetModel(*splined, &camera);
    std::mt19937 random(5);
    std::normal_distribution<double> normal;
    for (View& view : camera.views) {
      const double cubic = own_lens * normal(random);
      for (Observation& seen : view.observations) {
        const double x = seen.values[0] - camera.image_size[0] / 2.0;
        const double y = seen.values[1] - camera.image_size[1] / 2.0;
        const double stretch = 1 + cubic * (x * x + y * y);
        seen.values[0] += x * (stretch - 1);
        seen.values[1] += y * (stretch - 1);
      }
    }
    const Calibration calibration = Calibrate(problem.input, {});
    EXPECT_EQ(std::ranges::count(testing::CodesOf(calibration.findings), "points_share_errors"),
              own_lens > 0 ? 1 : 0);
  }
}

TEST(Outliers, MayBeAWholeFrame) {
  for (unsigned seed = 0; seed < 4; ++seed) {
    SCOPED_TRACE(::testing::Message() << "seed " << seed);
    SyntheticProblem problem = MakeProblem(300 + seed, {.frames = 12, .noise = 0.1});
    std::mt19937 engine(seed);
    std::uniform_real_distribution<double> uniform(0, 1);
    const size_t wrong = seed;  // the first frame, too
    for (Observation& observation : problem.input.cameras[0].views[wrong].observations) {
      observation.values[0] = 1280 * uniform(engine);
      observation.values[1] = 960 * uniform(engine);
    }
    const std::string name = problem.input.cameras[0].views[wrong].frame;
    const Calibration calibration = Calibrate(problem.input, {});
    for (const BundleObservation& observation : calibration.bundle.observations) {
      const bool is_wrong = calibration.frames[static_cast<size_t>(observation.frame)] == name;
      EXPECT_FALSE(is_wrong && observation.used);
    }
    ExpectWithinSigma(problem, calibration);
  }
}

// ---------------------------------------------------------------------------------------------
// What the data leave open

// One camera before a plane that stays parallel to the image at one distance.
CalibrationInput FrontoParallel(double noise) {
  SyntheticProblem problem = MakeProblem(1, {.frames = 0});
  const CameraModel* model = problem.input.cameras[0].model;
  const std::vector<double> params{1100, 1100, 640, 480, 0, 0, 0};
  std::mt19937 engine(1);
  std::normal_distribution<double> normal;
  CalibrationInput input = problem.input;
  for (int f = 0; f < 12; ++f) {
    View view{std::to_string(10 + f), {}};
    const RigidTransform T_camera_target{ExpRotation({0, 0, 0.3 * f}),
                                         {0.02 * (f % 4) - 0.1, 0.03 * (f % 3) - 0.1, 0.6}};
    for (const auto& [number, position] : input.markers) {
      Observation observation{.marker = number, .detector_sigma = noise};
      if (!model->Project(params.data(),
                          nullptr,
                          observation.values.data(),
                          T_camera_target * position,
                          observation.values.data())) {
        continue;
      }
      for (int i = 0; i < 2; ++i) observation.values[i] += noise * normal(engine);
      view.observations.push_back(observation);
    }
    input.cameras[0].views.push_back(view);
  }
  input.loss = Loss::kHuber;
  return input;
}

TEST(OpenDirections, NameFocalLengthAgainstDistanceOfAParallelPlane) {
  const Calibration calibration = Calibrate(FrontoParallel(0.1), {});
  ASSERT_FALSE(calibration.uncertainty.open.empty());
  bool named = false;
  for (const OpenDirection& direction : calibration.uncertainty.open) {
    EXPECT_GT(direction.sigma, 1);
    bool f_x = false, f_y = false;
    for (const auto& [name, share] : direction.parts) {
      EXPECT_GT(share, 0);
      EXPECT_LE(share, 1);
      f_x = f_x || name == "cam0.f_x";
      f_y = f_y || name == "cam0.f_y";
    }
    named = named || (f_x && f_y);
  }
  EXPECT_TRUE(named) << "f_x and f_y are open together";
  // No small sigma for what is not known, wherever along the open direction the estimate ends.
  for (const size_t i : {0, 1}) {
    EXPECT_GT(calibration.uncertainty.param_std_errors[0][i],
              0.3 * calibration.bundle.cameras[0].params[i]);
  }
}

TEST(OpenDirections, AreNoneWhenThePlaneIsTilted) {
  const SyntheticProblem problem = MakeProblem(9, {.frames = 15, .noise = 0.1});
  EXPECT_TRUE(Calibrate(problem.input, {}).uncertainty.open.empty());
}

// ---------------------------------------------------------------------------------------------

std::string Digest(const Calibration& calibration) {
  std::ostringstream text;
  text << std::hexfloat;
  for (const BundleCamera& camera : calibration.bundle.cameras) {
    for (const double value : camera.params) text << value << " ";
    text << camera.T_camera_rig.R << camera.T_camera_rig.t << camera.noise.detector_scale << " "
         << camera.noise.additive_sigma << "\n";
  }
  for (const RigidTransform& T : calibration.bundle.T_rig_target) text << T.R << T.t << "\n";
  for (const BundleMarker& marker : calibration.bundle.markers) text << marker.position << "\n";
  for (const auto& sigmas : calibration.uncertainty.param_std_errors) {
    for (const double sigma : sigmas) text << sigma << " ";
  }
  for (const Matrix6d& mount : calibration.uncertainty.extrinsics_covariance) text << mount << "\n";
  return text.str();
}

TEST(Calibrate, GivesTheSameBitsForTheSameInputOnAnyNumberOfThreads) {
  const SyntheticProblem problem = MakeProblem(
      8, {.cameras = 3, .frames = 10, .noise = 0.2, .marker_tolerance = 0.0002, .visible = 0.8});
  const std::string first = Digest(Calibrate(problem.input, {.threads = 1, .progress = {}}));
  EXPECT_TRUE(Digest(Calibrate(problem.input, {.threads = 1, .progress = {}})) == first);
  EXPECT_TRUE(Digest(Calibrate(problem.input, {.threads = 4, .progress = {}})) == first);
}

TEST(Calibrate, GivesTheSameBitsForOneCameraBeforeHeldMarkers) {
  const SyntheticProblem problem = MakeProblem(8, {.frames = 10, .noise = 0.2});
  const std::string first = Digest(Calibrate(problem.input, {.threads = 1, .progress = {}}));
  EXPECT_TRUE(Digest(Calibrate(problem.input, {.threads = 4, .progress = {}})) == first);
}

TEST(Calibrate, StopsWhenItsProgressCallbackSaysSo) {
  const SyntheticProblem problem = MakeProblem(8, {.frames = 8, .noise = 0.2});
  for (const int allowed : {0, 1, 3, 6}) {
    int calls = 0;
    CalibrationOptions options;
    options.progress = [&](const std::string& stage) {
      EXPECT_FALSE(stage.empty());
      return calls++ < allowed;
    };
    EXPECT_THROW(Calibrate(problem.input, options), Stopped) << allowed;
    EXPECT_EQ(calls, allowed + 1);
  }
}

std::string JobError(const CalibrationInput& input) {
  return testing::RefusalOf([&] { Calibrate(input, {}); }, ErrorKind::kJob);
}

TEST(Calibrate, NamesTheCameraThatNothingLinksToTheMaster) {
  SyntheticProblem problem = MakeProblem(8, {.cameras = 3, .frames = 12});
  for (View& view : problem.input.cameras[2].views) view.frame = "other" + view.frame;
  EXPECT_THAT(JobError(problem.input), ::testing::HasSubstr("cam2"));
}

TEST(Calibrate, SaysWhichCameraSeesTooLittle) {
  SyntheticProblem problem = MakeProblem(8, {.cameras = 2, .frames = 8});
  problem.input.cameras[1].views.clear();
  EXPECT_THAT(JobError(problem.input), ::testing::HasSubstr("cam1"));
  for (View& view : problem.input.cameras[0].views) view.observations.resize(3);
  problem.input.cameras.pop_back();
  EXPECT_THAT(JobError(problem.input), ::testing::HasSubstr("cam0"));
}

TEST(Calibrate, LinksCamerasByChainsOfOverlap) {
  SyntheticProblem problem = MakeProblem(12, {.cameras = 3, .frames = 18});
  // cam0 sees the first twelve frames, cam1 all, cam2 the last six: no frame of cam0 is one of
  // cam2.
  auto& cameras = problem.input.cameras;
  std::erase_if(cameras[0].views, [](const View& view) { return view.frame >= "0012"; });
  std::erase_if(cameras[2].views, [](const View& view) { return view.frame < "0012"; });
  const Calibration calibration = Calibrate(problem.input, {});
  for (size_t c = 0; c < 3; ++c) EXPECT_LT(LargestShift(problem, calibration, c), kShift);
}

}  // namespace TEST_FILE
}  // namespace plenocal
