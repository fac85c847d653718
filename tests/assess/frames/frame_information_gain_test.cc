// SPDX-License-Identifier: Apache-2.0
#include "assess/frames/frame_information_gain.h"

#include <gtest/gtest.h>

#include "assess/views/next_views.h"
#include "assess/views/view_information.h"
#include "calib/estimate/calibrate.h"
#include "calib/estimate/describe.h"
#include "tests/calib/synthetic.h"

namespace plenocal::testing {
namespace TEST_FILE {

// A rig of one camera after some frames, and what it sees of a board without noise.
class Worth : public ::testing::Test {
 protected:
  Worth() : problem_(MakeProblem(4, {.frames = 8, .noise = 0.1})) {
    const CalibrationRecord record = Describe(Calibrate(problem_.input, {}));
    rig_ = MakeRigEstimate(record);
    shape_.markers = problem_.markers;
    SetFactors(record, shape_, &rig_);
  }

  [[nodiscard]] std::vector<View> Seen(const RigidTransform& T_rig_target) const {
    const BundleCamera& camera = rig_.bundle.cameras[0];
    View view;
    for (const auto& [number, position] : shape_.markers) {
      Observation seen{.marker = number};
      if (camera.model->Project(camera.params.data(),
                                nullptr,
                                nullptr,
                                T_rig_target * position,
                                seen.values.data())) {
        view.observations.push_back(seen);
      }
    }
    return {view};
  }
  [[nodiscard]] NextViews Suggested(const RigEstimate& rig) const {
    return ChooseNextViews(rig, shape_, {.count = 1});
  }

  SyntheticProblem problem_;
  RigEstimate rig_;
  ViewTarget shape_;
};

TEST_F(Worth, OfTheBestViewIsItsWholeGain) {
  const NextView best = Suggested(rig_).views.at(0);
  const FrameInformationGain gain = FrameGainEvaluator(rig_, shape_, Suggested(rig_))
                                        .Evaluate(best.T_rig_target, Seen(best.T_rig_target));
  // Its markers are taken as found where the suggestion counts those that are near the border out.
  EXPECT_NEAR(gain.share, 1, 0.1);
  EXPECT_NEAR(gain.sigma_before, best.sigma_before, 1e-9);
  // The suggestion's is a mean over poses as a person carries them out.
  EXPECT_NEAR(gain.sigma_after / best.sigma_after, 1, 0.3);
}

TEST_F(Worth, OfAViewThatThereIsAlreadyIsLittle) {
  const RigidTransform& first = rig_.bundle.T_rig_target[0];
  const FrameInformationGain gain =
      FrameGainEvaluator(rig_, shape_, Suggested(rig_)).Evaluate(first, Seen(first));
  EXPECT_LT(gain.share, 0.5);
  EXPECT_LT(gain.sigma_after, gain.sigma_before);
}

TEST_F(Worth, OfTooFewPointsIsNothing) {
  const RigidTransform& first = rig_.bundle.T_rig_target[0];
  std::vector<View> views = Seen(first);
  views[0].observations.resize(2);
  const FrameInformationGain gain =
      FrameGainEvaluator(rig_, shape_, Suggested(rig_)).Evaluate(first, views);
  EXPECT_EQ(gain.share, 0);
  EXPECT_EQ(gain.sigma_after, gain.sigma_before);
}

// Each view of a rig with jitter has an entry of its own in the jitter's tables.
TEST_F(Worth, OfARigWithJitterLowersTheSigma) {
  const NextViews suggested = Suggested(rig_);
  const RigidTransform T_rig_target = suggested.views.at(0).T_rig_target;
  const FrameInformationGain rigid =
      FrameGainEvaluator(rig_, shape_, suggested).Evaluate(T_rig_target, Seen(T_rig_target));
  RigEstimate loose = rig_;
  Bundle& bundle = loose.bundle;
  const size_t views = bundle.T_rig_target.size() * bundle.cameras.size();
  bundle.jitter.delta.assign(views, Vector6d::Zero());
  bundle.jitter.misplaced.assign(views, false);
  bundle.jitter.translation_sigma = 1e-4;
  bundle.jitter.rotation_sigma = 1e-4;
  const FrameInformationGain gain =
      FrameGainEvaluator(loose, shape_, suggested).Evaluate(T_rig_target, Seen(T_rig_target));
  EXPECT_GT(gain.sigma_after, 0);
  EXPECT_LE(gain.sigma_after, gain.sigma_before);
  EXPECT_GT(gain.sigma_before, 0.99 * rigid.sigma_before);
}

}  // namespace TEST_FILE
}  // namespace plenocal::testing
