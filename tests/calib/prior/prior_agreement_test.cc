// SPDX-License-Identifier: Apache-2.0
#include "calib/prior/prior_agreement.h"

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <Eigen/LU>
#include <array>
#include <cmath>

#include "models/registry.h"
#include "tests/calib/synthetic.h"

namespace plenocal::testing {
namespace TEST_FILE {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::Not;

// A pair at the truth, with a prior of these standard errors on f_x and c_x of the second camera
// and on two components of its extrinsics, from which the estimate deviates by `deviation`.
Bundle PairWithPrior(const Eigen::Vector4d& sigma, const Eigen::Vector4d& deviation) {
  const SyntheticProblem problem = MakeProblem(7, {.cameras = 2, .frames = 5});
  Bundle bundle = TrueBundle(problem);
  for (BundleObservation& observation : bundle.observations) observation.assumed_sigma = 0.2;
  const std::vector<double>& params = bundle.cameras[1].params;
  Vector6d moved = Vector6d::Zero();
  moved[1] = -deviation[2];
  moved[5] = -deviation[3];
  const RigidTransform& T = bundle.cameras[1].T_camera_rig;
  bundle.prior = {.unknowns = {{.camera = 1, .param = 0, .value = params[0] - deviation[0]},
                               {.camera = 1, .param = 2, .value = params[2] - deviation[1]},
                               {.camera = 1, .component = 1},
                               {.camera = 1, .component = 5}},
                  .T_camera_rig = {RigidTransform{}, Retract(T, moved)},
                  .weight = sigma.cwiseInverse().asDiagonal()};
  return bundle;
}

const Eigen::Vector4d kSigma(2, 3, 0.01, 0.01);

std::vector<Finding> FindingsOf(const Eigen::Vector4d& sigmas) {
  const Bundle bundle = PairWithPrior(kSigma, kSigma.cwiseProduct(sigmas));
  return FindingsOfPrior(bundle, EstimateUncertainty(bundle));
}

TEST(PriorAgreement, OfDeviationsAsLargeAsTheStandardErrorsFindsNothing) {
  EXPECT_TRUE(FindingsOf({1, -1, 1, -1}).empty());
  EXPECT_TRUE(FindingsOf({0, 0, 0, 0}).empty());
  Bundle bundle = PairWithPrior(kSigma, 10 * kSigma);
  bundle.prior.reset();
  EXPECT_TRUE(FindingsOfPrior(bundle, EstimateUncertainty(bundle)).empty());
}

// The mean squared displacement of the second camera's points by one more pixel of f_x.
TEST(PriorAgreement, NamesAParameterWithItsEffectInTheImage) {
  const std::vector<Finding> findings = FindingsOf({-10, 0, 0, 0});
  ASSERT_EQ(findings.size(), 1U);
  const Finding& finding = findings[0];
  const Bundle bundle = PairWithPrior(kSigma, {-20, 0, 0, 0});
  const Uncertainty uncertainty = EstimateUncertainty(bundle);
  EXPECT_EQ(finding.code, "prior_contradicted");
  const std::string& name = bundle.cameras[1].name;
  EXPECT_THAT(finding.cameras, ElementsAre(name));
  const double f = bundle.cameras[1].params[0], sigma = uncertainty.param_std_errors[1][0];
  EXPECT_NEAR(*finding.value, 20 / std::sqrt(4 - sigma * sigma), 1e-6);
  EXPECT_EQ(finding.limit, 3);
  double squares = 0, count = 0;
  for (const BundleObservation& seen : bundle.observations) {
    if (seen.camera != 1) continue;
    const double x = seen.seen.values[0] - bundle.cameras[1].params[2];
    squares += std::pow(20 * x / f, 2);
    ++count;
  }
  EXPECT_THAT(finding.what,
              HasSubstr(fmt::format("contradict the earlier calibration by {:.1f} sigma, {:.2g} px",
                                    *finding.value,
                                    std::sqrt(squares / count))));
  EXPECT_THAT(finding.what, HasSubstr(name + ".f_x"));
  EXPECT_THAT(finding.what,
              HasSubstr(fmt::format("({:.6g} +- 2, with the images {:.6g})", f + 20, f)));
  EXPECT_THAT(finding.remedy, HasSubstr("'free: [f_x]' for " + name));
}

TEST(PriorAgreement, NamesExtrinsicsInTheirUnits) {
  const std::vector<Finding> shifted = FindingsOf({0, 0, 20, 0});
  ASSERT_EQ(shifted.size(), 1U);
  EXPECT_THAT(shifted[0].what, HasSubstr("known to 0.01 m, with the images 0.2 off"));
  EXPECT_THAT(shifted[0].remedy, HasSubstr("Was the camera moved on the rig?"));
  const std::vector<Finding> turned = FindingsOf({0, 0, 0, -20});
  ASSERT_EQ(turned.size(), 1U);
  EXPECT_THAT(turned[0].what, HasSubstr("known to 0.01 rad, with the images -0.2 off"));
}

TEST(PriorAgreement, NamesTheLargestEffectFirst) {
  const std::vector<Finding> findings = FindingsOf({4, 20, 0, 20});
  ASSERT_EQ(findings.size(), 3U);
  EXPECT_THAT(findings[0].what, HasSubstr("c_x"));  // 60 px
  EXPECT_THAT(findings[1].what, HasSubstr("w_z"));  // 0.2 rad: 51 px
  EXPECT_THAT(findings[2].what, HasSubstr("f_x"));
}

// What the images do not improve is not tested: the deviation from the prior is rounding.
TEST(PriorAgreement, DoesNotTestWhatTheImagesDoNotTell) {
  const Eigen::Vector4d sigma(1e-6, 3, 0.01, 0.01);
  const Bundle bundle = PairWithPrior(sigma, {1e-5, 0, 0, 0});
  EXPECT_TRUE(FindingsOfPrior(bundle, EstimateUncertainty(bundle)).empty());
}

// The uncertainty of the second camera's unknowns as it is stated: the covariance of f_x, c_x and
// the extrinsics' components 1 and 5, in this order; not estimated where an index is -1.
Uncertainty Stated(const Bundle& bundle,
                   const Eigen::Matrix4d& covariance,
                   bool has_f = true,
                   bool has_extrinsics = true) {
  Uncertainty uncertainty;
  uncertainty.param_index = {std::vector<int>(bundle.cameras[0].params.size(), -1),
                             std::vector<int>(bundle.cameras[1].params.size(), -1)};
  if (has_f) uncertainty.param_index[1][0] = 7;
  uncertainty.param_index[1][2] = 6;
  uncertainty.extrinsics_index = {-1, has_extrinsics ? 0 : -1};
  const std::array<Eigen::Index, 4> place{7, 6, 1, 5};
  // What no unknown of the prior has is large.
  uncertainty.covariance = Eigen::MatrixXd::Constant(8, 8, 1e3);
  for (size_t i = 0; i < 4; ++i) {
    for (size_t j = 0; j < 4; ++j) {
      uncertainty.covariance(place[i], place[j]) =
          covariance(static_cast<Eigen::Index>(i), static_cast<Eigen::Index>(j));
    }
  }
  return uncertainty;
}

// d' (C_prior - C)^-1 d of the deviation d, whose chance is 1e-3 at 18.467 with four degrees of
// freedom.
TEST(PriorAgreement, TestsAllUnknownsAtOnce) {
  Eigen::Matrix4d part;  // of the prior's variances, with correlations
  part << 0.5, 0.2, 0.1, -0.1, 0.2, 0.4, 0.15, 0.1, 0.1, 0.15, 0.3, 0.05, -0.1, 0.1, 0.05, 0.6;
  const Eigen::Matrix4d scale = kSigma.asDiagonal();
  const Eigen::Matrix4d gained = scale * (Eigen::Matrix4d::Identity() - part) * scale;
  const Eigen::Vector4d direction = kSigma.cwiseProduct(Eigen::Vector4d(1, 0.1, -0.2, 0.1));
  const double unit = direction.dot(gained.inverse() * direction);
  for (const double square : {18.4, 18.5}) {
    const Eigen::Vector4d deviation = direction * std::sqrt(square / unit);
    const Bundle bundle = PairWithPrior(kSigma, deviation);
    const std::vector<Finding> found =
        FindingsOfPrior(bundle, Stated(bundle, scale * part * scale));
    if (square < 18.45) {
      EXPECT_TRUE(found.empty());
      continue;
    }
    ASSERT_EQ(found.size(), 1U);
    EXPECT_NEAR(*found[0].value, deviation[0] / std::sqrt(gained(0, 0)), 1e-6);
  }
}

// Without an estimate the deviation is tested against the prior alone.
TEST(PriorAgreement, CountsUnknownsThatAreNotEstimatedAsExact) {
  const Eigen::Matrix4d half = (0.5 * kSigma.cwiseAbs2()).asDiagonal();
  const auto sigmas = [&](Eigen::Index k, bool has_f, bool has_extrinsics) {
    const Bundle bundle = PairWithPrior(kSigma, 8 * kSigma.cwiseProduct(Eigen::Vector4d::Unit(k)));
    return *FindingsOfPrior(bundle, Stated(bundle, half, has_f, has_extrinsics)).at(0).value;
  };
  EXPECT_NEAR(sigmas(0, true, true), 8 * std::sqrt(2), 1e-6);
  EXPECT_NEAR(sigmas(0, false, true), 8, 1e-6);
  EXPECT_NEAR(sigmas(1, false, true), 8 * std::sqrt(2), 1e-6);
  EXPECT_NEAR(sigmas(2, true, true), 8 * std::sqrt(2), 1e-6);
  EXPECT_NEAR(sigmas(2, true, false), 8, 1e-6);
  EXPECT_NEAR(sigmas(3, true, false), 8, 1e-6);
}

// A direction in which the images take less than a thousandth of the variance counts as untested.
TEST(PriorAgreement, CountsDirectionsByWhatTheImagesGain) {
  const auto find = [](double gained, const Eigen::Vector4d& sigmas) {
    const Bundle bundle = PairWithPrior(kSigma, kSigma.cwiseProduct(sigmas));
    Eigen::Vector4d variances = 0.5 * kSigma.cwiseAbs2();
    variances[0] *= 2 * (1 - gained);
    return FindingsOfPrior(bundle, Stated(bundle, variances.asDiagonal()));
  };
  EXPECT_EQ(find(1.1e-3, {1, 0, 0, 0}).size(), 1U);
  EXPECT_TRUE(find(0.9e-3, {1, 0, 0, 0}).empty());
  // Three directions are left: 16.27 in place of 18.47.
  const double between = std::sqrt(17.0 / 2);
  EXPECT_TRUE(find(1.1e-3, {0, between, 0, 0}).empty());
  EXPECT_EQ(find(0.9e-3, {0, between, 0, 0}).size(), 1U);
  // No direction at all.
  const Bundle bundle = PairWithPrior(kSigma, 100 * kSigma);
  const Eigen::Matrix4d all = kSigma.cwiseAbs2().asDiagonal();
  EXPECT_TRUE(FindingsOfPrior(bundle, Stated(bundle, all)).empty());
}

TEST(PriorAgreement, NamesThoseFromThreeSigmasOnAndFourOfThem) {
  const Eigen::Matrix4d none = Eigen::Matrix4d::Zero();
  const auto count = [&](double second) {
    const Bundle bundle =
        PairWithPrior(kSigma, kSigma.cwiseProduct(Eigen::Vector4d(9, second, 0, 0)));
    return FindingsOfPrior(bundle, Stated(bundle, none)).size();
  };
  EXPECT_EQ(count(3.01), 2U);
  EXPECT_EQ(count(-2.99), 1U);
  Bundle bundle = PairWithPrior(kSigma, 9 * kSigma);
  EXPECT_EQ(FindingsOfPrior(bundle, Stated(bundle, none)).size(), 4U);
  bundle.prior->unknowns.push_back({.camera = 1, .param = 1, .value = -4000});
  bundle.prior->weight = (Eigen::MatrixXd::Identity(5, 5) / 10).eval();
  bundle.prior->weight.topLeftCorner(4, 4) = kSigma.cwiseInverse().asDiagonal();
  const std::vector<Finding> found = FindingsOfPrior(bundle, Stated(bundle, none));
  ASSERT_EQ(found.size(), 4U);
  EXPECT_THAT(found[0].what, HasSubstr(".f_y: "));
}

// The effect of another value, of a parameter that the image is no linear function of.
TEST(PriorAgreement, StatesTheEffectOfThePriorsValue) {
  constexpr double kMoved = 0.2;
  Bundle bundle = PairWithPrior(kSigma, Eigen::Vector4d::Zero());
  BundleCamera& camera = bundle.cameras[1];
  camera.model = FindModel(CameraModels(), "double-sphere");
  camera.params.resize(4);
  camera.params.insert(camera.params.end(), {-0.2, 0.6});
  ASSERT_EQ(camera.params.size(), camera.model->params.size());
  const size_t last = camera.params.size() - 1;
  bundle.prior = {.unknowns = {{.camera = 1, .param = last, .value = 0.6 - kMoved}},
                  .T_camera_rig = {RigidTransform{}, camera.T_camera_rig},
                  .weight = Eigen::MatrixXd::Constant(1, 1, 100)};
  const Uncertainty uncertainty = Stated(bundle, Eigen::Matrix4d::Zero());
  for (size_t i = 0; i < bundle.observations.size(); ++i) {
    bundle.observations[i].used = i % 3 == 0;
  }
  const auto expect_effect = [&](double effect) {
    const std::vector<Finding> found = FindingsOfPrior(bundle, uncertainty);
    ASSERT_EQ(found.size(), 1U);
    EXPECT_THAT(
        found[0].what,
        HasSubstr(fmt::format("by 20.0 sigma, {:.2g} px in the image (0.4 +- 0.01, with the "
                              "images 0.6).",
                              effect)));
  };
  double squares = 0, count = 0;
  for (const BundleObservation& seen : bundle.observations) {
    if (!seen.used || seen.camera != 1) continue;
    const Eigen::Vector3d p =
        camera.T_camera_rig * (bundle.T_rig_target[static_cast<size_t>(seen.frame)] *
                               bundle.markers[static_cast<size_t>(seen.marker)].position);
    std::vector<double> before = camera.params;
    before[last] -= kMoved;
    Eigen::Vector2d here, there;
    ASSERT_TRUE(camera.model->Project(camera.params.data(), nullptr, nullptr, p, here.data()));
    ASSERT_TRUE(camera.model->Project(before.data(), nullptr, nullptr, p, there.data()));
    squares += (here - there).squaredNorm();
    ++count;
  }
  expect_effect(std::sqrt(squares / count));
  // Points that do not project do not count.
  for (BundleObservation& seen : bundle.observations) seen.used = seen.used || seen.camera == 0;
  const std::vector<BundleMarker> markers = bundle.markers;
  bundle.markers[0].position = bundle.T_rig_target[0].Inverse() * Eigen::Vector3d(0, 0, -100);
  EXPECT_THAT(FindingsOfPrior(bundle, uncertainty).at(0).what, Not(HasSubstr("nan")));
  bundle.markers = markers;
  for (BundleObservation& seen : bundle.observations) seen.used = seen.camera == 0;
  expect_effect(0);
}

TEST(PriorAgreement, StatesTheEffectOfThePriorsExtrinsics) {
  Bundle bundle = PairWithPrior(kSigma, Eigen::Vector4d::Zero());
  const BundleCamera& camera = bundle.cameras[1];
  constexpr double kDeviation = 0.3;
  RigidTransform before = camera.T_camera_rig;
  before.t.z() -= kDeviation;
  bundle.prior = {.unknowns = {{.camera = 1, .component = 2}},
                  .T_camera_rig = {RigidTransform{}, before},
                  .weight = Eigen::MatrixXd::Constant(1, 1, 1 / 0.015)};
  double squares = 0, count = 0;
  for (const BundleObservation& seen : bundle.observations) {
    if (seen.camera != 1) continue;
    const Eigen::Vector3d p = bundle.T_rig_target[static_cast<size_t>(seen.frame)] *
                              bundle.markers[static_cast<size_t>(seen.marker)].position;
    Eigen::Vector2d here, there;
    ASSERT_TRUE(camera.model->Project(
        camera.params.data(), nullptr, nullptr, camera.T_camera_rig * p, here.data()));
    if (!camera.model->Project(camera.params.data(), nullptr, nullptr, before * p, there.data())) {
      continue;
    }
    squares += (here - there).squaredNorm();
    ++count;
  }
  Uncertainty uncertainty = Stated(bundle, Eigen::Matrix4d::Zero());
  uncertainty.covariance.setZero();
  const std::vector<Finding> found = FindingsOfPrior(bundle, uncertainty);
  ASSERT_EQ(found.size(), 1U);
  EXPECT_EQ(found[0].grade, Grade::kUsable);
  EXPECT_EQ(found[0].what,
            fmt::format("{0}.T_camera_rig.z: the images contradict the earlier calibration by 20.0 "
                        "sigma, {1:.2g} px in the image (known to 0.015 m, with the images 0.3 "
                        "off).",
                        camera.name,
                        std::sqrt(squares / count)));
  EXPECT_EQ(found[0].remedy,
            fmt::format("Was the camera moved on the rig? Then take the prior away: 'free: "
                        "[extrinsics]' for {}. Else look for what is wrong in the new images or in "
                        "the earlier calibration.",
                        camera.name));
}

}  // namespace TEST_FILE
}  // namespace plenocal::testing
