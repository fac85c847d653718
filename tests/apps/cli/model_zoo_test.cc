// SPDX-License-Identifier: Apache-2.0
//
// Models on real sets (docs/data.md; skipped where they are absent), with views held out, and on
// simulated lenses; a camera that is held in all.
#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <fstream>
#include <sstream>

#include "models/registry.h"
#include "tests/apps/workspace.h"
#include "tests/optional_data.h"

namespace plenocal::testing {
namespace TEST_FILE {

namespace fs = std::filesystem;

class FisheyeHeldOut : public Workspace, public ::testing::WithParamInterface<const char*> {
 protected:
  // Points of a part of the set as detections; fills the target's markers.
  std::string Detections(const fs::path& file, std::map<std::string, int>* markers) const {
    std::string text = "frame,marker,x,y\n", line;
    std::ifstream in(file);
    while (std::getline(in, line)) {
      if (line.starts_with('#')) continue;
      std::vector<std::string> cells;
      std::stringstream row(line);
      for (std::string cell; std::getline(row, cell, ',');) cells.push_back(cell);
      constexpr double kUnit = 0.01;  // m: four units are a square of 40 mm
      const std::string place = fmt::format("[{:.9g}, {:.9g}, {:.9g}]",
                                            kUnit * std::stod(cells[2]),
                                            kUnit * std::stod(cells[3]),
                                            kUnit * std::stod(cells[4]));
      const int marker = markers->emplace(place, static_cast<int>(markers->size())).first->second;
      text += fmt::format("view{},{},{},{}\n", cells[0], marker, cells[5], cells[6]);
    }
    return text;
  }
  void WriteSession(const std::string& target,
                    const std::string& detections,
                    const std::string& more,
                    bool refine_target) const {
    Write("session.yaml",
          fmt::format("plenocal: 1\ntarget: {}\ncameras:\n  cam: {{model: {}, detections: {}, "
                      "image_size: [1280, 800]{}}}\noptions: {{refine_target: {}}}\n",
                      target,
                      GetParam(),
                      detections,
                      more,
                      refine_target));
  }
};

TEST_P(FisheyeHeldOut, IsNoWorseThanTheReferenceWithoutStartValues) {
  const fs::path set = OptionalData("frames/fisheye_3plane_ovcube");
  if (!fs::exists(set)) GTEST_SKIP() << Absent(set);
  std::map<std::string, int> markers;
  Write("train.csv", Detections(set / "corners_train.csv", &markers));
  Write("test.csv", Detections(set / "corners_test.csv", &markers));
  std::string target = "plenocal: 1\ntype: markers\nmarkers:\n";
  for (const auto& [place, number] : markers) target += fmt::format("  {}: {}\n", number, place);
  Write("target.yaml", target);
  WriteSession("target.yaml", "train.csv", "", true);
  Calibrate("train");

  // Only the poses of the held-out views are free.
  const YAML::Node parameters = Result("train")["cameras"]["cam"]["parameters"];
  std::string initial, fixed;
  for (const auto& parameter : parameters) {
    const auto name = parameter.first.as<std::string>();
    initial += fmt::format(
        "{}{}: {}", initial.empty() ? "" : ", ", name, parameter.second.as<std::string>());
    fixed += (fixed.empty() ? "" : ", ") + name;
  }
  WriteSession("train/target.yaml",
               "test.csv",
               fmt::format(", initial: {{{}}}, fixed: [{}]", initial, fixed),
               false);
  Calibrate("test");
  EXPECT_EQ(Result("test")["cameras"]["cam"]["sigma"]["f_x"].as<double>(), 0);

  const Table residuals(Read("test/residuals.csv"));
  const auto dx = residuals.Numbers("dx"), dy = residuals.Numbers("dy");
  double squares = 0;
  for (size_t i = 0; i < dx.size(); ++i) squares += dx[i] * dx[i] + dy[i] * dy[i];
  // SOURCE.md, "Notes": the Kannala-Brandt model of the reference, all test points.
  constexpr double kReference = 0.2932330160573594;
  EXPECT_EQ(dx.size(), 1446);
  EXPECT_LE(std::sqrt(squares / static_cast<double>(dx.size())), kReference);
}

INSTANTIATE_TEST_SUITE_P(Models,
                         FisheyeHeldOut,
                         ::testing::Values("kannala-brandt4",
                                           "kannala-brandt4+pupil",
                                           "double-sphere"),
                         [](const auto& test) {
                           std::string name = test.param;
                           std::erase_if(name, [](char c) { return c == '-' || c == '+'; });
                           return name;
                         });

// Random cameras of one model, seen in noisy points.
class SimulatedLens : public Workspace {
 protected:
  // `parameters` as in the specification; makes set/.
  void Simulate(const std::string& model,
                const std::string& parameters,
                int frames,
                int seed = 3,
                double noise = 0.05,
                ImageSize size = {640, 480}) const {
    Write("target.yaml", "plenocal: 1\ntype: chessboard\ncolumns: 14\nrows: 10\nsquare: 0.03\n");
    Write(
        "spec.yaml",
        fmt::format("plenocal: 1\nseed: {}\ntarget: target.yaml\ntarget_error: 0\ncameras:\n  "
                    "cam: {{model: {}, image_size: [{}, {}], parameters: {{{}}}, detection_sigma: "
                    "{}}}\nposes: {{frames: {}, distance: [0.18, 0.45], partial: 0.3}}\n",
                    seed,
                    model,
                    size[0],
                    size[1],
                    parameters,
                    noise,
                    frames));
    const Outcome outcome = Run({"simulate", "spec.yaml", "--points", "-o", "set"});
    ASSERT_EQ(outcome.status, kDone) << outcome.err;
  }
  void ExpectTruthWithinUncertainty() const {
    const Outcome compared = Run({"compare", "out/calibration.yaml", "set/truth/calibration.yaml"});
    EXPECT_EQ(compared.status, kDone) << compared.err;
    EXPECT_THAT(compared.out, ::testing::HasSubstr("same within")) << compared.out;
  }
  static std::string ExampleOf(const CameraModel& model) {
    std::string text;
    for (size_t k = 0; k < model.params.size(); ++k) {
      text += fmt::format("{}{}: {}", k == 0 ? "" : ", ", model.params[k].name, model.example[k]);
    }
    return text;
  }
  // The largest difference from the truth over the image, px.
  [[nodiscard]] double LargestDifference() const {
    const Outcome compared =
        Run({"compare", "out/calibration.yaml", "set/truth/calibration.yaml", "-o", "compared"});
    EXPECT_EQ(compared.status, kDone) << compared.err;
    const std::vector<double> largest = Table(Read("compared/compare.csv")).Numbers("largest");
    return *std::max_element(largest.begin(), largest.end());
  }
};

TEST_F(SimulatedLens, OfASplineIsFoundWithinItsUncertainty) {
  Simulate("splined", ExampleOf(*FindModel(CameraModels(), "splined")), 30);
  const Outcome outcome = Run({"calibrate", "set/session.yaml", "-o", "out"});
  ASSERT_EQ(outcome.status, kDone) << outcome.err;
  // One line for all coefficients.
  EXPECT_THAT(outcome.out, ::testing::HasSubstr("x_00_00 ... y_10_08: 198 coefficients"));
  EXPECT_THAT(outcome.out, ::testing::Not(::testing::HasSubstr("x_03_03 ")));
  const YAML::Node camera = Result()["cameras"]["cam"];
  EXPECT_EQ(camera["sigma"]["f_x"].as<double>(), 0);
  EXPECT_GT(camera["sigma"]["x_03_03"].as<double>(), 0);
  EXPECT_LT(camera["sigma"]["x_03_03"].as<double>(), 1e-3);
  ExpectTruthWithinUncertainty();
}

TEST_F(SimulatedLens, ExactPointsGiveEveryModelBack) {
  int models = 0;
  for (const CameraModel& model : CameraModels()) {
    if (!model.IsCentral() || model.support_size > 0) continue;
    ++models;
    SCOPED_TRACE(model.name);
    Simulate(std::string(model.name), ExampleOf(model), 12, 3, 0, model.example_size);
    const Outcome outcome = Run({"calibrate", "set/session.yaml", "-o", "out", "--no-report"});
    ASSERT_EQ(outcome.status, kDone) << outcome.err;
    EXPECT_LT(LargestDifference(), 1e-5);
  }
  EXPECT_GT(models, 10);
}

TEST_F(SimulatedLens, ExactPointsGiveASplineBackOnItsOwnKnots) {
  const CameraModel& model = *FindModel(CameraModels(), "splined");
  Simulate("splined", ExampleOf(model), 40, 3, 0);
  std::string knots;  // what says where the knots are and how the camera's frame is turned
  for (size_t k = 0; k < model.params.size(); ++k) {
    if (model.params[k].fixed == Fixed::kNever) continue;
    knots +=
        fmt::format("{}{}: {}", knots.empty() ? "" : ", ", model.params[k].name, model.example[k]);
  }
  Write("set/session.yaml",
        Replaced(Read("set/session.yaml"),
                 "model: splined\n",
                 fmt::format("model: splined\n    initial: {{{}}}\n", knots)));
  const Outcome outcome = Run({"calibrate", "set/session.yaml", "-o", "out", "--no-report"});
  ASSERT_EQ(outcome.status, kDone) << outcome.err;
  EXPECT_LT(LargestDifference(), 1e-3);
}

TEST_F(SimulatedLens, SplineSaysWhichCoefficientsFollowFromItsPriorAlone) {
  Simulate("splined", ExampleOf(*FindModel(CameraModels(), "splined")), 20);
  // Nothing is seen in the left third of the image.
  std::string right;
  for (const std::string& line : Lines(Read("set/detections_cam.csv"))) {
    std::stringstream row(line);
    std::string frame, marker, x;
    std::getline(std::getline(std::getline(row, frame, ','), marker, ','), x, ',');
    if (frame == "frame" || std::stod(x) > 213) right += line + "\n";
  }
  Write("set/detections_cam.csv", right);
  const Outcome outcome = Run({"calibrate", "set/session.yaml", "-o", "out", "--no-report"});
  ASSERT_EQ(outcome.status, kDone) << outcome.err;
  EXPECT_THAT(outcome.out, ::testing::HasSubstr("coefficients, determined by the model's prior"));
  const YAML::Node sigma = Result()["cameras"]["cam"]["sigma"];
  EXPECT_GT(sigma["x_01_04"].as<double>(), 0.02);
  EXPECT_LT(sigma["x_08_04"].as<double>(), 1e-3);
}

TEST_F(SimulatedLens, DoubleSphereDoesNotStartAtTheLimitOfXi) {
  Simulate("double-sphere",
           "f_x: 240.4097724303577, f_y: 244.0851831359114, c_x: 324.97525366357314, c_y: "
           "233.94686545260805, xi: -0.12750905446289162, alpha: 0.6428656885169777",
           30,
           344913330);
  const Outcome outcome = Run({"calibrate", "set/session.yaml", "-o", "out", "--no-report"});
  ASSERT_EQ(outcome.status, kDone) << outcome.err;
  ExpectTruthWithinUncertainty();
}

TEST_F(SimulatedLens, DoubleSphereFindsTheBetterOfSeveralMinima) {
  // A fit from xi = 0 ends at -0.24, and at the limits of xi and alpha.
  const std::array lenses{
      "f_x: 464.6, f_y: 457.2, c_x: 326.7, c_y: 232.4, xi: 0.89, alpha: 0.7376",
      "f_x: 257.1, f_y: 253.4, c_x: 311.9, c_y: 238.8, xi: -0.446, alpha: 0.25",
  };
  for (const char* lens : lenses) {
    Simulate("double-sphere", lens, 20);
    const Outcome outcome = Run({"calibrate", "set/session.yaml", "-o", "out", "--no-report"});
    ASSERT_EQ(outcome.status, kDone) << outcome.err;
    ExpectTruthWithinUncertainty();
    EXPECT_EQ(Result()["cameras"]["cam"]["residuals"]["rejected"].as<int>(), 0) << lens;
  }
}

TEST_F(SimulatedLens, ScaramuzzaNeedsNoStartValue) {
  Simulate("scaramuzza",
           "f_x: 210, f_y: 212, c_x: 322, c_y: 243, b_2: -0.33, b_3: 0.01, b_4: -0.025",
           25);
  const Outcome outcome = Run({"calibrate", "set/session.yaml", "-o", "out", "--no-report"});
  ASSERT_EQ(outcome.status, kDone) << outcome.err;
  ExpectTruthWithinUncertainty();
}

TEST_F(SimulatedLens, SphericalNeedsNoStartValue) {
  Simulate("spherical", "f_x: 200, f_y: 202, c_x: 319.5, c_y: 244", 20);
  const Outcome outcome = Run({"calibrate", "set/session.yaml", "-o", "out", "--no-report"});
  ASSERT_EQ(outcome.status, kDone) << outcome.err;
  EXPECT_EQ(Result()["cameras"]["cam"]["sigma"]["c_x"].as<double>(), 0);
  EXPECT_EQ(Result()["cameras"]["cam"]["parameters"]["c_x"].as<double>(), 319.5);
  ExpectTruthWithinUncertainty();
}

TEST_F(SimulatedLens, BeyondAModelsRaysIsNamedAsSuch) {
  // 200 degrees over the image's width.
  Simulate("kannala-brandt4", "f_x: 183, f_y: 183, c_x: 320, c_y: 240", 30);
  Write("set/session.yaml",
        Replaced(Read("set/session.yaml"), "model: kannala-brandt4", "model: pinhole-radtan"));
  const Outcome outcome = Run({"calibrate", "set/session.yaml", "-o", "out"});
  EXPECT_EQ(outcome.status, kJobFailed);
  EXPECT_THAT(outcome.err,
              ::testing::AllOf(::testing::HasSubstr("90 degrees and more off the optical axis"),
                               ::testing::HasSubstr("'plenocal try' compares models")));
}

TEST_F(SimulatedLens, RealCornersAreExplainedAsByMrcalsSpline) {
  const fs::path set = OptionalData("frames/corners_mrcal_figueroa");
  if (!fs::exists(set)) GTEST_SKIP() << Absent(set);
  const Outcome imported = Run(
      {"import", (set / "corners.vnl").string(), "--format", "mrcal-corners", "-o", "corners.csv"});
  ASSERT_EQ(imported.status, kDone) << imported.err;
  std::string some;  // every eighth frame
  for (const std::string& line : Lines(Read("corners.csv"))) {
    if (line.starts_with("frame,") || std::stoi(line.substr(5)) % 8 == 0) some += line + "\n";
  }
  Write("corners.csv", some);
  Write("target.yaml",
        "plenocal: 1\ntype: chessboard\ncolumns: 10\nrows: 10\nsquare: 0.077\ntolerance: 0.002\n");
  Write("session.yaml",
        "plenocal: 1\ntarget: target.yaml\ncameras:\n  cam: {model: splined, detections: "
        "corners.csv, image_size: [6016, 4016]}\n");
  Calibrate();
  const YAML::Node fit = Result()["cameras"]["cam"]["residuals"];
  // SOURCE.md: mrcal's spline of 30 x 20 knots over all frames.
  EXPECT_LT(fit["rms"].as<double>(), 0.6088);
}

}  // namespace TEST_FILE
}  // namespace plenocal::testing
