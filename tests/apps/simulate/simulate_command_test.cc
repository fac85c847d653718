// SPDX-License-Identifier: Apache-2.0
//
// `plenocal simulate`: sessions with known truth, made as a user makes them.
#include <fmt/format.h>

#include <Eigen/Core>
#include <cmath>
#include <map>
#include <regex>
#include <string>

#include "tests/apps/workspace.h"

namespace plenocal::testing {
namespace TEST_FILE {

using ::testing::HasSubstr;
namespace fs = std::filesystem;

class SimulateCommand : public Workspace {
 protected:
  SimulateCommand() {
    const fs::path examples = fs::path(PLENOCAL_EXAMPLES) / "simulate";
    fs::copy(examples / "target.yaml", Path("target.yaml"));
    fs::copy(examples / "plenoptic_stereo.yaml", Path("spec.yaml"));
  }

  Outcome Simulate(const std::vector<std::string>& more, const std::string& out = "set") const {
    std::vector<std::string> arguments{"simulate", "spec.yaml", "-o", out};
    arguments.insert(arguments.end(), more.begin(), more.end());
    return Run(arguments);
  }

  void Change(const std::string& from, const std::string& to) const {
    Write("spec.yaml", Replaced(Read("spec.yaml"), from, to));
  }

  void ExpectRefused(const std::vector<std::string>& parts) const {
    const Outcome outcome = Simulate({"--points"});
    EXPECT_EQ(outcome.status, kWrongInput) << outcome.err;
    EXPECT_EQ(Lines(outcome.err).size(), 1u) << outcome.err;
    for (const std::string& part : parts) EXPECT_THAT(outcome.err, HasSubstr(part));
    EXPECT_TRUE(Files("set").empty());
  }
};

/// Errors of all parameters in sigmas.
std::vector<double> ErrorsInSigmas(const YAML::Node& estimate, const YAML::Node& truth) {
  std::vector<double> errors;
  for (const auto& camera : truth["cameras"]) {
    const YAML::Node found = estimate["cameras"][camera.first.Scalar()];
    for (const auto& parameter : camera.second["parameters"]) {
      const std::string name = parameter.first.Scalar();
      errors.push_back((found["parameters"][name].as<double>() - parameter.second.as<double>()) /
                       found["sigma"][name].as<double>());
    }
  }
  return errors;
}

TEST_F(SimulateCommand, PointsCalibrateToTheTruth) {
  ASSERT_EQ(Simulate({"--points"}).status, kDone);
  const Outcome outcome = Run({"calibrate", "set/session.yaml", "-o", "out"});
  ASSERT_EQ(outcome.status, kDone) << outcome.err;
  const YAML::Node estimate = Result(), truth = YAML::Load(Read("set/truth/calibration.yaml"));
  const std::vector<double> errors = ErrorsInSigmas(estimate, truth);
  ASSERT_EQ(errors.size(), 23u);
  double squares = 0;
  for (const double error : errors) {
    EXPECT_LT(std::abs(error), 4);
    squares += error * error / static_cast<double>(errors.size());
  }
  EXPECT_GT(squares, 0.3);
  EXPECT_LT(squares, 2);
  for (const auto& camera : truth["cameras"]) {
    const YAML::Node residuals = estimate["cameras"][camera.first.Scalar()]["residuals"];
    EXPECT_NEAR(residuals["noise"].as<double>(), 0.1, 0.005);
    const Eigen::Matrix4d difference =
        Matrix(estimate["cameras"][camera.first.Scalar()]["T_camera_rig"]) -
        Matrix(camera.second["T_camera_rig"]);
    EXPECT_LT(difference.cwiseAbs().maxCoeff(), 2e-3);
  }
  // The true markers, which the nominal target does not know.
  EXPECT_THAT(Read("set/truth/target.yaml"), HasSubstr("markers:"));
  EXPECT_EQ(Table(Read("set/truth/poses.csv")).Rows(), 18u);
}

TEST_F(SimulateCommand, SameSeedSameFilesWhateverTheThreads) {
  ASSERT_EQ(Simulate({"--points", "--threads", "1"}, "a").status, kDone);
  ASSERT_EQ(Simulate({"--points", "--threads", "3"}, "b").status, kDone);
  for (const char* file : {"detections_left.csv",
                           "detections_plenoptic.csv",
                           "truth/poses.csv",
                           "truth/target.yaml",
                           "truth/micro_lenses_plenoptic.csv"}) {
    // Not EXPECT_EQ, which would print the files.
    EXPECT_TRUE(Read(std::string("a/") + file) == Read(std::string("b/") + file)) << file;
  }
  Change("seed: 7", "seed: 8");
  ASSERT_EQ(Simulate({"--points"}, "c").status, kDone);
  EXPECT_NE(Read("a/truth/poses.csv"), Read("c/truth/poses.csv"));
  EXPECT_NE(Read("a/truth/target.yaml"), Read("c/truth/target.yaml"));
}

TEST_F(SimulateCommand, ImagesAreTheSameWhateverTheThreadsAndCanBeMeasured) {
  Change("frames: 18", "frames: 2");
  Change("white_images: 5", "white_images: 2");
  Change("image_size: [800, 800]", "image_size: [400, 400]");
  Change("c_x: 402, c_y: 397", "c_x: 202, c_y: 197");
  ASSERT_EQ(Simulate({"--threads", "1"}, "a").status, kDone);
  ASSERT_EQ(Simulate({"--threads", "2"}, "b").status, kDone);
  for (const char* file :
       {"left/000100.png", "plenoptic/000105.png", "plenoptic_white/white_01.png"}) {
    EXPECT_FALSE(Read(std::string("a/") + file).empty()) << file;
    EXPECT_TRUE(Read(std::string("a/") + file) == Read(std::string("b/") + file)) << file;
  }
  // The white images give the micro-image centres back.
  const Outcome white = Run({"white", "a/session.yaml", "-o", "white"});
  ASSERT_EQ(white.status, kDone) << white.err;
  const Table found(Read("white/micro_lenses_plenoptic.csv"));
  const Table truth(Read("a/truth/micro_lenses_plenoptic.csv"));
  const std::vector<double> x = found.Numbers("x"), y = found.Numbers("y");
  const std::vector<double> true_x = truth.Numbers("x"), true_y = truth.Numbers("y");
  EXPECT_NEAR(static_cast<double>(x.size()), static_cast<double>(true_x.size()), 3);
  for (std::size_t i = 0; i < x.size(); ++i) {
    double nearest = 1e9;
    for (std::size_t k = 0; k < true_x.size(); ++k) {
      nearest = std::min(nearest, std::hypot(x[i] - true_x[k], y[i] - true_y[k]));
    }
    EXPECT_LT(nearest, 0.1);
  }
  // Images of another run are not mixed with these.
  Change("frames: 2", "frames: 1");
  const Outcome mixed = Simulate({}, "a");
  EXPECT_EQ(mixed.status, kWrongInput);
  EXPECT_THAT(mixed.err, HasSubstr("000105.png: is no image of this session"));
}

TEST_F(SimulateCommand, CloseViewsShowTagsWhereTheyAre) {
  // A bit is 35 pixels wide: the drawing of the target must be finer than these.
  Write(
      "tags.yaml",
      "plenocal: 1\ntype: apriltag\nfamily: tag36h11\ntags:\n"
      "  - {id: 0, corners: [[0, 0.12, 0], [0.12, 0.12, 0], [0.12, 0, 0], [0, 0, 0]]}\n"
      "  - {id: 1, corners: [[0.168, 0.12, 0], [0.288, 0.12, 0], [0.288, 0, 0], [0.168, 0, 0]]}\n");
  Write("close.yaml",
        "plenocal: 1\nseed: 5\ntarget: tags.yaml\n"
        "poses: {kind: varied, frames: 4, distance: [0.4, 0.5], partial: 0}\ncameras:\n"
        "  cam: {model: pinhole, image_size: [1280, 960], blur: 0.7, "
        "parameters: {f_x: 1000, f_y: 1000, c_x: 640, c_y: 480}}\n");
  ASSERT_EQ(Run({"simulate", "close.yaml", "-o", "close"}).status, kDone);
  ASSERT_EQ(Run({"detect", "close/session.yaml", "-o", "found"}).status, kDone);
  const auto places = [&](const std::string& file) {
    const Table table(Read(file));
    const auto frame = table.Column("frame"), marker = table.Column("marker");
    const auto x = table.Numbers("x"), y = table.Numbers("y");
    std::map<std::string, Eigen::Vector2d> all;
    for (size_t i = 0; i < x.size(); ++i) all[frame[i] + " " + marker[i]] = {x[i], y[i]};
    return all;
  };
  const auto truth = places("close/truth/detections_cam.csv");
  double square = 0;
  int count = 0;
  for (const auto& [name, place] : places("found/detections_cam.csv")) {
    ASSERT_TRUE(truth.contains(name)) << name;
    square += (place - truth.at(name)).squaredNorm() / 2;
    ++count;
  }
  ASSERT_GT(count, 16);
  EXPECT_LT(std::sqrt(square / count), 0.008);  // px, twice what noise makes
}

TEST_F(SimulateCommand, SomeFramesShowTheTargetToSomeCamerasOnly) {
  ASSERT_EQ(Simulate({"--points"}).status, kDone);
  const Table frames(Read("set/truth/frames.csv"));
  const std::vector<double> left = frames.Numbers("markers_left"),
                            plenoptic = frames.Numbers("markers_plenoptic");
  EXPECT_GT(*std::min_element(left.begin(), left.end()), 8);
  EXPECT_EQ(*std::min_element(plenoptic.begin(), plenoptic.end()), 0);
  EXPECT_GT(*std::max_element(plenoptic.begin(), plenoptic.end()), 100);
}

TEST_F(SimulateCommand, SaysAtWhichVirtualDepthsTheTargetIs) {
  const Outcome outcome = Simulate({"--points"});
  std::smatch found;
  const std::regex sentence(
      R"(plenoptic: .* virtual depths from ([\d.]+) to ([\d.]+) \(sharp: 2.4, 3, 3.9\))");
  ASSERT_TRUE(std::regex_search(outcome.out, found, sentence)) << outcome.out;
  // Virtual depth v = a + b / z (docs/plenoptic.md).
  const double f_L = 0.0122, b_L0 = 0.01166, B = 0.00026;
  const double a = (b_L0 + B) / B * (1 - b_L0 / f_L), b = (b_L0 + B) * b_L0 / B;
  const double farthest = b / (std::stod(found[1]) - a), nearest = b / (std::stod(found[2]) - a);
  // The target's middle is 0.36 to 0.7 m away, its markers up to 0.15 m from it.
  EXPECT_GT(nearest, 0.36 - 0.15);
  EXPECT_LT(nearest, 0.36 + 0.05);
  EXPECT_GT(farthest, 0.7 - 0.05);
  EXPECT_LT(farthest, 0.7 + 0.15);
}

TEST_F(SimulateCommand, BadPoseSetsAreBadInTheirOwnWay) {
  const auto distances = [&] {
    std::vector<double> all;
    const Table poses(Read("set/truth/poses.csv"));
    const std::vector<double> x = poses.Numbers("x"), y = poses.Numbers("y"),
                              z = poses.Numbers("z");
    for (std::size_t i = 0; i < x.size(); ++i) {
      all.push_back((Eigen::Vector3d(x[i], y[i], z[i]) - Eigen::Vector3d(0, 0.06, 0.06)).norm());
    }
    return all;
  };
  Change("kind: varied", "kind: no-tilt");
  ASSERT_EQ(Simulate({"--points"}).status, kDone);
  // Only turned about the line of sight: the camera's axis has one direction in the target.
  const Table poses(Read("set/truth/poses.csv"));
  const auto qx = poses.Numbers("qx"), qy = poses.Numbers("qy"), qz = poses.Numbers("qz"),
             qw = poses.Numbers("qw");
  const Eigen::Matrix4d mount = Matrix(
      YAML::Load(Read("set/truth/calibration.yaml"))["cameras"]["plenoptic"]["T_camera_rig"]);
  for (std::size_t i = 0; i < qx.size(); ++i) {
    const auto axis = [&](std::size_t k) -> Eigen::Vector3d {
      return Eigen::Quaterniond(qw[k], qx[k], qy[k], qz[k]) *
             mount.topLeftCorner<3, 3>().transpose().col(2);
    };
    EXPECT_NEAR(axis(i).dot(axis(0)), 1, 1e-9);
  }
  Change("kind: no-tilt", "kind: one-distance");
  ASSERT_EQ(Simulate({"--points"}).status, kDone);
  const std::vector<double> all = distances();
  EXPECT_LT(*std::max_element(all.begin(), all.end()),
            1.4 * *std::min_element(all.begin(), all.end()));
  Change("kind: one-distance", "kind: corner");
  ASSERT_EQ(Simulate({"--points"}).status, kDone);
  const Table seen(Read("set/truth/detections_plenoptic.csv"));
  EXPECT_GT(seen.Rows(), 500u);
  for (const double x : seen.Numbers("x")) EXPECT_LE(x, 399.5);
  for (const double y : seen.Numbers("y")) EXPECT_LE(y, 399.5);
}

TEST_F(SimulateCommand, RendersGivenPosesAgain) {
  ASSERT_EQ(Simulate({"--points"}).status, kDone);
  fs::copy(Path("set/truth/poses.csv"), Path("poses.csv"));
  Change("{kind: varied, frames: 18, distance: [0.36, 0.7], partial: 0.4, aim: plenoptic}",
         "{file: poses.csv}");
  ASSERT_EQ(Simulate({"--points"}, "again").status, kDone);
  const Table first(Read("set/detections_left.csv")), second(Read("again/detections_left.csv"));
  EXPECT_EQ(first.Column("frame"), second.Column("frame"));
  const std::vector<double> x = first.Numbers("x"), again = second.Numbers("x");
  for (std::size_t i = 0; i < x.size(); ++i) ASSERT_NEAR(x[i], again[i], 1e-6);
}

TEST_F(SimulateCommand, NamesWhatIsWrongInTheSpecification) {
  const std::string good = Read("spec.yaml");
  const std::vector<std::array<std::string, 4>> cases{
      {"pitch: 19", "pich: 19", "spec.yaml:29", "pitch"},
      {"kind: varied", "kind: vared", "spec.yaml:7", "varied"},
      {"kind: varied", "kind: []", "spec.yaml:7", "empty"},
      {"kind: varied", "kind: [varied, corner]", "spec.yaml:7", "no other kind"},
      {"model: pinhole-radial3", "model: pinhole-radial", "spec.yaml:11", "pinhole-radial3"},
      {"aim: plenoptic", "aim: plenopti", "spec.yaml:7", "plenoptic"},
      {"f_x: 410, ", "", "spec.yaml:13", "f_x"},
      {"distance: [0.36, 0.7]", "distance: [0.7, 0.36]", "spec.yaml:7", "nearest"},
      {"focus: [2.4, 3.0, 3.9]", "focus: [2.4, 3.0]", "spec.yaml:31", "need a 'pattern'"},
      {"focus: [2.4, 3.0, 3.9]",
       "focus: [2, 2, 3, 3, 4]",
       "spec.yaml:31",
       "one to 4 virtual depths"},
      {"focus: [2.4, 3.0, 3.9]",
       "focus: [2, 3]\n      pattern: [[0, 2]]",
       "spec.yaml:32",
       "0 to 1"},
      {"focus: [2.4, 3.0, 3.9]",
       "focus: [2, 3]\n      pattern: [[0, 0]]",
       "spec.yaml:32",
       "no lens type 1"},
      {"focus: [2.4, 3.0, 3.9]",
       "focus: [2, 3]\n      pattern: [[0, 1], [1]]",
       "spec.yaml:32",
       "as in the first row"},
      {"focus: [2.4, 3.0, 3.9]", "focus: [0.5]", "spec.yaml:31", "at least 1"},
      {"blur: 0.35", "vignetting: 0.35", "spec.yaml:27", "fill"},
      {"0.005, -0.02, 0.01]", "0.005, 1e308, 0.01]", "spec.yaml:19", "at most 2 pi"},
      {"xi_camera_rig: [-0.1,", "xi_camera_rig: [1e300,", "spec.yaml:19", "a translation"},
      {"xi_camera_rig: [-0.1, 0.001, -0.002, 0.005, -0.02, 0.01]",
       "T_camera_rig: [[1, 0.1, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]",
       "spec.yaml:19",
       "no rotation"},
      {"target: target.yaml", "target: other.yaml", "other.yaml", "no such file"}};
  for (const auto& [from, to, place, part] : cases) {
    SCOPED_TRACE(to);
    Write("spec.yaml", Replaced(good, from, to));
    ExpectRefused({place, part});
  }
}

TEST_F(SimulateCommand, RepeatsAPatternOfLensTypes) {
  Change("focus: [2.4, 3.0, 3.9]", "focus: [2.4, 3.9]\n      pattern: [[0, 0, 1], [1, 0, 0]]");
  ASSERT_EQ(Simulate({"--points"}).status, kDone);
  const Table lenses(Read("set/truth/micro_lenses_plenoptic.csv"));
  const std::vector<double> rows = lenses.Numbers("row"), columns = lenses.Numbers("column"),
                            types = lenses.Numbers("type");
  ASSERT_GT(types.size(), 100u);
  for (size_t i = 0; i < types.size(); ++i) {
    const int row = static_cast<int>(rows[i]) & 1;
    const int column = ((static_cast<int>(columns[i]) % 3) + 3) % 3;
    ASSERT_EQ(types[i], column == (row == 0 ? 2 : 0) ? 1 : 0);
  }
}

TEST_F(SimulateCommand, RefusesToReplaceItsInputs) {
  const std::string target = Read("target.yaml");
  const Outcome outcome = Simulate({"--points"}, ".");
  EXPECT_EQ(outcome.status, kWrongInput);
  EXPECT_THAT(outcome.err, HasSubstr("target.yaml: the results would replace this input"));
  EXPECT_EQ(Read("target.yaml"), target);
}

}  // namespace TEST_FILE
}  // namespace plenocal::testing
