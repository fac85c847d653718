// SPDX-License-Identifier: Apache-2.0
#include "calib/prior/prior_agreement.h"

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>

#include "tests/calib/synthetic.h"

namespace plenocal::testing {
namespace TEST_FILE {

using ::testing::ElementsAre;
using ::testing::HasSubstr;

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

}  // namespace TEST_FILE
}  // namespace plenocal::testing
