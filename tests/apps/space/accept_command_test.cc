// SPDX-License-Identifier: Apache-2.0
//
// `plenocal accept`: lengths of a simulated target against their true and against wrong references.
#include <fmt/format.h>
#include <gmock/gmock.h>

#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "tests/apps/space/simulated_pair.h"
#include "tests/apps/workspace.h"

namespace plenocal::testing {
namespace TEST_FILE {

using ::testing::HasSubstr;
using Json = nlohmann::json;

class Accept : public Workspace {
 protected:
  void SetUp() override {
    Workspace::SetUp();
    Write("board.yaml", kBoard);
    Write("set.yaml", PairSpec(1, "frames: 12, distance: [0.4, 1.1], partial: 0"));
    Write("new.yaml", PairSpec(2, "frames: 3, distance: [0.9, 1.1], partial: 0"));
    for (const std::string name : {"set", "new"}) {
      ASSERT_EQ(Run({"simulate", name + ".yaml", "--points", "-o", name}).status, 0);
    }
    ASSERT_EQ(Run({"calibrate", "set/session.yaml", "-o", "result", "--no-report"}).status, 0);
  }

  // Two lines of lengths between centres of tags, `scale` times the true ones.
  static std::string Bars(double scale, const std::string& more = {}) {
    std::string text =
        "plenocal: 1\nlimit: {constant: 2 mm, per_metre: 1 mm}\n" + more + "lines:\n";
    for (const auto& [name, step] : {std::pair{"row", 1}, {"column", 6}}) {
      text += fmt::format("  - name: {}\n    bars:\n", name);
      for (int k = 1; k < 6; ++k) {
        text += fmt::format("      - {{between: [tag 0, tag {}], length: {:.9f}, sigma: 3 um}}\n",
                            k * step,
                            scale * k * kTagPitch);
      }
    }
    return text;
  }

  [[nodiscard]] Outcome RunAccept(const std::string& bars, std::vector<std::string> more = {}) {
    Write("bars.yaml", bars);
    std::vector<std::string> words{"accept",
                                   "result",
                                   "bars.yaml",
                                   "left=new/detections_left.csv",
                                   "right=new/detections_right.csv"};
    words.insert(words.end(), more.begin(), more.end());
    return Run(words);
  }
};

TEST_F(Accept, TrueLengthsPassAndTheStatedErrorsHold) {
  const Outcome outcome = RunAccept(Bars(1), {"-o", "accepted"});
  ASSERT_EQ(outcome.status, 0) << outcome.err;
  EXPECT_THAT(outcome.out, HasSubstr("pass: 20 lengths"));
  EXPECT_THAT(outcome.out, HasSubstr("it lacks: 2 measuring lines of 7"));
  const Json json = Json::parse(Read("accepted/acceptance.json"));
  EXPECT_TRUE(json["passes"]);
  EXPECT_FALSE(json["complete"]);
  EXPECT_GT(json["probability"], 1e-3);
  EXPECT_LT(std::abs(json["scale"].get<double>()), 4 * json["scale_sigma"].get<double>());
  EXPECT_TRUE(json["findings"].empty());
  const Table rows(Read("accepted/acceptance.csv"));
  ASSERT_EQ(rows.Rows(), 20U);  // one image of the third frame lacks tag 0
  const std::vector<double> deviation = rows.Numbers("deviation"), limit = rows.Numbers("limit"),
                            measured = rows.Numbers("measured"),
                            reference = rows.Numbers("reference");
  for (size_t i = 0; i < deviation.size(); ++i) {
    EXPECT_NEAR(deviation[i], measured[i] - reference[i], 2e-8);
    // Guarded by twice 3 um.
    EXPECT_NEAR(limit[i], 2e-3 + 1e-3 * reference[i] - 6e-6, 1e-8);
  }
  EXPECT_THAT(Read("accepted/acceptance.html"), HasSubstr("pass: 20 lengths"));
}

TEST_F(Accept, LengthsOfAnotherScaleFailAndTheScaleIsNamed) {
  const Outcome outcome = RunAccept(Bars(1.02), {"--json"});
  EXPECT_EQ(outcome.status, 3);
  EXPECT_THAT(outcome.err, HasSubstr("bars.yaml allows"));
  const Json json = Json::parse(outcome.out);
  EXPECT_FALSE(json["passes"]);
  EXPECT_NEAR(json["scale"].get<double>(), 1 / 1.02 - 1, 4 * json["scale_sigma"].get<double>());
  ASSERT_EQ(json["findings"].size(), 1U);
  EXPECT_EQ(json["findings"][0]["code"], "acceptance_scale");
  // The bars were that much warmer than at their calibration.
  const Outcome expanded =
      RunAccept(Bars(1.02, "temperature: {bar: 20, calibrated: 1020, expansion: 1.9607843e-5}\n"));
  EXPECT_EQ(expanded.status, 0) << expanded.out;
}

TEST_F(Accept, AllFramesTogetherAreMoreExact) {
  const Outcome outcome = RunAccept(Bars(1, "mode: bundle\n"), {"-o", "bundle"});
  ASSERT_EQ(outcome.status, 0) << outcome.err;
  EXPECT_GT(Json::parse(Read("bundle/acceptance.json"))["probability"], 1e-3);
  ASSERT_EQ(RunAccept(Bars(1), {"-o", "single"}).status, 0);
  const Table together(Read("bundle/acceptance.csv")), single(Read("single/acceptance.csv"));
  ASSERT_EQ(together.Rows(), 10U);
  EXPECT_EQ(together.Column("frame"), std::vector<std::string>(10, "all"));
  EXPECT_LT(together.Numbers("sigma")[0], single.Numbers("sigma")[0]);
}

TEST_F(Accept, OneWrongReferenceIsNoScale) {
  const std::string wrong =
      Bars(1) + "      - {between: [tag 0, tag 7], length: 0.11, sigma: 3 um}\n";
  const Outcome outcome = RunAccept(wrong);
  EXPECT_EQ(outcome.status, 3);
  EXPECT_THAT(outcome.out, HasSubstr("acceptance_sigma: "));
  EXPECT_THAT(outcome.out, HasSubstr("the largest of them: tag 0 - tag 7 in "));
}

TEST_F(Accept, NamesWhatDoesNotFit) {
  const auto refused = [&](const std::string& bars, const std::string& what) {
    const Outcome outcome = RunAccept(bars);
    EXPECT_EQ(outcome.status, kWrongInput) << what;
    EXPECT_THAT(outcome.err, HasSubstr(what));
  };
  const std::string limit = "plenocal: 1\nlimit: {constant: 1 mm}\n";
  refused(limit + "lines: [{name: a, bars: [{between: [tag 0, tag 0], length: 1}]}]\n", "the same");
  refused(limit + "lines: [{name: a, bars: [{between: [tag 0], length: 1}]}]\n", "two ends");
  refused(limit + "lines: [{name: a, bars: [{between: [tag 0, tag 1], length: 0 mm}]}]\n",
          "bars.yaml:3");
  refused(limit + "lines: [{name: a, bars: [{between: [tag 0, tug 1], length: 1}]}]\n", "tug 1");
  refused(limit + "lines: []\n", "no line has a bar");
  refused(limit + "decision: kind\nlines: [{name: a, bars: [{between: [1, 2], length: 1}]}]\n",
          "guarded or simple");
  refused(limit + "mode: all\nlines: [{name: a, bars: [{between: [1, 2], length: 1}]}]\n",
          "single or bundle");
  const Outcome unseen =
      RunAccept(limit + "lines: [{name: a, bars: [{between: [tag 90, tag 91], length: 1}]}]\n");
  EXPECT_EQ(unseen.status, 1);
  EXPECT_THAT(unseen.err, HasSubstr("tag 90 - tag 91"));
}

}  // namespace TEST_FILE
}  // namespace plenocal::testing
