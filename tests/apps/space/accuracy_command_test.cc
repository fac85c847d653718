// SPDX-License-Identifier: Apache-2.0
//
// `plenocal accuracy`: what it predicts for a simulated pair is what `triangulate` states for
// points there; refusals name what is missing.
#include <fmt/format.h>
#include <gmock/gmock.h>

#include <cmath>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "calib/camera/rigid_transform.h"
#include "tests/apps/calibration_schema.h"
#include "tests/apps/space/simulated_pair.h"
#include "tests/apps/workspace.h"

namespace plenocal::testing {
namespace TEST_FILE {

using ::testing::HasSubstr;
using Json = nlohmann::json;

class AccuracyCommand : public Workspace {
 protected:
  void SetUp() override {
    Workspace::SetUp();
    Write("board.yaml", kBoard);
    Write("spec.yaml", PairSpec(3, "frames: 12, distance: [0.4, 1.0]"));
    ASSERT_EQ(Run({"simulate", "spec.yaml", "--points", "-o", "set"}).status, 0);
    const Outcome outcome = Run({"calibrate", "set/session.yaml", "-o", "result"});
    ASSERT_EQ(outcome.status, 0) << outcome.err;
    EXPECT_THAT(outcome.out, HasSubstr("standard errors in space"));
    EXPECT_THAT(outcome.out, HasSubstr("  left + right at 1"));
  }

  void ExpectRefused(const std::vector<std::string>& words, const std::string& what) const {
    std::vector<std::string> all{"accuracy"};
    all.insert(all.end(), words.begin(), words.end());
    const Outcome outcome = Run(all);
    EXPECT_EQ(outcome.status, kWrongInput) << what;
    EXPECT_THAT(outcome.err, HasSubstr(what));
  }
};

TEST_F(AccuracyCommand, PredictsWhatTriangulateStates) {
  const Outcome outcome = Run({"accuracy", "result", "--distances", "0.7,2", "-o", "accuracy"});
  ASSERT_EQ(outcome.status, 0) << outcome.err;
  EXPECT_THAT(outcome.out, HasSubstr("left + right at 0.7 m: z "));
  EXPECT_THAT(outcome.out, HasSubstr("a length of 100 mm across "));
  const Json file = Json::parse(Read("accuracy/accuracy.json"));
  ASSERT_EQ(file["accuracy"].size(), 1U);
  const Json& accuracy = file["accuracy"][0];
  EXPECT_THAT(CalibrationSchema(PLENOCAL_DOCS).Violations(accuracy, "Accuracy"),
              ::testing::IsEmpty());
  EXPECT_EQ(Json::parse(Run({"accuracy", "result", "--distances", "0.7,2", "--json"}).out),
            file["accuracy"]);
  // One cell as `triangulate` has it: the point whose places are given.
  const Table cells(Read("accuracy/accuracy.csv"));
  const std::vector<double> x = cells.Numbers("x"), y = cells.Numbers("y"),
                            z = cells.Numbers("distance");
  size_t at = 0;
  while (std::hypot(x[at] - 640, y[at] - 480) > 60 || z[at] != 2) ++at;
  const YAML::Node result = YAML::LoadFile(Path("result/calibration.yaml").string());
  const auto number = [&](const char* camera, const char* name) {
    return result["cameras"][camera]["parameters"][name].as<double>();
  };
  const Eigen::Vector3d X(2 * (x[at] - number("left", "c_x")) / number("left", "f_x"),
                          2 * (y[at] - number("left", "c_y")) / number("left", "f_y"),
                          2);
  Write("left.csv", fmt::format("frame,marker,x,y\na,1,{:.9g},{:.9g}\n", x[at], y[at]));
  Vector6d xi;
  for (int k = 0; k < 6; ++k) {
    xi[k] = result["cameras"]["right"]["xi_camera_rig"][k].as<double>();
  }
  const Eigen::Vector3d p = Exp(xi) * X;
  Write("right.csv",
        fmt::format("frame,marker,x,y\na,1,{:.9g},{:.9g}\n",
                    number("right", "f_x") * p.x() / p.z() + number("right", "c_x"),
                    number("right", "f_y") * p.y() / p.z() + number("right", "c_y")));
  ASSERT_EQ(Run({"triangulate", "result", "left=left.csv", "right=right.csv", "-o", "one"}).status,
            0);
  const Table point(Read("one/points.csv"));
  for (const char* name : {"sigma_z_noise", "sigma_z_calibration"}) {
    const double stated = point.Numbers(name)[0];
    EXPECT_NEAR(cells.Numbers(name)[at], stated, 1e-3 * stated) << name;
  }
  EXPECT_THAT(Read("accuracy/accuracy.html"), HasSubstr("left + right at 0.7 m: z "));
}

TEST_F(AccuracyCommand, TwoCalibrationsAreComparedInSpace) {
  const std::vector<std::string> both{
      "compare", "result/calibration.yaml", "set/truth/calibration.yaml", "--space"};
  std::vector<std::string> words = both;
  words.insert(words.end(), {"--distance", "0.7", "2", "-o", "compared"});
  const Outcome outcome = Run(words);
  ASSERT_EQ(outcome.status, 0) << outcome.err;
  EXPECT_THAT(outcome.out, HasSubstr("left + right at 2 m: z "));
  EXPECT_THAT(outcome.out, HasSubstr("; predicted "));
  const Table rows(Read("compared/compare_space.csv"));
  ASSERT_EQ(rows.Rows(), 6U);
  // The calibration differs from the truth within its standard errors.
  const std::vector<double> rms = rows.Numbers("rms"), predicted = rows.Numbers("predicted"),
                            differs = rows.Numbers("differs");
  for (size_t i = 0; i < rms.size(); ++i) {
    EXPECT_LT(rms[i], 3 * predicted[i]);
    EXPECT_EQ(differs[i], 0);
  }
  // With the fit of the new images, here those of the calibration itself.
  const Outcome check = Run({"compare",
                             "result/calibration.yaml",
                             "--check",
                             "set/session.yaml",
                             "--space",
                             "-o",
                             "checked"});
  EXPECT_EQ(check.status, 0) << check.err;
  EXPECT_THAT(check.out, HasSubstr("left + right at 1 m: z "));
  for (const double each : Table(Read("checked/compare_space.csv")).Numbers("rms")) {
    EXPECT_LT(each, 1e-5);
  }
}

TEST_F(AccuracyCommand, ViewsAreSuggestedThatLowerTheSigmaOfDepth) {
  const Outcome outcome = Run({"suggest", "result", "--goal", "depth@2m:0.1mm", "--json"});
  ASSERT_EQ(outcome.status, 0) << outcome.err;
  const Json suggested = Json::parse(outcome.out);
  EXPECT_EQ(suggested["unit"], "mm");
  EXPECT_NEAR(suggested["goal"].get<double>(), 0.1, 1e-9);
  // The same pair at the same distance: an RMS over the image against the median.
  const Json accuracy =
      Json::parse(Run({"accuracy", "result", "--distances", "2", "--json"}).out)[0];
  const double calibration = 1e3 * accuracy["distances"][0]["z"]["calibration"].get<double>();
  EXPECT_NEAR(suggested["sigma_now"].get<double>(), calibration, 0.3 * calibration);
  double before = suggested["sigma_now"];
  for (const Json& view : suggested["views"]) {
    EXPECT_LT(view["sigma_after"].get<double>(), before);
    before = view["sigma_after"];
  }
  EXPECT_THAT(Run({"suggest", "result", "--goal", "depth@2m"}).out,
              HasSubstr("sigma of z at 2 m "));
  for (const char* goal : {"depth@", "depth@0m", "depth@2m:", "0", "nan", "x"}) {
    const Outcome refused = Run({"suggest", "result", "--goal", goal});
    EXPECT_EQ(refused.status, kWrongInput) << goal;
    EXPECT_THAT(refused.err, HasSubstr("--goal")) << goal;
  }
}

TEST_F(AccuracyCommand, HasTheNoiseOfOneCameraOrOfAll) {
  const auto noise = [&](const std::vector<std::string>& words) {
    std::vector<std::string> command{"accuracy", "result", "--distances", "1", "--json"};
    command.insert(command.end(), words.begin(), words.end());
    const Outcome outcome = Run(command);
    EXPECT_EQ(outcome.status, 0) << outcome.err;
    return Json::parse(outcome.out)[0]["distances"][0]["z"]["noise"].get<double>();
  };
  const double of_all = noise({"--noise", "0.2"});
  EXPECT_NEAR(noise({"--noise", "left=0.2", "--noise", "right=0.2"}), of_all, 1e-9 * of_all);
  EXPECT_NEAR(noise({"--noise", "left=0.6", "--noise", "right=0.8"}),
              of_all * std::sqrt(12.5),
              0.1 * of_all);
}

TEST_F(AccuracyCommand, NamesWhatDoesNotFit) {
  ExpectRefused({"result", "--pair", "left,up"}, "up");
  ExpectRefused({"result", "--pair", "left,left"}, "twice");
  ExpectRefused({"result", "--distances", "0.5,0"}, "--distances");
  ExpectRefused({"result", "--noise", "left=0"}, "--noise left=0");
  ExpectRefused({"result", "--noise", "up=1"}, "up");
  ExpectRefused({"result/calibration.yaml"}, "--distances");
  std::filesystem::remove(Path("result/correlations.csv"));
  std::string text = Read("result/calibration.yaml");
  for (size_t at = 0; (at = text.find("sigma_xi:", at)) != std::string::npos; ++at) {
    text.erase(at, text.find('\n', at) - at);
  }
  for (size_t at = 0; (at = text.find("    sigma:", at)) != std::string::npos; ++at) {
    text.erase(at, text.find('\n', at) - at + 1);
  }
  Write("bare.yaml", text);
  ExpectRefused({"bare.yaml", "--distances", "1"}, "no standard errors");
  ExpectRefused({"nowhere"}, "nowhere");
}

}  // namespace TEST_FILE
}  // namespace plenocal::testing
