// SPDX-License-Identifier: Apache-2.0
//
// `plenocal calibrate` of sessions with a scene in place of a target, on simulated tracks.
#include <algorithm>
#include <cmath>
#include <filesystem>
#include <functional>
#include <map>
#include <regex>
#include <set>
#include <string>
#include <vector>

#include "tests/apps/workspace.h"

namespace plenocal::testing {
namespace TEST_FILE {

using ::testing::HasSubstr;
namespace fs = std::filesystem;

class SceneSession : public Workspace {
 protected:
  void Simulate(const std::vector<std::pair<std::string, std::string>>& changes = {}) const {
    fs::copy_file(fs::path(PLENOCAL_EXAMPLES) / "simulate" / "scene_free.yaml", Path("spec.yaml"));
    for (const auto& [from, to] : changes) {
      Write("spec.yaml", Replaced(Read("spec.yaml"), from, to));
    }
    const Outcome simulated = Run({"simulate", "spec.yaml", "--points", "-o", "."});
    ASSERT_EQ(simulated.status, kDone) << simulated.err;
  }
  // The simulated session with these cameras only.
  [[nodiscard]] YAML::Node Session(const std::vector<std::string>& cameras) const {
    YAML::Node session = YAML::LoadFile(Path("session.yaml"));
    for (const char* name : {"left", "right", "plenoptic"}) {
      if (std::ranges::find(cameras, name) == cameras.end()) session["cameras"].remove(name);
    }
    return session;
  }
  // True distances between the points that a camera shows in most frames.
  [[nodiscard]] YAML::Node DistancesSeenBy(const std::string& camera) const {
    constexpr size_t kPoints = 5;
    const Table tracks(Read("tracks_" + camera + ".csv")), truth(Read("truth/points.csv"));
    std::map<std::string, std::set<std::string>> frames;
    const auto markers = tracks.Column("marker"), names = tracks.Column("frame");
    for (size_t i = 0; i < markers.size(); ++i) frames[markers[i]].insert(names[i]);
    std::map<std::string, Eigen::Vector3d> places;
    const auto numbers = truth.Column("marker");
    const auto x = truth.Numbers("x"), y = truth.Numbers("y"), z = truth.Numbers("z");
    for (size_t i = 0; i < numbers.size(); ++i) places[numbers[i]] = {x[i], y[i], z[i]};
    std::vector<std::string> most;
    for (const auto& [number, of_point] : frames) most.push_back(number);
    std::ranges::stable_sort(
        most, std::greater<>(), [&](const std::string& number) { return frames[number].size(); });
    YAML::Node distances(YAML::NodeType::Sequence);
    for (size_t i = 1; i < kPoints; ++i) {
      YAML::Node distance;
      distance["between"] = std::vector<std::string>{"point " + most[0], "point " + most[i]};
      distance["value"] = (places.at(most[0]) - places.at(most[i])).norm();
      distance["sigma"] = 0.0005;
      distances.push_back(distance);
    }
    return distances;
  }
  void WriteSession(const YAML::Node& session) const {
    YAML::Emitter out;
    out << session;
    Write("session.yaml", std::string(out.c_str()) + "\n");
  }
  // The given calibration of the pair alone.
  void WritePair() const {
    YAML::Node calibration = YAML::LoadFile(Path("calibration.yaml"));
    calibration["cameras"].remove("plenoptic");
    YAML::Emitter out;
    out << calibration;
    Write("pair.yaml", std::string(out.c_str()) + "\n");
  }
  // Each named parameter within `sigmas` standard errors of the truth, and these below `largest`
  // parts of it.
  void ExpectTrue(const std::string& camera,
                  const std::vector<std::pair<std::string, double>>& largest,
                  double sigmas = 4) const {
    const YAML::Node truth = YAML::LoadFile(Path("truth/calibration.yaml"))["cameras"][camera];
    const YAML::Node found = Result()["cameras"][camera];
    for (const auto& [name, part] : largest) {
      const auto value = found["parameters"][name].as<double>();
      const auto sigma = found["sigma"][name].as<double>();
      const auto expected = truth["parameters"][name].as<double>();
      EXPECT_LT(std::abs(value - expected), sigmas * sigma) << name;
      EXPECT_LT(sigma, part * std::abs(expected)) << name;
      EXPECT_GT(sigma, 0) << name;
    }
  }
  [[nodiscard]] std::vector<std::string> Codes(const std::string& out = "out") const {
    std::vector<std::string> codes;
    for (const YAML::Node& finding : Result(out)["verdict"]["findings"]) {
      if (finding["grade"].as<std::string>() != "good") {
        codes.push_back(finding["code"].as<std::string>());
      }
    }
    return codes;
  }
  [[nodiscard]] std::string GradeOf(const std::string& out = "out") const {
    return Result(out)["verdict"]["grade"].as<std::string>();
  }
};

TEST_F(SceneSession, StereoPairGivesTheScaleOfAPlenopticCamera) {
  Simulate();
  WritePair();
  YAML::Node session = Session({"left", "right", "plenoptic"});
  session["scene"].remove("distances");
  session["from"] = "pair.yaml";
  WriteSession(session);
  Calibrate();
  ExpectTrue("plenoptic", {{"f_L", 0.003}, {"b_L0", 0.003}, {"B", 0.03}});
  EXPECT_TRUE(fs::exists(Path("out/points.ply")));
  EXPECT_FALSE(fs::exists(Path("out/target.yaml")));
  EXPECT_TRUE(fs::exists(Path("out/report.html")));
  ExpectNoNan(Result());
}

TEST_F(SceneSession, DistancesGiveTheScaleOfAPlenopticCameraAlone) {
  Simulate();
  YAML::Node session = Session({"plenoptic"});
  session["scene"]["distances"] = DistancesSeenBy("plenoptic");
  WriteSession(session);
  Calibrate();
  ExpectTrue("plenoptic", {{"f_L", 0.01}, {"b_L0", 0.01}, {"B", 0.05}});
}

TEST_F(SceneSession, OrdinaryCameraNeedsNeitherStartNorScale) {
  Simulate();
  YAML::Node session = Session({"left"});
  session["scene"].remove("distances");
  WriteSession(session);
  Calibrate();
  ExpectTrue("left", {{"f_x", 0.002}, {"f_y", 0.002}});
  EXPECT_NE(GradeOf(), "bad");
}

// Tracks of one corner only give no size, and that is no mistake of the session.
TEST_F(SceneSession, TagsWithoutTracksAreLeftOut) {
  Simulate({{"points: 1000", "points: 200"}, {"frames: 40", "frames: 15"}});
  YAML::Node session = Session({"left"});
  session["scene"]["distances"] = DistancesSeenBy("left");
  const std::string tracked = session["scene"]["distances"][0]["between"][1].as<std::string>();
  const std::string number = tracked.substr(std::string("point ").size());
  Write("tracks_left.csv",
        std::regex_replace(Read("tracks_left.csv"), std::regex("," + number + ","), ",10000030,"));
  session["scene"]["distances"][0]["between"][1] = "tag 3 corner 0";
  session["scene"]["tags"] =
      YAML::Load("{family: tag36h11, ids: [3, 4], size: 80 mm, size_sigma: 0.4 mm}");
  WriteSession(session);
  const Outcome outcome = Calibrate();
  EXPECT_THAT(outcome.err, HasSubstr("tag 3: not all of its corners have tracks"));
  EXPECT_THAT(Read("out/left_out.csv"), HasSubstr("\"tag 4\","));
  ExpectTrue("left", {{"f_x", 0.01}});
}

TEST_F(SceneSession, WithoutScaleLengthsAreOpen) {
  Simulate();
  YAML::Node session = Session({"plenoptic"});
  session["scene"].remove("distances");
  WriteSession(session);
  const Outcome outcome = Calibrate();
  EXPECT_THAT(outcome.out,
              HasSubstr("no scale: give the stereo pair, a distance, tags of known "
                        "size or B"));
  const YAML::Node sigma = Result()["cameras"]["plenoptic"]["sigma"];
  EXPECT_TRUE(std::isinf(sigma["B"].as<double>()));
  EXPECT_TRUE(std::isfinite(sigma["c_x"].as<double>()));
  EXPECT_EQ(GradeOf(), "bad");
  EXPECT_THAT(Codes(), ::testing::Contains("scene_no_scale"));
}

TEST_F(SceneSession, RecalibrationAfterRefocusing) {
  Simulate();
  YAML::Node earlier = YAML::LoadFile(Path("truth/calibration.yaml"));
  earlier["cameras"].remove("left");
  earlier["cameras"].remove("right");
  YAML::Node camera = earlier["cameras"]["plenoptic"];
  const YAML::Node truth = YAML::Clone(camera["parameters"]);
  camera["parameters"]["b_L0"] = truth["b_L0"].as<double>() - 2e-4;
  for (const auto& param : truth) camera["sigma"][param.first.as<std::string>()] = 0;
  camera["sigma"]["f_L"] = 4e-6;
  camera["sigma"]["B"] = 1.3e-6;
  camera["sigma"]["c_x"] = 0.3;
  camera["sigma"]["c_y"] = 0.3;
  YAML::Emitter out;
  out << earlier;
  Write("earlier.yaml", std::string(out.c_str()) + "\n");
  YAML::Node session = Session({"plenoptic"});
  session["scene"].remove("distances");
  session["from"] = "earlier.yaml";
  session["cameras"]["plenoptic"]["free"] = std::vector<std::string>{"b_L0"};
  WriteSession(session);
  Calibrate();
  ExpectTrue("plenoptic", {{"b_L0", 0.003}, {"B", 0.01}});
  const Outcome compared = Run({"compare", "earlier.yaml", "out/calibration.yaml"});
  EXPECT_THAT(compared.out, HasSubstr("not the same within uncertainty"));
  const Outcome checked = Run({"compare", "earlier.yaml", "--check", "session.yaml"});
  EXPECT_EQ(checked.status, kWrongInput);
  EXPECT_THAT(checked.err, HasSubstr("calibrate it, then compare both"));
}

TEST_F(SceneSession, OneDepthIsNamedAndNeverGood) {
  Simulate({{"kind: handheld", "kind: [handheld, one-depth]"}});
  WritePair();
  YAML::Node session = Session({"left", "right", "plenoptic"});
  session["scene"].remove("distances");
  session["from"] = "pair.yaml";
  WriteSession(session);
  const Outcome outcome = Run({"calibrate", "session.yaml", "-o", "out"});
  if (outcome.status == kDone) {
    EXPECT_NE(GradeOf(), "good");
    EXPECT_THAT(outcome.out, HasSubstr("scene_one_depth"));
  } else {
    EXPECT_EQ(outcome.status, kJobFailed);
    EXPECT_THAT(outcome.err, HasSubstr("depth"));
  }
}

class SceneSessionInput : public SceneSession {
 protected:
  SceneSessionInput() { Simulate({{"points: 1000", "points: 60"}, {"frames: 40", "frames: 4"}}); }
};

TEST_F(SceneSessionInput, UnknownPointInADistance) {
  YAML::Node session = Session({"left"});
  session["scene"]["distances"][0]["between"][1] = "point 99999";
  WriteSession(session);
  ExpectFailure(kWrongInput, {"session.yaml:", "between", "point 99999"});
}

TEST_F(SceneSessionInput, ATargetBesideTheScene) {
  Write("session.yaml", Read("session.yaml") + "target: chessboard:9x6:25mm\n");
  ExpectFailure(kWrongInput, {"session.yaml:", "either 'target' or 'scene'"});
}

TEST_F(SceneSessionInput, FromAFileThatIsMissing) {
  Write("session.yaml",
        "plenocal: 1\ntarget: chessboard:9x6:25mm\nfrom: pair.yaml\ncameras: {left: {model: "
        "pinhole, detections: tracks_left.csv, image_size: [640, 512]}}\n");
  ExpectFailure(kWrongInput, {"session.yaml:3:", "from", "pair.yaml: no such file"});
}

TEST_F(SceneSessionInput, KeysOfAnEarlierCalibrationWithoutIt) {
  YAML::Node session = Session({"left"});
  session["cameras"]["left"]["free"] = std::vector<std::string>{"f_x"};
  WriteSession(session);
  ExpectFailure(kWrongInput, {"session.yaml:", "free", "'from: earlier/calibration.yaml'"});
}

TEST_F(SceneSessionInput, WrongDistances) {
  const std::string head =
      "plenocal: 1\ncameras: {left: {model: pinhole, detections: tracks_left.csv, image_size: "
      "[640, 512]}}\nscene:\n  distances: ";
  for (const auto& [distance, message] : std::vector<std::pair<std::string, std::string>>{
           {"[{between: [corner 3, point 2], value: 1, sigma: 1 mm}]", "expected 'point NUMBER'"},
           {"[{between: [point 2, point 2], value: 1, sigma: 1 mm}]", "same point"},
           {"[{between: [point 2], value: 1, sigma: 1 mm}]", "expected two points"},
           {"[{between: [point 2, point 3], sigma: 1 mm}]", "'value' or 'length'"},
           {"[{between: [point 2, point 3], length: 1 m, sigma: 0}]", "sigma"}}) {
    Write("session.yaml", head + distance + "\n");
    ExpectFailure(kWrongInput, {"session.yaml:4:", message});
  }
}

TEST_F(SceneSessionInput, CamerasOfAnotherCalibration) {
  WritePair();
  YAML::Node session = Session({"plenoptic"});
  session["from"] = "pair.yaml";
  WriteSession(session);
  ExpectFailure(kWrongInput, {"pair.yaml", "none of the session's cameras"});
}

TEST_F(SceneSessionInput, CommandsThatNeedATarget) {
  for (const char* command : {"detect", "try"}) {
    const Outcome outcome = Run({command, "session.yaml", "-o", "out"});
    EXPECT_EQ(outcome.status, kWrongInput) << command;
    EXPECT_THAT(outcome.err, HasSubstr("scene in place of a target")) << command;
  }
}

}  // namespace TEST_FILE
}  // namespace plenocal::testing
