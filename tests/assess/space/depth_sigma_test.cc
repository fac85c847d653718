// SPDX-License-Identifier: Apache-2.0
#include "assess/space/depth_sigma.h"

#include <gtest/gtest.h>

#include <cmath>
#include <string>
#include <vector>

#include "calib/base/error.h"
#include "models/registry.h"

namespace plenocal {
namespace TEST_FILE {

constexpr double kF = 600, kBaseline = 0.2, kDistance = 2;

/// Cameras side by side that look the same way: the first, and those at these baselines.
RigEstimate ParallelRig(const std::vector<double>& baselines) {
  RigEstimate rig;
  for (size_t c = 0; c <= baselines.size(); ++c) {
    BundleCamera camera;
    camera.name = std::to_string(c);
    camera.image_size = {321, 241};
    camera.model = FindModel(CameraModels(), "pinhole");
    camera.params = {kF, kF, 160, 120};
    camera.fixed.assign(4, false);
    camera.is_master = c == 0;
    if (c > 0) camera.T_camera_rig.t.x() = -baselines[c - 1];
    rig.bundle.cameras.push_back(camera);
    rig.sigma_px.push_back(0.3);
    rig.factors.push_back(1);
  }
  rig.lenses.resize(baselines.size() + 1);
  return rig;
}

/// Sigma of z, mm, by an error of one unknown alone, which `index` gives.
template <typename Index>
double ByOne(const RigEstimate& rig, double sigma, const Index& index) {
  const RigUnknowns unknowns = MakeRigUnknowns(rig.bundle, kDistance);
  const ProjectionSigma depth = DepthSigma(rig, unknowns, kDistance);
  const Eigen::Index i = index(unknowns), size = unknowns.unit.size();
  Eigen::MatrixXd covariance = Eigen::MatrixXd::Zero(size, size);
  covariance(i, i) = std::pow(sigma / unknowns.unit[i], 2);
  return depth.Of(covariance);
}

// z = f b / d, d the disparity of a pair that is parallel.
TEST(DepthSigma, IsThatOfTheDisparity) {
  const RigEstimate rig = ParallelRig({kBaseline});
  const auto shift = [](const RigUnknowns& u) { return u.extrinsics[1]; };
  EXPECT_NEAR(ByOne(rig, 0.001, shift), 1e3 * 0.001 * kDistance / kBaseline, 1e-6);
  const auto centre = [](size_t camera) {
    return [camera](const RigUnknowns& u) { return u.params[camera][2]; };
  };
  const double by_px = 1e3 * kDistance * kDistance / (kF * kBaseline);
  EXPECT_NEAR(ByOne(rig, 0.1, centre(0)), 0.1 * by_px, 1e-6);
  EXPECT_NEAR(ByOne(rig, 0.1, centre(1)), 0.1 * by_px, 1e-6);
  // In the middle of the images they have other places, farther out more.
  const auto focal = [](const RigUnknowns& u) { return u.params[0][0]; };
  EXPECT_GT(ByOne(rig, 1, focal), 0.02 * by_px);
  EXPECT_LT(ByOne(rig, 1, focal), 160 / kF * by_px);
}

TEST(DepthSigma, IsThatOfThePoseWhereNoParameterIsEstimated) {
  RigEstimate rig = ParallelRig({kBaseline});
  for (BundleCamera& camera : rig.bundle.cameras) camera.fixed.assign(4, true);
  const auto shift = [](const RigUnknowns& u) { return u.extrinsics[1]; };
  EXPECT_NEAR(ByOne(rig, 0.001, shift), 1e3 * 0.001 * kDistance / kBaseline, 1e-6);
}

TEST(DepthSigma, HasTheFactorOfItsCamera) {
  RigEstimate rig = ParallelRig({kBaseline});
  const auto shift = [](const RigUnknowns& u) { return u.extrinsics[1]; };
  const double before = ByOne(rig, 0.001, shift);
  rig.factors = {9, 4};
  EXPECT_NEAR(ByOne(rig, 0.001, shift), 2 * before, 1e-6);
}

TEST(DepthSigma, IsTheMeanOfThePairs) {
  const RigEstimate rig = ParallelRig({kBaseline, 2 * kBaseline});
  const auto centre = [](const RigUnknowns& u) { return u.params[0][2]; };
  const double by_px = 1e3 * kDistance * kDistance / (kF * kBaseline);
  // Cells of the first camera that the second sees are more than those that the third sees.
  EXPECT_GT(ByOne(rig, 0.1, centre), 0.1 * by_px * std::sqrt((1 + 0.25) / 2));
  EXPECT_LT(ByOne(rig, 0.1, centre), 0.1 * by_px);
}

TEST(DepthSigma, NamesItself) {
  const RigEstimate rig = ParallelRig({kBaseline});
  const ProjectionSigma depth = DepthSigma(rig, MakeRigUnknowns(rig.bundle, 1), kDistance);
  EXPECT_EQ(depth.Words().of, "z at 2 m");
  EXPECT_EQ(depth.Words().unit, "mm");
  EXPECT_EQ(depth.Words().determined, 2000);
}

TEST(DepthSigma, NeedsTwoCamerasThatSeeThere) {
  const RigEstimate one = ParallelRig({}), pair = ParallelRig({kBaseline});
  EXPECT_THROW(DepthSigma(one, MakeRigUnknowns(one.bundle, 1), kDistance), Error);
  // At 0.2 m the images have nothing in common.
  EXPECT_THROW(DepthSigma(pair, MakeRigUnknowns(pair.bundle, 1), 0.2), Error);
}

}  // namespace TEST_FILE
}  // namespace plenocal
