// SPDX-License-Identifier: Apache-2.0
//
// What stands in the result files, read by other means than the program's own.
#include <fmt/format.h>

#include <cmath>
#include <unsupported/Eigen/MatrixFunctions>

#include "tests/apps/workspace.h"

namespace plenocal::testing {
namespace TEST_FILE {

using ::testing::HasSubstr;

constexpr double kMarkerTolerance = 3e-4;  // m

class Results : public Workspace {
 protected:
  const SyntheticProblem problem_ = EasyProblem(2, kMarkerTolerance);

  Results() { WriteProblem(problem_); }

  // Adds lines to the first camera of the session.
  void AddToFirstCamera(const std::string& lines) const {
    Write("session.yaml", Replaced(Read("session.yaml"), "  cam1:", lines + "  cam1:"));
  }

  // Root of the mean square distance of a target file's markers from the true ones.
  [[nodiscard]] double MarkerError(const YAML::Node& markers) const {
    double sum = 0;
    for (const auto& [number, position] : problem_.markers) {
      const auto p = markers[fmt::format("{}", number)].as<std::vector<double>>();
      sum += (Eigen::Vector3d(p[0], p[1], p[2]) - position).squaredNorm();
    }
    return std::sqrt(sum / static_cast<double>(problem_.markers.size()));
  }
};

TEST_F(Results, HoldNoNanAndAllPromisedKeys) {
  Calibrate();
  for (const char* name : {"target.yaml", "poses.csv", "residuals.csv", "detections_cam0.csv"}) {
    EXPECT_THAT(Read(std::string("out/") + name), ::testing::Not(HasSubstr("nan"))) << name;
  }
  const YAML::Node result = Result();
  ExpectNoNan(result);
  EXPECT_EQ(result["plenocal"].as<int>(), 1);
  EXPECT_EQ(result["frames"].as<int>(), 10);
  for (const char* name : {"cam0", "cam1"}) {
    const YAML::Node camera = result["cameras"][name];
    EXPECT_EQ(camera["model"].as<std::string>(), "pinhole-radial3");
    EXPECT_EQ(camera["image_size"].as<std::vector<int>>(), (std::vector<int>{1280, 960}));
    for (const char* param : {"f_x", "f_y", "c_x", "c_y", "A_0", "A_1", "A_2"}) {
      EXPECT_TRUE(std::isfinite(camera["parameters"][param].as<double>()));
      EXPECT_GT(camera["sigma"][param].as<double>(), 0);
    }
    EXPECT_EQ(camera["sigma_xi"].size(), 6U);
  }
}

TEST_F(Results, PoseIsTheExponentialOfItsVector) {
  Calibrate();
  for (const char* name : {"cam0", "cam1"}) {
    const YAML::Node camera = Result()["cameras"][name];
    const auto xi = camera["xi_camera_rig"].as<std::vector<double>>();
    Eigen::Matrix4d hat = Eigen::Matrix4d::Zero();
    hat.topLeftCorner<3, 3>() << 0, -xi[5], xi[4], xi[5], 0, -xi[3], -xi[4], xi[3], 0;
    hat.topRightCorner<3, 1>() << xi[0], xi[1], xi[2];
    EXPECT_LT((hat.exp() - Matrix(camera["T_camera_rig"])).norm(), 1e-10);
  }
}

TEST_F(Results, AgreeWithTheResidualsTable) {
  Calibrate();
  const Table table(Read("out/residuals.csv"));
  const auto cameras = table.Column("camera"), used = table.Column("used");
  const auto dx = table.Numbers("dx"), dy = table.Numbers("dy");
  for (const char* name : {"cam0", "cam1"}) {
    double squares = 0;
    int points = 0, rejected = 0;
    for (std::size_t i = 0; i < table.Rows(); ++i) {
      if (cameras[i] != name) continue;
      if (used[i] != "1") {
        ++rejected;
        continue;
      }
      squares += dx[i] * dx[i] + dy[i] * dy[i];
      ++points;
    }
    const YAML::Node residuals = Result()["cameras"][name]["residuals"];
    EXPECT_EQ(residuals["points"].as<int>(), points);
    EXPECT_EQ(residuals["rejected"].as<int>(), rejected);
    EXPECT_NEAR(residuals["rms"].as<double>(), std::sqrt(squares / points), 1e-5);
    // Noise of 0.1 px a coordinate.
    EXPECT_NEAR(residuals["rms"].as<double>(), 0.1 * std::sqrt(2), 0.015);
  }
}

TEST_F(Results, RejectAnOutlierAndReportIt) {
  // One row of 700, off by 20 px.
  std::vector<std::string> lines = Lines(Read("cam0.csv"));
  std::string text;
  for (std::size_t i = 0; i < lines.size(); ++i) {
    text += (i == 30 ? Replaced(lines[i], ".", "0.") : lines[i]) + "\n";
  }
  Write("cam0.csv", text);
  Calibrate();
  EXPECT_EQ(Result()["cameras"]["cam0"]["residuals"]["rejected"].as<int>(), 1);
}

TEST_F(Results, TruthLiesWithinTheSigmas) {
  Calibrate();
  constexpr double kSigmas = 4;  // of 14 values none beyond, but for one seed in a thousand
  const std::vector<std::string> names{"f_x", "f_y", "c_x", "c_y", "A_0", "A_1", "A_2"};
  for (std::size_t c = 0; c < 2; ++c) {
    const YAML::Node camera = Result()["cameras"][fmt::format("cam{}", c)];
    for (std::size_t i = 0; i < names.size(); ++i) {
      EXPECT_NEAR(camera["parameters"][names[i]].as<double>(),
                  problem_.params[c][i],
                  kSigmas * camera["sigma"][names[i]].as<double>())
          << names[i];
    }
  }
}

TEST_F(Results, RefinedTargetIsTheNextSessionsTarget) {
  Calibrate();
  const YAML::Node refined = YAML::Load(Read("out/target.yaml"));
  EXPECT_EQ(refined["type"].as<std::string>(), "chessboard");
  EXPECT_EQ(refined["columns"].as<int>(), 10);
  EXPECT_EQ(refined["markers"].size(), 70U);
  EXPECT_EQ(refined["sigma"].size(), 70U);
  EXPECT_LT(MarkerError(refined["markers"]), 0.7 * std::sqrt(3.0) * kMarkerTolerance);

  Write("session.yaml",
        Replaced(Read("session.yaml"), "target: target.yaml", "target: out/target.yaml") +
            "  refine_target: false\n");
  Calibrate("next");
  EXPECT_NEAR(Result("next")["cameras"]["cam0"]["residuals"]["rms"].as<double>(),
              Result("out")["cameras"]["cam0"]["residuals"]["rms"].as<double>(),
              0.005);
}

TEST_F(Results, OfARigidTargetAreWorseHere) {
  Calibrate("refined");
  Write("session.yaml", Read("session.yaml") + "  refine_target: false\n");
  Calibrate("rigid");
  for (const char* name : {"cam0", "cam1"}) {
    EXPECT_LT(Result("refined")["cameras"][name]["residuals"]["rms"].as<double>(),
              0.7 * Result("rigid")["cameras"][name]["residuals"]["rms"].as<double>());
  }
}

TEST_F(Results, HoldFixedParametersAtTheirValues) {
  AddToFirstCamera("    initial: {A_2: 0, c_x: 640}\n    fixed: [A_2, c_x]\n");
  const Outcome outcome = Calibrate();
  const YAML::Node camera = Result()["cameras"]["cam0"];
  EXPECT_EQ(camera["parameters"]["A_2"].as<double>(), 0);
  EXPECT_EQ(camera["parameters"]["c_x"].as<double>(), 640);
  EXPECT_EQ(camera["sigma"]["c_x"].as<double>(), 0);
  EXPECT_GT(camera["sigma"]["c_y"].as<double>(), 0);
  EXPECT_THAT(outcome.out, HasSubstr("(fixed)"));
}

TEST_F(Results, HoldAllParametersOfACameraOnRequest) {
  const std::vector<double>& p = problem_.params[0];
  AddToFirstCamera(
      fmt::format("    initial: {{f_x: {}, f_y: {}, c_x: {}, c_y: {}, A_0: {}, A_1: {}, A_2: {}}}\n"
                  "    fixed: [f_x, f_y, c_x, c_y, A_0, A_1, A_2]\n",
                  p[0],
                  p[1],
                  p[2],
                  p[3],
                  p[4],
                  p[5],
                  p[6]));
  Calibrate();
  EXPECT_NEAR(Result()["cameras"]["cam0"]["parameters"]["f_x"].as<double>(), p[0], 1e-6);
}

TEST_F(Results, DoNotDependOnInitialValues) {
  Calibrate("without");
  AddToFirstCamera("    initial: {f_x: 1000, A_0: 0.05}\n");
  Calibrate("with");
  for (const char* param : {"f_x", "c_y", "A_0"}) {
    const YAML::Node without = Result("without")["cameras"]["cam0"];
    EXPECT_NEAR(Result("with")["cameras"]["cam0"]["parameters"][param].as<double>(),
                without["parameters"][param].as<double>(),
                0.01 * without["sigma"][param].as<double>());
  }
}

TEST_F(Results, SummaryNamesWhatAPersonWantsToKnow) {
  const Outcome outcome = Calibrate();
  for (const char* part : {"2 cameras",
                           "cam0",
                           "RMS",
                           "points",
                           "rejected",
                           "f_x",
                           "+-",
                           "baseline",
                           "degrees",
                           "refined markers",
                           "written to out"}) {
    EXPECT_THAT(outcome.out, HasSubstr(part));
  }
}

TEST_F(Results, SummaryNamesTheCommandForMoreImagesWhereTheyAreWanted) {
  WriteProblem(MakeProblem(3, {.cameras = 1, .frames = 3, .noise = 0.1}));
  const Outcome outcome = Calibrate();
  EXPECT_THAT(outcome.out, HasSubstr("verdict: bad"));
  EXPECT_THAT(outcome.out, HasSubstr("what to record next: plenocal suggest out\n"));
}

// By a bar between two markers the print is 0.3 % larger than stated.
TEST_F(Results, HaveTheSizeOfThePrintByAMeasuredDistance) {
  const SyntheticProblem problem = EasyProblem(2);
  const double length = 1.003 * (problem.markers.at(0) - problem.markers.at(69)).norm();
  WriteProblem(problem);
  Write("target.yaml", Read("target.yaml") + "scale_sigma: 0.005\n");
  Write("session.yaml",
        Replaced(Read("session.yaml"),
                 "cameras:",
                 fmt::format("distances: [{{between: [marker 0, marker 69], length: {:.9g}, sigma: "
                             "{:.9g}}}]\ncameras:",
                             length,
                             1e-4 * length)));
  const Outcome outcome = Calibrate("bar");
  EXPECT_THAT(outcome.out, ::testing::HasSubstr("target.scale: 0.3"));
  const YAML::Node scale = Result("bar")["target_scale"];
  EXPECT_NEAR(scale["value"].as<double>(), 0.003, 3e-4);
  EXPECT_NEAR(scale["sigma"].as<double>() / 1e-4, 1, 0.1);
  EXPECT_THAT(Read("bar/correlations.csv"), ::testing::HasSubstr(",target.scale"));
  const Outcome json = Run({"calibrate", "session.yaml", "-o", "json", "--no-report", "--json"});
  EXPECT_THAT(json.out, ::testing::HasSubstr("\"target_scale\":"));
  // Whoever reads the calibration has it.
  EXPECT_EQ(Run({"compare", "bar/calibration.yaml", "bar/calibration.yaml"}).status, kDone);
}

TEST_F(Results, SaysWhatWasKnownOfParametersBesideTheImages) {
  WriteProblem(EasyProblem(2));
  const YAML::Node free = [&] {
    Calibrate("free");
    return Result("free")["cameras"];
  }();
  const double A_0 = free["cam0"]["parameters"]["A_0"].as<double>();
  const std::string session = Read("session.yaml");
  Write("session.yaml",
        Replaced(Replaced(session,
                          "    detections: cam0.csv\n",
                          fmt::format("    detections: cam0.csv\n    equal: [[f_x, f_y]]\n"
                                      "    bounds: {{A_0: [{}, {}]}}\n",
                                      A_0 + 0.02,
                                      A_0 + 0.05)),
                 "    detections: cam1.csv\n",
                 "    detections: cam1.csv\n    shared: {c_x: cam0}\n"
                 "    prior: {c_y: {value: 480, sigma: 2}}\n"));
  const Outcome outcome = Calibrate("ruled");
  const YAML::Node cameras = Result("ruled")["cameras"];
  for (const char* key : {"parameters", "sigma"}) {
    EXPECT_EQ(cameras["cam0"][key]["f_x"].as<double>(), cameras["cam0"][key]["f_y"].as<double>());
    EXPECT_EQ(cameras["cam1"][key]["c_x"].as<double>(), cameras["cam0"][key]["c_x"].as<double>());
  }
  EXPECT_EQ(cameras["cam0"]["correlation"][1][0].as<double>(), 1);
  EXPECT_NEAR(cameras["cam0"]["parameters"]["A_0"].as<double>(), A_0 + 0.02, 1e-9);
  EXPECT_EQ(cameras["cam0"]["sigma"]["A_0"].as<double>(), 0);
  EXPECT_EQ(cameras["cam0"]["at_bound"][0].as<std::string>(), "A_0");
  for (const char* part : {"(tied to f_x)",
                           "(tied to cam0.c_x)",
                           "(at its bound)",
                           "(prior 480 +- 2)",
                           "cam0.A_0 lies on its bound"}) {
    EXPECT_THAT(outcome.out, ::testing::HasSubstr(part));
  }
  // The report and `compare` read it like any other.
  EXPECT_EQ(Run({"compare", "ruled/calibration.yaml", "free/calibration.yaml"}).status, kDone);

  Write("session.yaml",
        Replaced(Replaced(session,
                          "    detections: cam0.csv\n",
                          "    detections: cam0.csv\n    shared: {f_x: cam1}\n"),
                 "    detections: cam1.csv\n",
                 "    detections: cam1.csv\n    shared: {f_x: cam0}\n"));
  ExpectFailure(kWrongInput, {"session.yaml:", "tied to itself"});
}

}  // namespace TEST_FILE
}  // namespace plenocal::testing
