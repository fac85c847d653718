// SPDX-License-Identifier: Apache-2.0
#include "calib/estimate/start_bundle.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <string>
#include <tuple>

#include "calib/base/error.h"
#include "tests/calib/random.h"
#include "tests/calib/synthetic.h"
#include "tests/refusal.h"

namespace plenocal {
namespace TEST_FILE {

using testing::MakeProblem;
using testing::Random;
using testing::SyntheticProblem;

// The truth as start: parameters, extrinsics, poses and markers need no search.
CalibrationStart TrueStart(const SyntheticProblem& problem) {
  return {.params = problem.params,
          .T_camera_rig = problem.T_camera_rig,
          .T_rig_target = problem.T_rig_target,
          .markers = problem.markers};
}

SyntheticProblem PairFromTruth(unsigned seed, double noise = 0) {
  SyntheticProblem problem =
      MakeProblem(seed, {.cameras = 2, .frames = 5, .noise = noise, .marker_tolerance = 1e-4});
  problem.input.start = TrueStart(problem);
  return problem;
}

double Distance(const RigidTransform& a, const RigidTransform& b) {
  return (a.R - b.R).norm() + (a.t - b.t).norm();
}

TEST(GuessBundle, TakesAStartAsItIs) {
  SyntheticProblem problem = PairFromTruth(3);
  problem.input.start->markers.erase(7);
  const BundleGuess guess = GuessBundle(problem.input, 1);
  ASSERT_EQ(guess.frames.size(), 5U);
  EXPECT_TRUE(std::ranges::is_sorted(guess.frames));
  for (size_t f = 0; f < guess.frames.size(); ++f) {
    EXPECT_LT(Distance(guess.bundle.T_rig_target[f], problem.T_rig_target.at(guess.frames[f])),
              1e-12);
  }
  for (size_t c = 0; c < 2; ++c) {
    const BundleCamera& camera = guess.bundle.cameras[c];
    EXPECT_EQ(camera.params, problem.params[c]);
    EXPECT_EQ(camera.is_master, c == 0);
    EXPECT_LT(Distance(camera.T_camera_rig, problem.T_camera_rig[c]), 1e-12);
  }
  for (const BundleMarker& marker : guess.bundle.markers) {
    EXPECT_EQ(marker.nominal, problem.input.markers.at(marker.number));
    EXPECT_EQ(marker.position,
              marker.number == 7 ? marker.nominal : problem.markers.at(marker.number));
  }
  EXPECT_EQ(guess.bundle.marker_freedom.Sigma(), 1e-4);
}

TEST(GuessBundle, FindsThePoseOfAFrameThatTheStartLacks) {
  SyntheticProblem problem = PairFromTruth(4);
  const std::string frame = problem.T_rig_target.begin()->first;
  problem.input.start->T_rig_target.erase(frame);
  problem.input.markers = problem.markers;
  const BundleGuess guess = GuessBundle(problem.input, 1);
  ASSERT_EQ(guess.frames[0], frame);
  EXPECT_LT(Distance(guess.bundle.T_rig_target[0], problem.T_rig_target.at(frame)), 1e-5);
}

TEST(GuessBundle, SortsObservationsByFrameCameraAndMarker) {
  SyntheticProblem problem = PairFromTruth(5);
  size_t count = 0;
  for (CameraInput& camera : problem.input.cameras) {
    std::ranges::reverse(camera.views);
    for (View& view : camera.views) {
      std::ranges::reverse(view.observations);
      count += view.observations.size();
      for (const Observation& seen : view.observations) {
        view.by_nuisance.push_back({static_cast<double>(seen.marker), 0});
      }
    }
  }
  const BundleGuess guess = GuessBundle(problem.input, 2);
  EXPECT_EQ(guess.bundle.observations.size(), count);
  EXPECT_TRUE(std::ranges::is_sorted(guess.bundle.observations, {}, [](const auto& each) {
    return std::tuple(each.frame, each.camera, each.marker);
  }));
  for (const BundleObservation& each : guess.bundle.observations) {
    EXPECT_EQ(guess.bundle.markers[static_cast<size_t>(each.marker)].number, each.seen.marker);
    EXPECT_EQ(each.by_nuisance[0], each.seen.marker);  // stays with its observation
  }
}

TEST(GuessBundle, TakesTheCameraThatExplainsAFrameBest) {
  // One of two cameras has six points with errors of some pixels, in one corner of the target.
  for (const size_t poor : {0, 1}) {
    SyntheticProblem problem = PairFromTruth(6);
    Random random(2);
    problem.input.markers = problem.markers;
    const std::string frame = problem.T_rig_target.begin()->first;
    problem.input.start->T_rig_target.erase(frame);
    View& view = problem.input.cameras[poor].views[0];
    ASSERT_EQ(view.frame, frame);
    std::erase_if(view.observations, [](const Observation& seen) {
      return seen.marker % 10 > 2 || seen.marker / 10 > 1;
    });
    ASSERT_GE(view.observations.size(), 4U);
    for (Observation& seen : view.observations) seen.values[0] += random.Gaussian(3);
    const BundleGuess guess = GuessBundle(problem.input, 1);
    EXPECT_LT(Distance(guess.bundle.T_rig_target[0], problem.T_rig_target.at(frame)), 1e-5);
  }
}

TEST(GuessBundle, NamesWhatItLeavesOut) {
  SyntheticProblem problem = PairFromTruth(7);
  problem.input.cameras[1].views[2].observations[4].marker = 99999;
  const std::string frame = problem.input.cameras[0].views[3].frame;
  problem.input.start->T_rig_target.erase(frame);
  for (CameraInput& camera : problem.input.cameras) {
    for (View& view : camera.views) {
      if (view.frame == frame) view.observations.resize(3);
    }
  }
  problem.input.markers[500] = {1, 2, 3};  // which no image shows
  problem.input.distances = {
      {.markers_a = {2}, .markers_b = {3}, .length = 0.03, .sigma = 1e-4, .name = "2 to 3"},
      {.markers_a = {2}, .markers_b = {500}, .length = 3, .sigma = 1e-4, .name = "2 to 500"}};
  const BundleGuess guess = GuessBundle(problem.input, 1);
  ASSERT_EQ(guess.left_out.size(), 3U);
  EXPECT_EQ(guess.left_out[0].where, "cam1 frame 0002 marker 99999");
  EXPECT_EQ(guess.left_out[0].camera, "cam1");
  EXPECT_EQ(guess.left_out[0].frame, "0002");
  EXPECT_EQ(guess.left_out[0].marker, "99999");
  EXPECT_FALSE(guess.left_out[0].whole);
  EXPECT_EQ(guess.left_out[1].where, "frame " + frame);
  EXPECT_TRUE(guess.left_out[1].whole);
  EXPECT_THAT(guess.left_out[1].reason, ::testing::HasSubstr("4 or more markers"));
  EXPECT_EQ(guess.left_out[2].where, "distance 2 to 500");
  EXPECT_EQ(guess.left_out[2].reason, "no image shows marker 500");
  EXPECT_EQ(guess.frames.size(), 4U);
  ASSERT_EQ(guess.bundle.distances.size(), 1U);
  const auto number = [&](const std::vector<int>& markers) {
    return guess.bundle.markers[static_cast<size_t>(markers[0])].number;
  };
  EXPECT_EQ(number(guess.bundle.distances[0].markers_a), 2);
  EXPECT_EQ(number(guess.bundle.distances[0].markers_b), 3);
}

TEST(GuessBundle, WithoutAFrameEndsInAMessage) {
  SyntheticProblem problem = MakeProblem(8, {.frames = 5});
  problem.input.start = TrueStart(problem);
  problem.input.start->T_rig_target.clear();
  for (View& view : problem.input.cameras[0].views) view.observations.resize(2);
  EXPECT_THAT(testing::RefusalOf([&] { GuessBundle(problem.input, 1); }, ErrorKind::kJob),
              ::testing::HasSubstr("nothing to calibrate"));
}

TEST(GuessBundle, AssumesTheMedianSigmaWhereADetectorStatesNone) {
  SyntheticProblem problem = PairFromTruth(9, 0.2);
  std::vector<Observation>& seen = problem.input.cameras[0].views[0].observations;
  seen[0].detector_sigma = 0;
  seen[1].detector_sigma = 0.9;
  for (View& view : problem.input.cameras[1].views) {
    for (Observation& each : view.observations) each.detector_sigma = 0;
  }
  const BundleGuess guess = GuessBundle(problem.input, 1);
  ASSERT_EQ(guess.sigmas.size(), 2U);
  EXPECT_TRUE(guess.sigmas[0].stated);
  EXPECT_EQ(guess.sigmas[0].typical, 0.2);
  EXPECT_FALSE(guess.sigmas[1].stated);
  EXPECT_EQ(guess.sigmas[1].typical, 1);
  for (const BundleObservation& each : guess.bundle.observations) {
    const double own = each.seen.detector_sigma;
    EXPECT_EQ(each.assumed_sigma, own > 0 ? own : each.camera == 0 ? 0.2 : 1);
  }
}

TEST(GuessBundle, GivesATiedParameterTheValueOfItsRoot) {
  SyntheticProblem problem = PairFromTruth(10);
  CameraInput& camera = problem.input.cameras[1];
  camera.rules.resize(problem.params[1].size());
  camera.rules[2].tied_to = ParamIndex{0, 3};  // of the other camera
  camera.rules[1].tied_to = ParamIndex{1, 0};
  const BundleGuess guess = GuessBundle(problem.input, 1);
  const std::vector<double>& params = guess.bundle.cameras[1].params;
  EXPECT_EQ(params[2], problem.params[0][3]);
  EXPECT_EQ(params[1], problem.params[1][0]);
  EXPECT_EQ(params[3], problem.params[1][3]);
}

TEST(GuessBundle, StartsFromThePriorUnlessItContradictsTheImages) {
  SyntheticProblem problem = MakeProblem(12, {.frames = 8, .noise = 0.05});
  CalibrationPrior prior;
  for (const double factor : {1.001, 1.3}) {
    prior.unknowns.clear();
    for (size_t k = 0; k < 2; ++k) {
      prior.unknowns.push_back(
          {.camera = 0, .param = k, .component = 0, .value = factor * problem.params[0][k]});
      problem.input.cameras[0].initial[k] = factor * problem.params[0][k];
    }
    prior.T_camera_rig = {RigidTransform{}};
    prior.weight = Eigen::Matrix2d::Identity();
    problem.input.prior = prior;
    const BundleGuess guess = GuessBundle(problem.input, 1);
    const double f_x = guess.bundle.cameras[0].params[0];
    if (factor < 1.1) {
      EXPECT_EQ(f_x, *problem.input.cameras[0].initial[0]);
    } else {
      EXPECT_NEAR(f_x / problem.params[0][0], 1, 0.05);
    }
  }
}

}  // namespace TEST_FILE
}  // namespace plenocal
