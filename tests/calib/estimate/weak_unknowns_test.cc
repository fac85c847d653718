// SPDX-License-Identifier: Apache-2.0
//
// Weak unknowns of a made-up uncertainty.
#include "calib/estimate/weak_unknowns.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <limits>

#include "tests/calib/synthetic.h"

namespace plenocal {
namespace TEST_FILE {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using testing::MakeProblem;
using testing::TrueBundle;

class WeakDirections : public ::testing::Test {
 protected:
  WeakDirections() : bundle_(TrueBundle(MakeProblem(1, {.frames = 2}))) {
    bundle_.cameras[0].name = "cam";
    const BundleCamera& camera = bundle_.cameras[0];
    std::vector<double> small;
    for (size_t k = 0; k < camera.params.size(); ++k) {
      uncertainty_.names.push_back("cam." + std::string(camera.model->params[k].name));
      small.push_back(1e-6);
    }
    uncertainty_.param_std_errors = {small};
    const auto n = static_cast<Eigen::Index>(small.size());
    uncertainty_.correlation = Eigen::MatrixXd::Identity(n, n);
  }

  [[nodiscard]] std::vector<WeakUnknowns> Find() const {
    return FindWeakUnknowns(bundle_, uncertainty_);
  }
  void Correlate(Eigen::Index a, Eigen::Index b, double correlation) {
    uncertainty_.correlation(a, b) = uncertainty_.correlation(b, a) = correlation;
  }

  Bundle bundle_;
  Uncertainty uncertainty_;
};

TEST_F(WeakDirections, OfAGoodCalibrationAreNone) { EXPECT_TRUE(Find().empty()); }

TEST_F(WeakDirections, AreGroupsOfCorrelatedParameters) {
  Correlate(0, 1, -0.995);
  Correlate(1, 2, 0.993);
  Correlate(3, 4, 0.98);
  const std::vector<WeakUnknowns> weak = Find();
  ASSERT_EQ(weak.size(), 1U);
  EXPECT_FALSE(weak[0].open);
  EXPECT_THAT(weak[0].names, ElementsAre("cam.f_x", "cam.f_y", "cam.c_x"));
  EXPECT_THAT(weak[0].what, HasSubstr("0.9950"));
  EXPECT_EQ(weak[0].remedy.back(), '.');
}

TEST_F(WeakDirections, AreParametersWithALargeStandardError) {
  uncertainty_.param_std_errors[0][0] = 0.2 * bundle_.cameras[0].params[0];
  uncertainty_.param_std_errors[0][1] = 0.05 * bundle_.cameras[0].params[1];
  const std::vector<WeakUnknowns> weak = Find();
  ASSERT_EQ(weak.size(), 1U);
  EXPECT_THAT(weak[0].names, ElementsAre("cam.f_x"));
  EXPECT_THAT(weak[0].what, HasSubstr("10 %"));
}

TEST_F(WeakDirections, StartWithOpenOnesAndNameNoUnknownTwice) {
  uncertainty_.open.push_back({{{"cam.f_x", 1.0}, {"cam.f_y", 0.9}}, 3.2});
  uncertainty_.open.push_back({{{"cam.A_2", 1.0}}, std::numeric_limits<double>::infinity()});
  uncertainty_.param_std_errors[0][0] = bundle_.cameras[0].params[0];
  Correlate(0, 1, 0.9999);
  const std::vector<WeakUnknowns> weak = Find();
  ASSERT_EQ(weak.size(), 2U);
  EXPECT_TRUE(weak[0].open);
  EXPECT_THAT(weak[0].names, ElementsAre("cam.f_x", "cam.f_y"));
  EXPECT_THAT(weak[0].what, HasSubstr("3.2 times"));
  EXPECT_THAT(weak[1].what, HasSubstr("nothing in the data"));
}

// The remedy of one open direction of these unknowns.
std::string RemedyOf(const Bundle& bundle,
                     Uncertainty uncertainty,
                     const std::vector<std::string>& names) {
  auto& direction = uncertainty.open.emplace_back();
  for (const std::string& name : names) direction.parts.emplace_back(name, 1.0);
  direction.sigma = 5;
  const std::vector<WeakUnknowns> weak = FindWeakUnknowns(bundle, uncertainty);
  EXPECT_EQ(weak.size(), 1U);
  return weak.empty() ? std::string() : weak[0].remedy;
}

TEST_F(WeakDirections, HaveARemedyByTheirKind) {
  const char* const frames = "The extrinsics of a camera follow from frames that it shares";
  const char* const motion = "Cameras and targets that share no view are placed by motion";
  const std::string of_extrinsics = RemedyOf(bundle_, uncertainty_, {"cam.T_camera_rig.x"});
  EXPECT_THAT(of_extrinsics, HasSubstr(frames));
  EXPECT_THAT(of_extrinsics, ::testing::Not(HasSubstr(motion)));
  const std::string of_targets =
      RemedyOf(bundle_, uncertainty_, {"cam.T_camera_rig.x", "wall.T_target.x"});
  EXPECT_THAT(of_targets, HasSubstr(motion));
  EXPECT_THAT(of_targets, ::testing::Not(HasSubstr(frames)));
  const std::string of_params = RemedyOf(bundle_, uncertainty_, {"cam.f_x", "cam.f_y"});
  EXPECT_EQ(of_params.find(frames), std::string::npos);
  EXPECT_NE(of_params, of_extrinsics);
}

TEST_F(WeakDirections, OfTwoCamerasHaveTheirCommonRemedyOnce) {
  Bundle two = TrueBundle(MakeProblem(1, {.cameras = 2, .frames = 2}));
  two.cameras[0].name = "cam";
  two.cameras[1].name = "right";
  const std::string of_one = RemedyOf(bundle_, uncertainty_, {"cam.f_x"});
  EXPECT_NE(of_one, "");
  uncertainty_.param_std_errors.push_back(uncertainty_.param_std_errors[0]);
  EXPECT_EQ(RemedyOf(two, uncertainty_, {"cam.f_x", "right.f_x"}), of_one);
}

TEST(Listed, ShortensLongLists) {
  EXPECT_EQ(Listed({"a", "b", "c"}), "a, b, c");
  std::vector<std::string> many(20, "x");
  EXPECT_THAT(Listed(many), HasSubstr("and 8 more"));
}

}  // namespace TEST_FILE
}  // namespace plenocal
