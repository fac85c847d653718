// SPDX-License-Identifier: Apache-2.0
//
// `plenocal suggest`.
#include <nlohmann/json.hpp>

#include "tests/apps/workspace.h"

namespace plenocal::testing {
namespace TEST_FILE {

using ::testing::AllOf;
using ::testing::HasSubstr;
using ::testing::StartsWith;

using SuggestCommand = Workspace;

TEST_F(SuggestCommand, SuggestsFromACalibrationAndFromItsSessionTheSame) {
  WriteProblem(EasyProblem());
  Calibrate();
  const Outcome text = Run({"suggest", "out", "--count", "2", "--picture", "next.svg"});
  ASSERT_EQ(text.status, kDone) << text.err;
  EXPECT_THAT(text.out,
              AllOf(StartsWith("10 frames; sigma of the projection "),
                    HasSubstr("\n  1. target in the "),
                    HasSubstr("\n  2. target in the "),
                    HasSubstr("with all of them: sigma of the projection ")));
  EXPECT_THAT(Read("next.svg"), HasSubstr("<svg"));

  const Outcome from_files = Run({"suggest", "out", "--count", "1", "--json"}),
                from_session = Run({"suggest", "session.yaml", "--count", "1", "--json"});
  ASSERT_EQ(from_files.status, kDone) << from_files.err;
  ASSERT_EQ(from_session.status, kDone) << from_session.err;
  const nlohmann::json a = nlohmann::json::parse(from_files.out),
                       b = nlohmann::json::parse(from_session.out);
  EXPECT_EQ(a["views"][0]["words"], b["views"][0]["words"]);
  EXPECT_EQ(a["verdict"], b["verdict"]);
  EXPECT_EQ(a["frames"], 10);
  const std::string calibration = Read("out/calibration.yaml");
  Write("out/calibration.yaml",
        calibration.substr(0, calibration.find("verdict:")) +
            "verdict: {grade: bad, findings: []}\n");
  EXPECT_THAT(Run({"suggest", "out", "--count", "1"}).out, HasSubstr("so far is bad, and more"))
      << "a verdict without findings";
  const nlohmann::json& view = a["views"][0];
  EXPECT_LT(view["sigma_after"].get<double>(), view["sigma_before"].get<double>());
  EXPECT_EQ(view["sigma_before"], a["sigma_now"]);
  EXPECT_EQ(view["T_camera_target"], view["T_rig_target"]);
  ASSERT_EQ(view["T_rig_target"].size(), 4u);
  EXPECT_EQ(view["T_rig_target"][3], nlohmann::json({0, 0, 0, 1}));
  for (int i = 0; i < 3; ++i) {
    for (int j = 0; j < 3; ++j) {
      double product = 0;
      for (int k = 0; k < 3; ++k) {
        product +=
            view["T_rig_target"][i][k].get<double>() * view["T_rig_target"][j][k].get<double>();
      }
      EXPECT_NEAR(product, i == j ? 1 : 0, 1e-9);
    }
  }
  EXPECT_GE(view["outline"]["cam0"][0].size(), 20u);
}

TEST_F(SuggestCommand, StartsBeforeTheFirstImage) {
  const Outcome outcome = Run({"suggest",
                               "--target",
                               "aprilgrid:6x6:88mm:0.3",
                               "--size",
                               "1280x960",
                               "--angle",
                               "70",
                               "--json"});
  ASSERT_EQ(outcome.status, kDone) << outcome.err;
  const nlohmann::json result = nlohmann::json::parse(outcome.out);
  EXPECT_TRUE(result["sigma_now"].is_null());
  ASSERT_EQ(result["views"].size(), 5u);
  EXPECT_EQ(result["views"][0]["criterion"], "undetermined");
  EXPECT_GT(result["views"][0]["tilt"].get<double>(), 15);
  EXPECT_EQ(result["views"][4]["criterion"], "sigma");
  EXPECT_EQ(result["verdict"], nullptr);
}

TEST_F(SuggestCommand, OfTooFewImagesAssumesTheLensThatItIsGiven) {
  SyntheticProblem problem = EasyProblem();
  problem.input.cameras[0].views.resize(1);
  WriteProblem(problem);
  const Outcome without = Run({"suggest", "session.yaml"});
  EXPECT_TRUE(without.status == kDone || without.err.find("--angle") != std::string::npos);
  const Outcome with = Run({"suggest", "session.yaml", "--angle", "60"});
  ASSERT_EQ(with.status, kDone) << with.err;
  EXPECT_THAT(with.out, HasSubstr("  1. target in the "));
}

TEST_F(SuggestCommand, RefusesWhatItCannotUse) {
  WriteProblem(EasyProblem());
  Calibrate();
  const auto fails = [&](const std::vector<std::string>& arguments, const char* part) {
    std::vector<std::string> all{"suggest"};
    all.insert(all.end(), arguments.begin(), arguments.end());
    const Outcome outcome = Run(all);
    EXPECT_EQ(outcome.status, kWrongInput) << part;
    EXPECT_THAT(outcome.err, HasSubstr(part));
    EXPECT_EQ(Lines(outcome.err).size(), 1u) << outcome.err;
  };
  fails({}, "--target, --size and --angle");
  fails({"nowhere"}, "nowhere");
  fails({"out", "--picture", "next.gif"}, ".svg or .png");
  fails({"out", "--near", "2", "--far", "1"}, "--near and --far");
  fails({"--target", "chessboard:9x6:25mm", "--size", "1280", "--angle", "70"}, "1280");
  fails({"--target",
         "chessboard:9x6:25mm",
         "--size",
         "1280x960",
         "--angle",
         "70",
         "--model",
         "focused-plenoptic"},
        "needs more than a lens angle");
  const Outcome nowhere = Run({"suggest", "out", "--near", "500", "--far", "600"});
  EXPECT_EQ(nowhere.status, kJobFailed);
  EXPECT_THAT(nowhere.err, HasSubstr("no pose of the target is feasible"));
}

}  // namespace TEST_FILE
}  // namespace plenocal::testing
