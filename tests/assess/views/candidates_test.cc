// SPDX-License-Identifier: Apache-2.0
#include "assess/views/candidates.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace plenocal::testing {
namespace TEST_FILE {

using ::testing::DoubleNear;
using ::testing::ElementsAre;

TEST(CandidatesStay, WhileNoNumberOfACameraChangesMuch) {
  const std::vector<CandidateBasis> made_for{{{300, 5}, {false, true}, 2, {0.5, 4}},
                                             {{-400, 7}, {false, false}, 0.1, {0.8, 3}}};
  RigUnknowns unknowns;
  unknowns.params = {{0, -1}, {1, 2}};
  unknowns.unit = Eigen::Vector3d(300, 400, 10);
  const auto stays = [&](size_t c, const auto& change) {
    std::vector<CandidateBasis> cameras = made_for;
    change(&cameras[c]);
    return CandidatesStay(made_for, cameras, unknowns);
  };
  for (const size_t c : {size_t{0}, size_t{1}}) {
    const auto param = [&](size_t k, double more) {
      return stays(c, [&](CandidateBasis* camera) { camera->params[k] += more; });
    };
    for (const double sign : {-1.0, 1.0}) {
      EXPECT_TRUE(param(0, sign * 2.99));
      EXPECT_FALSE(param(0, sign * 4.01));
      EXPECT_EQ(param(1, sign * 0.11), c == 0) << "a fixed one need not stay";
      EXPECT_TRUE(param(1, sign * 0.09));
    }
    // Relative to the earlier value.
    for (const double factor : {0.949, 0.951, 1.049, 1.051}) {
      const bool expected = std::abs(factor - 1) < 0.05;
      const auto scaled = [&](const auto& number) {
        return stays(c, [&](CandidateBasis* camera) { number(camera) *= factor; });
      };
      EXPECT_EQ(scaled([](auto* camera) -> double& { return camera->sigma_px; }), expected);
      EXPECT_EQ(scaled([](auto* camera) -> double& { return camera->range.nearest; }), expected);
      EXPECT_EQ(scaled([](auto* camera) -> double& { return camera->range.farthest; }), expected);
    }
    EXPECT_FALSE(stays(c, [](CandidateBasis* camera) { camera->fixed.flip(); }));
  }
  EXPECT_FALSE(CandidatesStay({}, made_for, unknowns));
}

TEST(KeepSpread, KeepsTheFirstAndSomeOfEachPlace) {
  // Two cameras in turn, the first with the target in the middle or lower right of its image, the
  // second with it in the middle.
  std::vector<TargetPose> poses;
  std::vector<size_t> best;
  for (size_t i = 0; i < 200; ++i) {
    const Eigen::Vector2d place = i % 2 == 1   ? Eigen::Vector2d(75, 75)
                                  : i % 4 == 0 ? Eigen::Vector2d(150, 50)
                                               : Eigen::Vector2d(290, 90);
    poses.push_back({.camera = i % 2, .place = place});
    best.push_back(199 - i);
  }
  // Three of each of 18 places behind the first 36.
  std::vector<size_t> expected(best.begin(), best.begin() + 36);
  expected.insert(expected.end(), {163, 162, 161, 160, 159, 158, 156, 154, 152});
  EXPECT_EQ(KeepSpread(best, poses, {{300, 100}, {150, 150}}, 36), expected);
}

TEST(JudgedDistances, AreThoseOfAllCameras) {
  const std::vector<CandidateBasis> cameras{
      {{}, {}, 0, {0.25, 0.8}}, {{}, {}, 0, {0.2, 0.4}}, {{}, {}, 0, {0.3, 0.6}}};
  EXPECT_THAT(JudgedDistances(cameras, false), ElementsAre(0.2, 0.8, 8));
  EXPECT_THAT(JudgedDistances(cameras, true),
              ElementsAre(0.2, DoubleNear(0.32, 1e-12), 0.8));  // 1 / z of 5, 3.125 and 1.25
}

}  // namespace TEST_FILE
}  // namespace plenocal::testing
