// SPDX-License-Identifier: Apache-2.0
//
// Sessions with several targets, cameras that share no view, and earlier calibrations as priors, on
// simulated points.
#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <map>
#include <sstream>
#include <string>
#include <utility>
#include <vector>

#include "tests/apps/workspace.h"

namespace plenocal::testing {
namespace TEST_FILE {

using ::testing::AllOf;
using ::testing::HasSubstr;
namespace fs = std::filesystem;

constexpr const char* kFromA = "from: ../a/out/calibration.yaml\n";
constexpr double kSigmas = 4.5;  // one in 10^5 of Gaussian errors is larger

class Rigs : public Workspace {
 protected:
  // The ring of examples/simulate with these changes of its specification.
  void SimulateRing(const std::vector<std::pair<std::string, std::string>>& changes = {}) const {
    const fs::path ring = fs::path(PLENOCAL_EXAMPLES) / "simulate" / "ring";
    for (const char* name : {"ring.yaml", "front.yaml", "side.yaml"}) {
      fs::copy_file(ring / name, Path(name));
    }
    for (const auto& [from, to] : changes)
      Write("ring.yaml", Replaced(Read("ring.yaml"), from, to));
    const Outcome simulated = Run({"simulate", "ring.yaml", "--points", "-o", "."});
    ASSERT_EQ(simulated.status, kDone) << simulated.err;
  }

  // A pair before a board; another seed has other poses.
  void SimulatePair(const std::string& folder,
                    int seed,
                    const std::string& focal,
                    const std::string& x = "-0.1") const {
    Write("board.yaml", "plenocal: 1\ntype: chessboard\ncolumns: 9\nrows: 7\nsquare: 30 mm\n");
    const std::string camera =
        "    model: pinhole-radial3\n    image_size: [1280, 1024]\n    parameters: {f_x: " + focal +
        ", f_y: 1101, c_x: 640, c_y: 512, A_0: -0.2, A_1: 0.06, A_2: -0.01}\n";
    Write(folder + ".yaml",
          "plenocal: 1\nseed: " + std::to_string(seed) +
              "\ntarget: board.yaml\ncameras:\n  left:\n" + camera + "  right:\n" + camera +
              "    xi_camera_rig: [" + x +
              ", 0, 0, 0, 0.02, 0]\n"
              "poses: {frames: 20, distance: [0.4, 1.2]}\n");
    const Outcome simulated = Run({"simulate", folder + ".yaml", "--points", "-o", folder});
    ASSERT_EQ(simulated.status, kDone) << simulated.err;
  }

  // A pair that a hand moves in front of a board, with times of the images. `right`: keys of its
  // times.
  void SimulateMovingPair(int seed, const std::string& right) const {
    Write("board.yaml", "plenocal: 1\ntype: chessboard\ncolumns: 9\nrows: 7\nsquare: 30 mm\n");
    const std::string camera =
        "    model: pinhole-radial3\n    image_size: [1280, 1024]\n    parameters: {f_x: 1100, "
        "f_y: 1101, c_x: 640, c_y: 512, A_0: -0.2, A_1: 0.06, A_2: -0.01}\n";
    Write("moving.yaml",
          "plenocal: 1\nseed: " + std::to_string(seed) +
              "\ntarget: board.yaml\ncameras:\n  left:\n" + camera + "  right:\n" + camera +
              "    xi_camera_rig: [-0.1, 0, 0, 0, 0.02, 0]\n" + right +
              "poses: {kind: moving, frames: 80, rate: 20, distance: [0.5, 1]}\n");
    const Outcome simulated = Run({"simulate", "moving.yaml", "--points", "-o", "."});
    ASSERT_EQ(simulated.status, kDone) << simulated.err;
  }

  // Adds lines to the session of a simulated pair, in front of `cameras`, and calibrates it.
  YAML::Node CalibratePair(const std::string& folder, const std::string& lines) const {
    const std::string session = folder + "/session.yaml";
    Write(session, Replaced(Read(session), "cameras:\n", lines + "cameras:\n"));
    const std::string out = folder + "/out";
    const Outcome outcome = Run({"calibrate", session, "-o", out, "--no-report"});
    EXPECT_EQ(outcome.status, kDone) << outcome.err;
    return Result(out);
  }

  // The table with another correlation of its first and its last unknown.
  static std::string WithCorrelation(const std::string& table, const std::string& number) {
    std::vector<std::string> lines = Lines(table);
    std::string &first = lines[1], &last = lines.back();
    first.replace(first.rfind(',') + 1, std::string::npos, number);
    const size_t begin = last.find(',') + 1;
    last.replace(begin, last.find(',', begin) - begin, number);
    return fmt::format("{}\n", fmt::join(lines, "\n"));
  }

  // The frames of a and b in one session.
  YAML::Node CalibrateJointly() const {
    fs::create_directory(Path("joint"));
    Write("joint/target.yaml", Read("a/target.yaml"));
    const std::string session = Read("b/session.yaml");
    Write("joint/session.yaml",
          session.find(kFromA) == std::string::npos ? session : Replaced(session, kFromA, ""));
    for (const char* name : {"detections_left.csv", "detections_right.csv"}) {
      const std::vector<std::string> a = Lines(Read(std::string("a/") + name));
      const std::vector<std::string> b = Lines(Read(std::string("b/") + name));
      std::string rows = a[0] + "\n";
      for (size_t i = 1; i < a.size(); ++i) rows += "a" + a[i] + "\n";
      for (size_t i = 1; i < b.size(); ++i) rows += "b" + b[i] + "\n";
      Write(std::string("joint/") + name, rows);
    }
    return CalibratePair("joint", "");
  }

  static void ExpectSameRig(const YAML::Node& found, const YAML::Node& joint) {
    constexpr double kAway = 0.1, kRatio = 0.03;  // sigma; part
    for (const char* camera : {"left", "right"}) {
      const YAML::Node one = found["cameras"][camera], both = joint["cameras"][camera];
      for (const auto& entry : both["parameters"]) {
        const auto name = entry.first.as<std::string>();
        const auto sigma = both["sigma"][name].as<double>();
        EXPECT_LT(std::abs(one["parameters"][name].as<double>() - entry.second.as<double>()),
                  kAway * sigma)
            << camera << " " << name;
        EXPECT_NEAR(one["sigma"][name].as<double>() / sigma, 1, kRatio) << camera << " " << name;
      }
    }
    const YAML::Node one = found["cameras"]["right"], both = joint["cameras"]["right"];
    for (int i = 0; i < 6; ++i) {
      const auto sigma = both["sigma_xi"][i].as<double>();
      EXPECT_NEAR(one["sigma_xi"][i].as<double>() / sigma, 1, kRatio) << i;
      EXPECT_LT(
          std::abs(one["xi_camera_rig"][i].as<double>() - both["xi_camera_rig"][i].as<double>()),
          kAway * sigma)
          << i;
    }
  }

  static void ExpectNear(const YAML::Node& found,
                         const YAML::Node& truth,
                         const std::string& xi,
                         const std::string& what) {
    for (int i = 0; i < 6; ++i) {
      const auto sigma = found["sigma_xi"][i].as<double>();
      EXPECT_GT(sigma, 0) << what;
      EXPECT_LT(std::abs(found[xi][i].as<double>() - truth[xi][i].as<double>()), kSigmas * sigma)
          << what << " " << i;
    }
  }

  static std::vector<std::string> Codes(const YAML::Node& result) {
    std::vector<std::string> codes;
    for (const YAML::Node& finding : result["verdict"]["findings"]) {
      codes.push_back(finding["code"].as<std::string>());
    }
    return codes;
  }
  static bool Has(const std::vector<std::string>& codes, const std::string& code) {
    return std::ranges::find(codes, code) != codes.end();
  }
};

TEST_F(Rigs, CamerasWithoutACommonViewAreCalibratedByTwoBoards) {
  SimulateRing();
  Calibrate();
  const YAML::Node result = Result(), truth = YAML::LoadFile(Path("truth/calibration.yaml"));
  for (const char* name : {"cam1", "cam2", "cam3", "cam4", "cam5"}) {
    ExpectNear(result["cameras"][name], truth["cameras"][name], "xi_camera_rig", name);
  }
  ExpectNear(result["targets"]["side"], truth["targets"]["side"], "xi_target_own", "side");
  ExpectNoNan(result);
  // Each target in a file of its own, with the numbers of its tags.
  for (const char* name : {"out/target_front.yaml", "out/target_side.yaml", "out/target.yaml"}) {
    EXPECT_TRUE(fs::exists(Path(name))) << name;
  }
  EXPECT_EQ(Run({"report", "out"}).status, kDone);
  EXPECT_THAT(Read("out/report.html"), HasSubstr("\"sightings\""));
}

TEST_F(Rigs, CamerasThatNothingConnectsAreNamed) {
  SimulateRing();
  // Only one of the boards: no two cameras see it in one frame.
  Write("session.yaml", Replaced(Read("session.yaml"), "  side: target_side.yaml\n", ""));
  ExpectFailure(kJobFailed, {"cam1", "together"});
}

TEST_F(Rigs, KnownAndMovingTargetsAreTakenAsSuch) {
  SimulateRing();
  const YAML::Node truth = YAML::LoadFile(Path("truth/calibration.yaml"));
  YAML::Emitter matrix;
  matrix << YAML::Flow << truth["targets"]["side"]["T_target_own"];
  Write(
      "session.yaml",
      Replaced(Read("session.yaml"),
               "  side: target_side.yaml\n",
               std::string("  side: {target: target_side.yaml, pose: ") + matrix.c_str() + "}\n"));
  Calibrate();
  const YAML::Node result = Result();
  ExpectNear(result["cameras"]["cam3"], truth["cameras"]["cam3"], "xi_camera_rig", "cam3");
  EXPECT_EQ(result["targets"]["side"]["sigma_xi"][0].as<double>(), 0);

  // A board that moves by itself connects nothing here.
  YAML::Node session = YAML::LoadFile(Path("session.yaml"));
  session["targets"]["side"]["pose"] = "free";
  YAML::Emitter text;
  text << session;
  Write("session.yaml", std::string(text.c_str()) + "\n");
  fs::remove_all(Path("out"));
  ExpectFailure(kJobFailed, {"nothing connects these cameras", "cam1", "two axes"});
}

// Two grids of tags in images of one camera or of a pair.
class LookAlikes : public Rigs {
 protected:
  static constexpr const char* kGrid =
      "plenocal: 1\ntype: aprilgrid\nfamily: tag36h11\nspacing: 0.3\nborder_bits: 1\n";

  void Simulate(const std::string& floor, const std::string& wall, const std::string& right) const {
    Write("floor.yaml", kGrid + floor);
    Write("wall.yaml", kGrid + wall);
    const std::string camera =
        "    model: pinhole-radial3\n    image_size: [640, 480]\n    parameters: {f_x: 560, f_y: "
        "561, c_x: 318, c_y: 241, A_0: -0.15, A_1: 0.05, A_2: 0}\n";
    Write("spec.yaml",
          "plenocal: 1\nseed: 3\ntargets:\n  floor: floor.yaml\n  wall:\n    target: wall.yaml\n"
          "    T_target_own: [[0.8660254, 0, -0.5, 0.36], [0, 1, 0, 0.02], [0.5, 0, 0.8660254, "
          "0.02], [0, 0, 0, 1]]\ncameras:\n  left:\n" +
              camera + (right.empty() ? "" : "  right:\n" + camera + right) +
              "poses: {frames: 14, distance: [0.5, 1.0], tilt: 0.5, roll: 0.5, aim: all}\n");
    const Outcome simulated = Run({"simulate", "spec.yaml", "-o", "."});
    ASSERT_EQ(simulated.status, kDone) << simulated.err;
  }

  // Points of a detections file by frame and marker.
  using Points = std::map<std::pair<std::string, int>, Eigen::Vector2d>;
  [[nodiscard]] Points PointsOf(const std::string& file) const {
    Points points;
    const std::vector<std::string> lines = Lines(Read(file));
    for (size_t i = 1; i < lines.size(); ++i) {
      std::istringstream cells(lines[i]);
      std::string frame, marker, x, y;
      std::getline(cells, frame, ',');
      std::getline(cells, marker, ',');
      std::getline(cells, x, ',');
      std::getline(cells, y, ',');
      points[{frame, std::stoi(marker)}] = {std::stod(x), std::stod(y)};
    }
    return points;
  }

  // All are where they should be, and all but `missing` of those in view are found.
  void ExpectAllRight(const std::string& camera, double missing) const {
    const std::string name = "detections_" + camera + ".csv";
    const Points truth = PointsOf("truth/" + name), found = PointsOf("out/" + name);
    size_t right = 0;
    for (const auto& [key, p] : found) {
      const auto at = truth.find(key);  // corners beyond the image's border are not in it
      if (at == truth.end()) continue;
      EXPECT_LT((at->second - p).norm(), 1) << camera << " " << key.first << " " << key.second;
      ++right;
    }
    EXPECT_GT(static_cast<double>(right), (1 - missing) * static_cast<double>(truth.size()));
  }

  void ExpectWallWithinThreeSigma() const {
    const YAML::Node wall = Result()["targets"]["wall"],
                     truth = YAML::LoadFile(Path("truth/calibration.yaml"))["targets"]["wall"];
    for (int i = 0; i < 6; ++i) {
      const auto sigma = wall["sigma_xi"][i].as<double>();
      EXPECT_GT(sigma, 0);
      EXPECT_LT(sigma, 1e-4);  // m, rad
      EXPECT_NEAR(
          wall["xi_target_own"][i].as<double>(), truth["xi_target_own"][i].as<double>(), 3 * sigma)
          << i;
    }
  }

  Outcome Calibrate() const {
    const Outcome outcome = Run({"calibrate", "session.yaml", "-o", "out", "--no-report"});
    EXPECT_EQ(outcome.status, kDone) << outcome.err;
    return outcome;
  }
};

TEST_F(LookAlikes, TagsOfEqualIdsAreToldApartByWhatFits) {
  Simulate("columns: 6\nrows: 6\nsize: 40 mm\n", "columns: 5\nrows: 7\nsize: 40 mm\n", "");
  Calibrate();
  ExpectWallWithinThreeSigma();
  ExpectAllRight("left", 0.15);
}

TEST_F(LookAlikes, EqualBoardsAreToldApartByTheirMutualPose) {
  // The right camera looks past the wall in some frames.
  Simulate("columns: 6\nrows: 6\nsize: 40 mm\n",
           "columns: 6\nrows: 6\nsize: 40 mm\n",
           "    xi_camera_rig: [0.15, 0, 0, 0, 0.2, 0]\n");
  const Outcome outcome = Calibrate();
  ExpectWallWithinThreeSigma();
  ExpectNear(Result()["cameras"]["right"],
             YAML::LoadFile(Path("truth/calibration.yaml"))["cameras"]["right"],
             "xi_camera_rig",
             "right");
  for (const char* camera : {"left", "right"}) ExpectAllRight(camera, 0.5);
  EXPECT_THAT(outcome.out + outcome.err, HasSubstr("nothing tells which of them"));
}

TEST_F(LookAlikes, BoardsThatNothingTellsApartAreRefused) {
  Simulate("columns: 2\nrows: 2\nsize: 40 mm\n", "columns: 2\nrows: 2\nsize: 40 mm\n", "");
  const std::string session = Read("session.yaml");
  const std::string wall = "  wall: target_wall.yaml\n";
  Write("session.yaml",
        Replaced(session, wall, "  wall: {target: target_wall.yaml, pose: free}\n"));
  ExpectFailure(kWrongInput,
                {"session.yaml: targets floor and wall look alike", "'free'", "first_id"});
  Write("session.yaml", Replaced(session, wall, wall + "  shelf: target_wall.yaml\n"));
  ExpectFailure(kWrongInput, {"more than two targets", "first_id"});
  Write("session.yaml",
        Replaced(Replaced(session, wall, "  wall: chessboard:6x9:25mm\n"),
                 "  floor: target_floor.yaml\n",
                 "  floor: chessboard:9x6:30mm\n"));
  ExpectFailure(kWrongInput, {"floor and wall look alike", "another number of squares"});
}

TEST_F(Rigs, ASecondCalibrationFromTheFirstEqualsBothTogether) {
  SimulatePair("a", 1, "1100");
  SimulatePair("b", 2, "1100");
  CalibratePair("a", "");
  const YAML::Node then = CalibratePair("b", kFromA);
  ExpectSameRig(then, CalibrateJointly());
  EXPECT_FALSE(Has(Codes(then), "prior_contradicted"));
  // The second contains the first.
  const Outcome twice = Run({"merge", "a/out", "b/out", "-o", "merged"});
  EXPECT_EQ(twice.status, kWrongInput);
  EXPECT_THAT(twice.err, HasSubstr("b/out/calibration.yaml: was calibrated from a/out"));
}

TEST_F(Rigs, MergedCalibrationsEqualBothTogether) {
  SimulatePair("a", 1, "1100");
  SimulatePair("b", 2, "1100");
  CalibratePair("a", "");
  CalibratePair("b", "");
  const Outcome outcome = Run({"merge", "a/out", "b/out/calibration.yaml", "-o", "merged"});
  ASSERT_EQ(outcome.status, kDone) << outcome.err;
  EXPECT_THAT(outcome.out, HasSubstr("the calibrations agree"));
  const YAML::Node merged = Result("merged");
  ExpectNoNan(merged);
  ExpectSameRig(merged, CalibrateJointly());
  EXPECT_EQ(merged["verdict"]["grade"].as<std::string>(), "good");
  // As any other calibration.
  EXPECT_EQ(Run({"compare", "merged/calibration.yaml", "joint/out/calibration.yaml"}).status,
            kDone);
  EXPECT_EQ(Run({"export", "merged/calibration.yaml", "--format", "opencv", "-o", "cv"}).status,
            kDone);
}

TEST_F(Rigs, CorrelationsThatNoCovarianceHasAreRefusedByAllThatReadThem) {
  SimulatePair("a", 1, "1100");
  CalibratePair("a", "");
  const std::string table = Read("a/out/correlations.csv");
  fs::copy(Path("a"), Path("b"), fs::copy_options::recursive);
  Write("b/session.yaml", kFromA + Read("b/session.yaml"));
  for (const auto& [number, why] : {std::pair("1.5", "is 1.5, which is not from -1 to 1"),
                                    std::pair("-0.999", "contradicts those with others"),
                                    std::pair("nan", "expected a number")}) {
    Write("a/out/correlations.csv", WithCorrelation(table, number));
    for (const std::vector<std::string>& command :
         {std::vector<std::string>{"merge", "a/out", "b/out", "-o", "merged"},
          {"calibrate", "b/session.yaml", "-o", "from"},
          {"compare", "a/out/calibration.yaml", "b/out/calibration.yaml"},
          {"report", "a/out"}}) {
      const Outcome outcome = Run(command);
      EXPECT_EQ(outcome.status, kWrongInput) << command[0];
      EXPECT_THAT(outcome.err, AllOf(HasSubstr("a/out/correlations.csv:"), HasSubstr(why)));
    }
  }
}

TEST_F(Rigs, MergeNamesACameraThatMoved) {
  SimulatePair("a", 1, "1100");
  SimulatePair("b", 2, "1100", "-0.1005");
  CalibratePair("a", "");
  CalibratePair("b", "");
  Outcome outcome = Run({"merge", "a/out", "b/out", "-o", "merged"});
  ASSERT_EQ(outcome.status, kDone) << outcome.err;
  EXPECT_THAT(outcome.out, HasSubstr("--moved right"));
  EXPECT_EQ(Codes(Result("merged")), std::vector<std::string>{"mount_moved"});
  outcome = Run({"merge", "a/out", "b/out", "-o", "merged", "--moved", "right"});
  ASSERT_EQ(outcome.status, kDone) << outcome.err;
  const YAML::Node merged = Result("merged"),
                   last = YAML::LoadFile(Path("b/truth/calibration.yaml"));
  EXPECT_TRUE(Codes(merged).empty());
  ExpectNear(merged["cameras"]["right"], last["cameras"]["right"], "xi_camera_rig", "right");
  EXPECT_EQ(Lines(Read("merged/mounts.csv")).size(), 3U);
  outcome = Run({"merge", "a/out", "b/out", "-o", "merged", "--moved", "rihgt"});
  EXPECT_EQ(outcome.status, kWrongInput);
  EXPECT_THAT(outcome.err, HasSubstr("did you mean 'right'"));
}

TEST_F(Rigs, AnEarlierCalibrationThatTheImagesContradictIsNamed) {
  SimulatePair("a", 1, "1100");
  SimulatePair("b", 2, "1108");  // refocused
  CalibratePair("a", "");
  const YAML::Node result = CalibratePair("b", kFromA);
  bool named = false;
  for (const YAML::Node& finding : result["verdict"]["findings"]) {
    if (finding["code"].as<std::string>() != "prior_contradicted") continue;
    const auto what = finding["what"].as<std::string>();
    named =
        named || (what.find(".f_x") != std::string::npos && what.find("px") != std::string::npos);
  }
  EXPECT_TRUE(named);
}

TEST_F(Rigs, ExtrinsicsOnlyKeepsTheParameters) {
  SimulatePair("a", 1, "1100");
  SimulatePair("b", 2, "1100");
  const YAML::Node earlier = CalibratePair("a", "");
  const YAML::Node result =
      CalibratePair("b", "from: ../a/out/calibration.yaml\nextrinsics_only: true\n");
  const YAML::Node left = result["cameras"]["left"];
  EXPECT_EQ(left["parameters"]["f_x"].as<double>(),
            earlier["cameras"]["left"]["parameters"]["f_x"].as<double>());
  EXPECT_EQ(left["sigma"]["f_x"].as<double>(), 0);
  EXPECT_GT(result["cameras"]["right"]["sigma_xi"][0].as<double>(), 0);
  EXPECT_TRUE(Has(Codes(result), "intrinsics_held"));
}

TEST_F(Rigs, ATimeShiftBetweenCamerasIsEstimated) {
  // 12 ms that the times state, and 4 ms that they do not.
  SimulateMovingPair(1, "    time_offset: 0.012\n    time_shift: 0.004\n");
  Calibrate();
  const YAML::Node result = Result(), truth = YAML::LoadFile(Path("truth/calibration.yaml"));
  const YAML::Node right = result["cameras"]["right"];
  EXPECT_EQ(truth["cameras"]["right"]["time_shift"].as<double>(), 0.004);
  const auto sigma = right["sigma_time_shift"].as<double>();
  EXPECT_LT(sigma, 5e-5);
  EXPECT_LT(std::abs(right["time_shift"].as<double>() - 0.004), kSigmas * sigma);
  EXPECT_FALSE(result["cameras"]["left"]["time_shift"]);
  ExpectNear(right, truth["cameras"]["right"], "xi_camera_rig", "right");
  const std::vector<std::string> codes = Codes(result);
  EXPECT_TRUE(Has(codes, "time_shift"));
  EXPECT_FALSE(Has(codes, "rig_disagrees"));
  ExpectNoNan(result);
  EXPECT_EQ(Run({"report", "out"}).status, kDone);

  // Without times only the disagreement is known.
  std::string session = Read("session.yaml");
  for (const char* name : {"left", "right"}) {
    session = Replaced(session, std::string("    times: times_") + name + ".txt\n", "");
  }
  Write("session.yaml", session);
  Calibrate();
  EXPECT_FALSE(Result()["cameras"]["right"]["time_shift"]);
  EXPECT_TRUE(Has(Codes(Result()), "rig_disagrees"));
}

TEST_F(Rigs, AMotionThatTimesExplainIsNoShift) {
  SimulateMovingPair(2, "    time_offset: 0.012\n");
  Calibrate();
  const YAML::Node right = Result()["cameras"]["right"];
  // The times alone explain the disagreement.
  ASSERT_TRUE(right["time_shift"]);
  EXPECT_LT(std::abs(right["time_shift"].as<double>()),
            kSigmas * right["sigma_time_shift"].as<double>());
  // And of cameras that are triggered together nothing is estimated.
  fs::remove_all(Path("out"));
  SimulateMovingPair(2, "");
  Calibrate();
  EXPECT_FALSE(Result()["cameras"]["right"]["time_shift"]);
}

TEST_F(Rigs, TimesMustFitTheFrames) {
  SimulateMovingPair(3, "");
  const std::string times = Read("times_right.txt");
  Write("times_right.txt", "000100 0\n");
  ExpectFailure(kWrongInput, {"times_right.txt", "no time for frame '000105' of camera right"});
  Write("times_right.txt", "0.1\n0.2\n");
  ExpectFailure(kWrongInput, {"times_right.txt", "has 2 times, but camera right has 80 frames"});
}

// poses.csv with positions times `factor`.
std::string Stretched(const std::string& poses, double factor) {
  std::string text;
  for (const std::string& line : Lines(poses)) {
    if (text.empty()) {
      text = line + "\n";
      continue;
    }
    std::istringstream cells(line);
    std::string cell;
    for (int i = 0; std::getline(cells, cell, ','); ++i) {
      if (i > 0) text += ",";
      text += i >= 1 && i <= 3 ? std::to_string(factor * std::stod(cell)) : cell;
    }
    text += "\n";
  }
  return text;
}

TEST_F(Rigs, RobotPosesGiveTheMountAndNameTheirMistakes) {
  SimulatePair("a", 1, "1100");
  CalibratePair("a", "");
  // A robot whose poses are the rig's true ones: the rig is its gripper, the target its base.
  const std::string truth = Read("a/truth/poses.csv");
  Write("robot.csv", truth);
  const Outcome found =
      Run({"handeye", "a/out", "--poses", "robot.csv", "-o", "handeye.yaml", "--scale"});
  ASSERT_EQ(found.status, kDone) << found.err;
  const YAML::Node result = YAML::LoadFile(Path("handeye.yaml"));
  const Eigen::Matrix4d mount = Matrix(result["T_gripper_rig"]);
  constexpr double kNear = 1e-3;  // m and rad
  EXPECT_LT((mount - Eigen::Matrix4d::Identity()).norm(), kNear);
  EXPECT_NEAR(result["scale"].as<double>(), 1, 1e-3);
  EXPECT_EQ(result["calibration_errors"].as<std::string>(), "included");
  ExpectNoNan(result);
  EXPECT_THAT(found.out, HasSubstr("lengths from outside are 1.000"));
  // Without the points nothing is known of the errors of the calibration's poses.
  std::filesystem::rename(Path("a/out/residuals.csv"), Path("a/residuals.csv"));
  const Outcome poses_only = Run({"handeye", "a/out", "--poses", "robot.csv", "-o", "few.yaml"});
  ASSERT_EQ(poses_only.status, kDone) << poses_only.err;
  EXPECT_EQ(YAML::LoadFile(Path("few.yaml"))["scale"].as<double>(), 1);  // held without --scale
  EXPECT_EQ(YAML::LoadFile(Path("few.yaml"))["sigma_scale"].as<double>(), 0);
  EXPECT_THAT(poses_only.out, HasSubstr("standard errors leave out those of the calibration: "));
  EXPECT_EQ(YAML::LoadFile(Path("few.yaml"))["calibration_errors"].as<std::string>(), "left_out");
  std::filesystem::rename(Path("a/residuals.csv"), Path("a/out/residuals.csv"));

  const Outcome wrong = Run({"handeye", "a/out", "--poses", "robot.csv", "--mount", "base"});
  EXPECT_EQ(wrong.status, kJobFailed);
  EXPECT_THAT(wrong.err, HasSubstr("the other way round"));
  Write("robot.csv", Stretched(truth, 1000));
  const Outcome unit = Run({"handeye", "a/out", "--poses", "robot.csv"});
  EXPECT_EQ(unit.status, kWrongInput);
  EXPECT_THAT(unit.err, HasSubstr("millimetres"));
  Write("robot.csv", "frame,x,y,z,qx,qy,qz,qw\nother,0,0,1,0,0,0,1\n");
  const Outcome names = Run({"handeye", "a/out", "--poses", "robot.csv"});
  EXPECT_EQ(names.status, kWrongInput);
  EXPECT_THAT(names.err, HasSubstr("names of the images"));
}

TEST_F(Rigs, RobotPosesMayHaveTimesOfAnotherClock) {
  SimulateMovingPair(4, "");
  Calibrate();
  // The robot logs the true poses 250 ms ahead of the images' clock.
  const std::vector<std::string> poses = Lines(Read("truth/poses.csv")),
                                 times = Lines(Read("times_left.txt"));
  ASSERT_EQ(poses.size(), times.size());
  std::string track;
  for (size_t i = 1; i < poses.size(); ++i) {
    std::string row = poses[i].substr(poses[i].find(',') + 1);
    std::ranges::replace(row, ',', ' ');
    track +=
        std::to_string(std::stod(times[i].substr(times[i].find(' '))) + 0.25) + " " + row + "\n";
  }
  Write("robot.tum", track);
  const std::vector<std::string> arguments{"handeye", "out", "--poses", "robot.tum"};
  const auto with = [&](std::vector<std::string> more) {
    more.insert(more.begin(), arguments.begin(), arguments.end());
    return Run(more);
  };
  const Outcome found = with({"--times", "times_left.txt", "-o", "handeye.yaml"});
  ASSERT_EQ(found.status, kDone) << found.err;
  const YAML::Node result = YAML::LoadFile(Path("handeye.yaml"));
  EXPECT_NEAR(result["time_shift"].as<double>(), 0.25, 5e-4);
  constexpr double kNear = 2e-3;  // m and rad: poses are 50 ms apart
  EXPECT_LT((Matrix(result["T_gripper_rig"]) - Eigen::Matrix4d::Identity()).norm(), kNear);
  ExpectNoNan(result);
  // The frames' names are numbers, but no times of the robot.
  const Outcome without = with({});
  EXPECT_EQ(without.status, kWrongInput);
  EXPECT_THAT(without.err, HasSubstr("0 of the 80 frames"));
}

TEST_F(Rigs, EarlierCalibrationsMustFitTheSession) {
  SimulatePair("a", 1, "1100");
  CalibratePair("a", "");
  const std::string session = Read("a/session.yaml");
  const auto expect = [&](const std::string& lines, const std::vector<std::string>& parts) {
    Write("a/session.yaml", Replaced(session, "cameras:\n", lines + "cameras:\n"));
    const Outcome outcome = Run({"calibrate", "a/session.yaml", "-o", "a/again"});
    EXPECT_EQ(outcome.status, kWrongInput) << lines;
    for (const std::string& part : parts) EXPECT_THAT(outcome.err, HasSubstr(part));
  };
  expect("from: nowhere.yaml\n", {"nowhere.yaml", "no such file"});
  expect("extrinsics_only: true\n", {"extrinsics_only", "left", "from"});
  Write("a/other.yaml",
        Replaced(Replaced(Read("a/out/calibration.yaml"), "  left:\n", "  links:\n"),
                 "  right:\n",
                 "  rechts:\n"));
  expect("from: other.yaml\n", {"other.yaml", "none of the session's cameras"});
}

}  // namespace TEST_FILE
}  // namespace plenocal::testing
