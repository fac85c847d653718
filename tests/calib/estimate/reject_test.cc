// SPDX-License-Identifier: Apache-2.0
#include "calib/estimate/reject.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <map>

#include "calib/base/error.h"
#include "tests/calib/synthetic.h"
#include "tests/refusal.h"

namespace plenocal {
namespace TEST_FILE {

using testing::MakeProblem;
using testing::TrueBundle;

Bundle NoisyBundle() { return TrueBundle(MakeProblem(8, {.frames = 4, .noise = 0.1})); }

size_t CountUsed(const Bundle& bundle) {
  return static_cast<size_t>(std::count_if(bundle.observations.begin(),
                                           bundle.observations.end(),
                                           [](const auto& o) { return o.used; }));
}

TEST(RejectOutliers, TakesOutGrossErrorsAndTakesThemBackWhenNoiseGrows) {
  Bundle bundle = NoisyBundle();
  const size_t all = bundle.observations.size();
  bundle.observations[3].seen.values[0] += 5;  // 50 sigma
  bundle.observations[100].seen.values[1] -= 5;
  const Rejection rejection = RejectOutliers(&bundle);
  EXPECT_EQ(rejection.changed, 2U);
  EXPECT_FALSE(bundle.observations[3].used);
  EXPECT_FALSE(bundle.observations[100].used);
  EXPECT_EQ(CountUsed(bundle), all - 2);
  // Of 280 points of two coordinates exp(-t^2 / 2) = 0.05 / 280.
  EXPECT_NEAR(rejection.threshold, 4.15, 0.1);
  bundle.cameras[0].noise.detector_scale = 50;
  EXPECT_EQ(RejectOutliers(&bundle).changed, 2U);
  EXPECT_EQ(CountUsed(bundle), all);
}

TEST(RejectOutliers, RejectsAViewMostOfWhosePointsDisagree) {
  Bundle bundle = NoisyBundle();
  bundle.T_rig_target[1].t.x() += 0.01;  // some ten pixels
  RejectOutliers(&bundle);
  for (const BundleObservation& observation : bundle.observations) {
    EXPECT_EQ(observation.used, observation.frame != 1);
  }
}

// Half of the points must agree; with one less none of the view is used.
TEST(RejectOutliers, RejectsTheGoodPointsOfAViewMostOfWhosePointsDisagree) {
  Bundle bundle = NoisyBundle();
  std::vector<size_t> view;
  for (size_t i = 0; i < bundle.observations.size(); ++i) {
    if (bundle.observations[i].frame == 1) view.push_back(i);
  }
  const size_t half = (view.size() + 1) / 2;
  for (size_t i = half; i < view.size(); ++i) bundle.observations[view[i]].seen.values[0] += 5;
  RejectOutliers(&bundle);
  for (size_t i = 0; i < view.size(); ++i) {
    EXPECT_EQ(bundle.observations[view[i]].used, i < half);
  }
  // The last good one.
  bundle.observations[view[half - 1]].seen.values[0] += 5;
  if (view.size() % 2 != 0) bundle.observations[view[half - 2]].seen.values[0] += 5;
  RejectOutliers(&bundle);
  for (const BundleObservation& observation : bundle.observations) {
    EXPECT_EQ(observation.used, observation.frame != 1);
  }
}

// One is seen from one place alone, so that its distance is not known.
TEST(RejectLandmarks, RejectsThoseWithoutParallaxAndThoseMostlyWrong) {
  Bundle bundle = TrueBundle(MakeProblem(8, {.frames = 4, .noise = 0.1}));
  constexpr int kFar = 5, kWrong = 7, kGood = 9;
  bundle.T_rig_target[1] = bundle.T_rig_target[0];
  std::map<int, BundleObservation> first;
  for (BundleObservation& each : bundle.observations) {
    if (each.frame == 0) first[each.marker] = each;
    if (each.frame == 1) each.seen.values = first.at(each.marker).seen.values;
  }
  std::erase_if(bundle.observations, [](const BundleObservation& each) {
    return each.marker == kFar && each.frame > 1;
  });
  for (BundleObservation& each : bundle.observations) {
    if (each.marker == kWrong && each.frame > 1) each.seen.values[0] += 40;
    if (each.marker == kGood && each.frame == 3) each.seen.values[0] += 40;
  }
  const Rejection rejection = RejectLandmarks(&bundle);
  std::map<int, int> used;
  for (const BundleObservation& each : bundle.observations) used[each.marker] += each.used ? 1 : 0;
  EXPECT_EQ(used[kFar], 0);
  EXPECT_EQ(used[kWrong], 0) << "two of four";
  EXPECT_EQ(used[kGood], 3) << "one of four";
  EXPECT_EQ(used[20], 4);
  EXPECT_EQ(rejection.changed, 2 + 4 + 1);
}

TEST(DropWeakFrames, LeavesOutFramesWithFewerThanFourMarkers) {
  Bundle bundle = NoisyBundle();
  int kept = 0;
  for (BundleObservation& observation : bundle.observations) {
    if (observation.frame == 2) observation.used = kept++ < 3;
  }
  DropWeakFrames(&bundle);
  for (const BundleObservation& observation : bundle.observations) {
    EXPECT_EQ(observation.used, observation.frame != 2);
  }
}

TEST(SelectFrames, SpreadsThemOverTheRecording) {
  const Bundle bundle = TrueBundle(MakeProblem(8, {.frames = 10}));
  EXPECT_EQ(SelectFrames(bundle, 20), std::vector<bool>(10, true));
  const std::vector<bool> half = SelectFrames(bundle, 5);
  EXPECT_EQ(std::count(half.begin(), half.end(), true), 5);
  for (size_t f = 0; f < 10; ++f) EXPECT_EQ(half[f], f % 2 == 0);
}

TEST(CheckAllCamerasUsed, NamesTheCameraWithoutObservations) {
  Bundle bundle = NoisyBundle();
  bundle.cameras[0].name = "left";
  CheckAllCamerasUsed(bundle);
  for (BundleObservation& observation : bundle.observations) observation.used = false;
  EXPECT_THAT(testing::RefusalOf([&] { CheckAllCamerasUsed(bundle); }, ErrorKind::kJob),
              ::testing::StartsWith("left: "));
}

}  // namespace TEST_FILE
}  // namespace plenocal
