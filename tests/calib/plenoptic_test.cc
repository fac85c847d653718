// SPDX-License-Identifier: Apache-2.0
//
// Whole calibrations of simulated focused plenoptic cameras with known truth, without start values.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <iostream>

#include "calib/base/error.h"
#include "calib/base/statistics.h"
#include "calib/estimate/calibrate.h"
#include "calib/estimate/describe.h"
#include "calib/estimate/weak_unknowns.h"
#include "calib/noise/jackknife.h"
#include "calib/prior/calibrated_rig.h"
#include "models/registry.h"
#include "tests/calib/plenoptic_synthetic.h"
#include "tests/calib/synthetic.h"
#include "tests/refusal.h"

namespace plenocal {
namespace TEST_FILE {

using testing::MakePlenopticProblem;
using Problem = testing::PlenopticProblem;

TEST(PlenopticExactDetections, GiveTheParametersBackWithoutAStartValue) {
  // Relative; of distortion relative to its characteristic scale.
  constexpr double kRelative = 1e-6;
  unsigned seed = 0;
  for (const double f_L : {0.008, 0.016, 0.035, 0.1}) {
    for (const bool galilean : {true, false}) {
      for (const bool corner : {false, true}) {
        SCOPED_TRACE(::testing::Message()
                     << "f_L " << f_L << " galilean " << galilean << " corner " << corner);
        const Problem problem =
            MakePlenopticProblem(seed++, {.f_L = f_L, .galilean = galilean, .corner = corner});
        const Calibration calibration = Calibrate(problem.input, {});
        EXPECT_TRUE(calibration.converged);
        EXPECT_TRUE(calibration.uncertainty.open.empty());
        EXPECT_EQ(calibration.fits[0].rejected, 0);
        const BundleCamera& camera = calibration.bundle.cameras[0];
        for (size_t i = 0; i < problem.params.size(); ++i) {
          const Param& param = camera.model->params[i];
          EXPECT_NEAR(camera.params[i],
                      problem.params[i],
                      kRelative * std::max(std::abs(problem.params[i]), param.scale))
              << param.name;
        }
      }
    }
  }
}

/// The problem of a focused-plenoptic camera, given to focused-plenoptic-pupil.
CalibrationInput WithPupil(const Problem& problem) {
  CalibrationInput input = problem.input;
  CameraInput& camera = input.cameras[0];
  camera.model = FindModel(CameraModels(), "focused-plenoptic-pupil");
  camera.initial.resize(camera.model->params.size());
  camera.fixed.resize(camera.model->params.size(), false);
  return input;
}

TEST(PlenopticPupil, IsRefusedWithoutAHeldDistance) {
  const CalibrationInput input = WithPupil(MakePlenopticProblem(3, {}));
  EXPECT_THAT(testing::RefusalOf([&] { Calibrate(input, {}); }),
              ::testing::HasSubstr("fixed: [f_L]"));
}

TEST(PlenopticPupil, ExplainsTheSameImagesWithAnotherFocalLength) {
  const Problem problem = MakePlenopticProblem(3, {.noise = 0.2});
  CalibrationInput input = WithPupil(problem);
  input.cameras[0].initial[0] = 1.01 * problem.params[0];
  input.cameras[0].fixed[0] = true;
  const Calibration thin = Calibrate(problem.input, {}), pupil = Calibrate(input, {});
  // One family of cameras has the same images (docs/plenoptic.md).
  EXPECT_NEAR(pupil.fits[0].rms / thin.fits[0].rms, 1, 1e-6);
  EXPECT_TRUE(pupil.uncertainty.open.empty());
  EXPECT_GT(std::abs(pupil.bundle.cameras[0].params[9] / pupil.bundle.cameras[0].params[1] - 1),
            0.01);
}

TEST(PlenopticNoisyDetections, HaveErrorsAsLargeAsTheirSigmas) {
  double sum = 0;
  int count = 0;
  std::vector<double> by_param(9, 0.0);
  constexpr int kProblems = 24;
  constexpr std::array kFocal{0.008, 0.016, 0.035, 0.1};
  for (unsigned seed = 0; seed < kProblems; ++seed) {
    const Problem problem = MakePlenopticProblem(1000 + seed,
                                                 {.f_L = kFocal[seed % kFocal.size()],
                                                  .galilean = seed % 8 < 4,
                                                  .corner = seed % 3 == 0,
                                                  .noise = 0.2,
                                                  .marker_tolerance = seed % 5 == 0 ? 0 : 0.0002});
    const Calibration calibration = Calibrate(problem.input, {});
    const BundleCamera& camera = calibration.bundle.cameras[0];
    for (size_t i = 0; i < problem.params.size(); ++i) {
      const double error = camera.params[i] - problem.params[i];
      const double square = std::pow(error / calibration.uncertainty.param_std_errors[0][i], 2);
      by_param[i] += square / kProblems;
      sum += square;
      ++count;
    }
  }
  std::cout << "mean of (error / sigma)^2: " << sum / count << ", by parameter";
  for (const double mean : by_param) std::cout << " " << mean;
  std::cout << "\n";
  EXPECT_THAT(sum / count, ::testing::AllOf(::testing::Ge(0.85), ::testing::Le(1.15)));
}

const CameraModel& PlenopticCameraModel() {
  return *FindModel(CameraModels(), "focused-plenoptic");
}

TEST(PlenopticFloor, IsTheNoiseOfThePointsAndJustBelowTheRms) {
  for (const bool state_sigmas : {true, false}) {
    const Problem problem =
        MakePlenopticProblem(5, {.noise = 0.2, .state_sigmas = state_sigmas, .frames = 8});
    const CameraFit fit = Calibrate(problem.input, {}).fits[0];
    ASSERT_TRUE(fit.noise_floor);
    // Three numbers a point are paid for.
    EXPECT_GT(fit.noise_floor->redundancy, 2000);
    EXPECT_LT(fit.noise_floor->redundancy, 2 * fit.points);
    const double sigma = 0.2 / std::sqrt(2 * fit.noise_floor->redundancy);  // of the floor itself
    EXPECT_NEAR(fit.noise_floor->coordinate, 0.2, 4 * sigma);
    EXPECT_NEAR(fit.noise_floor_all->coordinate, 0.2, 4 * sigma);
    EXPECT_NEAR(fit.rms, fit.noise_floor->length, 0.02 * fit.rms);
  }
}

TEST(PlenopticFloor, StaysWhenTheTargetIsNotAsTheFileSays) {
  Problem problem = MakePlenopticProblem(5, {.noise = 0.2, .frames = 8});
  for (auto& [number, position] : problem.input.markers) position.z() += number % 2 * 2e-3;
  const CameraFit fit = Calibrate(problem.input, {}).fits[0];
  EXPECT_NEAR(fit.noise_floor->coordinate, 0.2, 0.02);
  EXPECT_GT(fit.rms, 1.2 * fit.noise_floor->length);
}

TEST(PlenopticFloor, IsNoneForAnOrdinaryCamera) {
  EXPECT_EQ(FindModel(CameraModels(), "pinhole-radial3")->replicate_fit, nullptr);
}

TEST(PlenopticLensTypes, AreFoundByTheirNoiseAndWeightTheirPoints) {
  Problem problem = MakePlenopticProblem(
      6, {.noise = 0.2, .noise_of_type = {1, 0.4, 2.5}, .state_sigmas = false, .frames = 8});
  CameraInput& camera = problem.input.cameras[0];
  const Calibration alike = Calibrate(problem.input, {});
  EXPECT_TRUE(alike.fits[0].lens_types.empty());
  PlenopticCameraModel().assign_lens_types(&camera.views);
  const Calibration calibration = Calibrate(problem.input, {});
  const auto& kinds = calibration.fits[0].lens_types;
  ASSERT_EQ(kinds.size(), 3U);
  std::vector<double> noise;
  noise.reserve(kinds.size());
  for (const auto& [number, kind] : kinds) noise.push_back(kind.rms / std::sqrt(2));
  std::sort(noise.begin(), noise.end());
  EXPECT_NEAR(noise[0], 0.08, 0.005);
  EXPECT_NEAR(noise[1], 0.2, 0.01);
  EXPECT_NEAR(noise[2], 0.5, 0.02);
  // The points of little noise count for more.
  const auto& sigma = calibration.uncertainty.param_std_errors[0];
  for (size_t i = 0; i < 3; ++i)
    EXPECT_LT(sigma[i], 0.6 * alike.uncertainty.param_std_errors[0][i]);
}

TEST(PlenopticLensTypes, AreOneWhenTheirNoiseIsAlike) {
  Problem problem = MakePlenopticProblem(6, {.noise = 0.2, .state_sigmas = false, .frames = 4});
  CameraInput& camera = problem.input.cameras[0];
  PlenopticCameraModel().assign_lens_types(&camera.views);
  for (const View& view : camera.views) {
    for (const Observation& seen : view.observations) ASSERT_EQ(seen.lens_type, 0);
  }
}

TEST(PlenopticJackknife, AgreesWithTheSigmas) {
  // One jackknife of G groups knows its sigma to 1 / sqrt(2 (G - 1)).
  double sum = 0;
  int count = 0;
  for (unsigned seed = 0; seed < 4; ++seed) {
    const Problem problem = MakePlenopticProblem(40 + seed, {.noise = 0.2, .frames = 16});
    const Calibration calibration = Calibrate(problem.input, {});
    const Jackknife jackknife = EstimateByJackknife(calibration.bundle, {});
    EXPECT_EQ(jackknife.groups, 16);
    for (size_t i = 0; i < problem.params.size(); ++i) {
      sum += std::pow(
          jackknife.param_std_errors[0][i] / calibration.uncertainty.param_std_errors[0][i], 2);
      ++count;
    }
  }
  // Its variance is known to be too large rather than too small.
  EXPECT_GT(sum / count, 0.8);
  EXPECT_LT(sum / count, 1.8);
}

// The mean of (error / sigma)^2 over the parameters of some calibrations is in [least, most]; 1
// where sigmas are true.
template <typename Check>
void ExpectTrueSigmas(const testing::PlenopticOptions& options,
                      double least,
                      double most,
                      const Check& check) {
  double sum = 0;
  int count = 0;
  for (unsigned i = 0; i < 16; ++i) {
    const Problem problem = MakePlenopticProblem(500 + i, options);
    const Calibration calibration = Calibrate(problem.input, {});
    check(calibration);
    for (size_t k = 0; k < problem.params.size(); ++k) {
      const double sigma = calibration.uncertainty.param_std_errors[0][k];
      if (sigma == 0) continue;  // by others
      const double error = calibration.bundle.cameras[0].params[k] - problem.params[k];
      sum += std::pow(error / sigma, 2);
      ++count;
    }
  }
  EXPECT_GT(sum / count, least);
  EXPECT_LT(sum / count, most);
}

TEST(PlenopticCommonNoise, OfTheMicroImagesOfAMarkerIsFoundAndIsInTheSigmas) {
  // 144 squares, of parameters that correlate; sigmas of independent rows give 2.7.
  ExpectTrueSigmas(
      {.noise = 0.1, .common_noise = 0.1}, 0.6, 1.5, [](const Calibration& calibration) {
        const BundleCamera& camera = calibration.bundle.cameras[0];
        EXPECT_NEAR(camera.noise.common_sigma, 0.1, 0.015);
        EXPECT_NEAR(camera.noise.OwnSigma(0.1), 0.1, 0.01);
        EXPECT_TRUE(calibration.findings.empty());
      });
}

TEST(PlenopticFrameScatter, OfErrorsThatAFrameSharesIsNamedAndIsInTheSigmas) {
  // Sigmas without it give 9.6.
  ExpectTrueSigmas({.noise = 0.1, .frame_slope = 0.01}, 0.5, 2, [](const Calibration& calibration) {
    EXPECT_THAT(testing::CodesOf(calibration.findings), ::testing::Contains("points_share_errors"));
  });
}

TEST(PlenopticNuisances, AreEstimatedWithTheCameraAndAreInItsSigmas) {
  // Sigmas without it give 30.
  ExpectTrueSigmas(
      {.noise = 0.1, .shared_slope = 0.02}, 0.5, 1.7, [](const Calibration& calibration) {
        EXPECT_TRUE(calibration.findings.empty());
      });
}

TEST(PlenopticNuisances, AreWrittenWithTheirJointCovariance) {
  constexpr unsigned kRuns = 16;
  double squares = 0, joint = 0, degrees = 0;
  for (unsigned i = 0; i < kRuns; ++i) {
    const Problem problem = MakePlenopticProblem(500 + i, {.noise = 0.1, .shared_slope = 0.02});
    const CalibrationRecord record = Describe(Calibrate(problem.input, {}));
    const CalibratedCamera& camera = record.cameras[0];
    ASSERT_EQ(camera.nuisances.size(), 1U);
    const auto& [value, sigma] = camera.nuisances[0];
    EXPECT_LT(std::abs(value - problem.shared_size), 3.5 * sigma);
    squares += std::pow((value - problem.shared_size) / sigma, 2);
    const CalibratedRig rig = MakeCalibratedRig(record, {}, true);
    Eigen::VectorXd error(rig.prior->unknowns.size());
    for (size_t k = 0; k < rig.prior->unknowns.size(); ++k) {
      const size_t param = *rig.prior->unknowns[k].param;
      error[static_cast<Eigen::Index>(k)] =
          rig.cameras[0].params[param] -
          (param < problem.params.size() ? problem.params[param] : problem.shared_size);
    }
    joint += (rig.prior->weight * error).squaredNorm();
    degrees += static_cast<double>(error.size());
  }
  EXPECT_LT(squares, ChiSquareQuantile(kRuns, 1e-3));
  EXPECT_GT(joint, ChiSquareQuantile(degrees, 1 - 1e-3));
  EXPECT_LT(joint, ChiSquareQuantile(degrees, 1e-3));
}

// Images of a point by templates of a wrong depth are those through other micro lenses by right
// ones (models/start/plenoptic_points.cc): affine in their centres, whatever the point's depth.
TEST(PlenopticTemplateDepth, DisplacesAsIfThroughAnotherMicroLens) {
  const CameraModel& model = *FindModel(CameraModels(), "focused-plenoptic");
  const std::vector<double> params{0.016, 0.0150, 0.0005, 1000, 900, 0, 0, 0, 0};
  const double pixel = 5.5e-6;
  const double v_t = 6, tolerance = 1e-9;
  const Eigen::Vector2d s(0.4, -0.3), c(1200, 700);
  const Eigen::Vector2d other = c - v_t * s;
  for (const double z : {0.5, 1.0, 3.0}) {
    const Eigen::Vector3d p(0.02 * z, -0.01 * z, z);
    const double by_template[kMaxObservationSize] = {0, 0, c.x(), c.y(), v_t, s.x(), s.y()};
    const double right[kMaxObservationSize] = {0, 0, other.x(), other.y()};
    Eigen::Vector2d seen, expected;
    ASSERT_TRUE(model.Project(params.data(), &pixel, by_template, p, seen.data()));
    ASSERT_TRUE(model.Project(params.data(), &pixel, right, p, expected.data()));
    EXPECT_LT((seen + (1 - v_t) * s - expected).norm(), tolerance) << z;
  }
}

// Straight lines from the virtual image through a micro lens of a tilted plane to the sensor.
TEST(PlenopticTilt, ProjectsThroughTheTiltedPlane) {
  const CameraModel& model = *FindModel(CameraModels(), "focused-plenoptic-tilt");
  const double f_L = 0.016, b_L0 = 0.015, B = 0.0005, pixel = 5.5e-6, tolerance = 1e-8;
  const Eigen::Vector2d t(0.003, -0.002), middle(1000, 900);
  const std::vector<double> params{f_L, b_L0, B, middle.x(), middle.y(), 0, 0, 0, 0, t.x(), t.y()};
  for (const Eigen::Vector2d& c_ML : {Eigen::Vector2d(2e-3, 1e-3), {-1.5e-3, 2.5e-3}, {0, 0}}) {
    const double at_lens = b_L0 - t.dot(c_ML), at_sensor = b_L0 + B;
    const Eigen::Vector2d c_I = c_ML * at_sensor / at_lens;
    const Eigen::Vector3d p(0.05, -0.03, 0.7);
    const double b_L = f_L * p.z() / (p.z() - f_L);
    const Eigen::Vector2d x_V = p.head<2>() * b_L / p.z();
    const Eigen::Vector2d x_R = c_ML + (x_V - c_ML) * (at_sensor - at_lens) / (b_L - at_lens);
    const Eigen::Vector2d lens = c_I / pixel + middle;
    const double values[kMaxObservationSize] = {0, 0, lens.x(), lens.y()};
    Eigen::Vector2d seen;
    ASSERT_TRUE(model.Project(params.data(), &pixel, values, p, seen.data()));
    EXPECT_LT((seen - (x_R / pixel + middle)).norm(), tolerance);
    // The ray of the point that was seen passes through it.
    const double back[kMaxObservationSize] = {seen.x(), seen.y(), lens.x(), lens.y()};
    const auto ray = model.Unproject(params.data(), &pixel, back);
    ASSERT_TRUE(ray);
    EXPECT_LT((p - ray->origin).cross(ray->direction).norm(), 1e-9);
  }
}

TEST(PlenopticTilt, IsFoundWithTrueSigmas) {
  ExpectTrueSigmas({.noise = 0.1, .tilt = {0.002, -0.001}}, 0.6, 1.5, [](const Calibration& c) {
    EXPECT_TRUE(c.findings.empty());
  });
}

constexpr std::array<double, 4> kThirdOrder{4e6, 2e4, -600, 400};

TEST(PlenopticThick, IsFoundWithTrueSigmas) {
  ExpectTrueSigmas({.noise = 0.05, .third_order = kThirdOrder}, 0.6, 1.5, [](const Calibration& c) {
    EXPECT_TRUE(c.findings.empty());
    const std::vector<double>& params = c.bundle.cameras[0].params;
    EXPECT_EQ(params[9], 1 / params[1]);
    EXPECT_TRUE(c.bundle.cameras[0].fixed[9]);
    // The affine law does not hold, and the floor by it is none.
    const NoiseFloor& floor = *c.fits[0].noise_floor;
    EXPECT_GT(floor.length, 1.02 * floor.third_order);
    EXPECT_NEAR(floor.third_order, std::sqrt(2) * 0.05, 0.004);
  });
}

// Images, and poses but for a shift along the axis, do not depend on the pupil.
TEST(PlenopticThick, HasAPupilThatIsStatedOrThatOfAThinLens) {
  Problem problem =
      MakePlenopticProblem(3, {.noise = 0.02, .frames = 8, .third_order = kThirdOrder});
  CameraInput& camera = problem.input.cameras[0];
  const double w_P = 0.6 * problem.params[9];
  camera.initial[9] = w_P;
  EXPECT_THROW(Calibrate(problem.input, {}), Error);
  camera.rules.resize(camera.initial.size());
  camera.rules[9].prior = {.value = w_P, .sigma = 0.02 * w_P};
  for (const bool fixed : {false, true}) {
    camera.fixed[9] = fixed;
    const Calibration calibration = Calibrate(problem.input, {});
    const std::vector<double>& params = calibration.bundle.cameras[0].params;
    EXPECT_NEAR(params[9] / w_P, 1, 1e-3);
    EXPECT_NEAR(calibration.fits[0].rms, std::sqrt(2) * 0.02, 0.001);
    EXPECT_GT(std::abs(params[0] / problem.params[0] - 1), 1e-3);
    const double sigma = calibration.uncertainty.param_std_errors[0][9];
    EXPECT_NEAR(sigma / w_P, fixed ? 0 : 0.02, 1e-3);
  }
}

TEST(PlenopticThick, FollowsTheMainLensWhereItsPupilIsNotStated) {
  const Problem problem = MakePlenopticProblem(3, {.frames = 1, .third_order = kThirdOrder});
  const CameraInput& camera = problem.input.cameras[0];
  const Observation& seen = camera.views[0].observations[0];
  const Eigen::Vector3d p(0.01, -0.02, 0.2);
  const auto project = [&](double b_L0, double w_P) {
    std::vector<double> params = problem.params;
    params[1] = b_L0;
    params[9] = w_P;
    Eigen::Vector2d x;
    EXPECT_TRUE(camera.model->Project(
        params.data(), camera.config.data(), seen.values.data(), p, x.data()));
    return x;
  };
  const double b_L0 = problem.params[1], step = 1e-5 * b_L0;
  EXPECT_EQ(project(b_L0, kByOthers), project(b_L0, 1 / b_L0));
  std::vector<double> params = problem.params;
  params[9] = kByOthers;
  Eigen::Vector2d x;
  Eigen::Matrix<double, 2, 3, Eigen::RowMajor> by_point;
  Eigen::Matrix<double, 2, 14, Eigen::RowMajor> J;
  ASSERT_TRUE(camera.model->ProjectWithJacobian(
      params.data(),
      camera.config.data(),
      seen.values.data(),
      p,
      {.predicted = x.data(), .J_params = J.data(), .J_point = by_point.data()}));
  const Eigen::Vector2d by_difference =
      (project(b_L0 + step, kByOthers) - project(b_L0 - step, kByOthers)) / (2 * step);
  EXPECT_LT((J.col(1) - by_difference).norm(), 1e-6 * by_difference.norm());
  EXPECT_TRUE(J.col(9).isZero());
}

TEST(PlenopticWeakness, OfOneDepthIsNamedWithTheDistancesToAdd) {
  const Problem problem =
      MakePlenopticProblem(7, {.noise = 0.2, .depth_span = 0.005, .tilt_factor = 0.05});
  const Calibration calibration = Calibrate(problem.input, {});
  const std::vector<WeakUnknowns> weak = testing::WeakUnknownsOf(calibration);
  ASSERT_FALSE(weak.empty());
  std::string all;
  for (const WeakUnknowns& unknowns : weak) {
    for (const std::string& name : unknowns.names) all += name + " ";
    all += unknowns.remedy + "\n";
  }
  EXPECT_THAT(all, ::testing::HasSubstr("plenoptic.B"));
  EXPECT_THAT(all, ::testing::HasSubstr("add views between"));
  EXPECT_THAT(all, ::testing::HasSubstr("fixed: [f_L]"));
}

TEST(PlenopticWeakness, IsNotFoundInAGoodRecording) {
  const Problem problem = MakePlenopticProblem(8, {.corner = true, .noise = 0.05, .frames = 16});
  for (const WeakUnknowns& unknowns : testing::WeakUnknownsOf(Calibrate(problem.input, {}))) {
    EXPECT_FALSE(unknowns.open);
    // f_L and b_L0 go together in any recording (docs/plenoptic.md).
    for (const std::string& name : unknowns.names) {
      EXPECT_THAT(
          name,
          ::testing::AnyOf("plenoptic.f_L", "plenoptic.b_L0", "plenoptic.A_0", "plenoptic.A_1"));
    }
  }
}

}  // namespace TEST_FILE
}  // namespace plenocal
