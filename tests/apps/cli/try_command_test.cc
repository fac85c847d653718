// SPDX-License-Identifier: Apache-2.0
//
// `plenocal try`.
#include <fmt/format.h>

#include <algorithm>
#include <nlohmann/json.hpp>

#include "tests/apps/workspace.h"

namespace plenocal::testing {
namespace TEST_FILE {

using ::testing::AllOf;

using ::testing::HasSubstr;

class TryCommand : public Workspace {
 protected:
  // The row of a model in out/try.csv.
  [[nodiscard]] std::map<std::string, std::string> Row(const std::string& model) const {
    const Table table(Read("out/try.csv"));
    const std::vector<std::string> models = table.Column("model");
    const auto row = std::find(models.begin(), models.end(), model) - models.begin();
    std::map<std::string, std::string> cells;
    for (const char* column : {"parameters",
                               "held_out_rms",
                               "held_out_sigma",
                               "probability",
                               "difference",
                               "judgement",
                               "in_sample_rms",
                               "image_sigma",
                               "unseen",
                               "recommended"}) {
      cells[column] = table.Column(column).at(static_cast<size_t>(row));
    }
    return cells;
  }
  [[nodiscard]] double Number(const std::string& model, const std::string& column) const {
    return std::stod(Row(model).at(column));
  }
};

TEST_F(TryCommand, ChoosesTheKnotsOfASpline) {
  WriteProblem(MakeProblem(5, {.cameras = 1, .frames = 4, .noise = 0.1}));
  const Outcome outcome =
      Run({"try", "session.yaml", "--models", "splined-all", "--folds", "2", "-o", "out"});
  ASSERT_EQ(outcome.status, kDone) << outcome.err;
  const YAML::Node result = YAML::Load(Read("out/try.yaml"));
  std::vector<std::string> names;
  for (const auto& model : result["models"]) names.push_back(model.first.as<std::string>());
  EXPECT_THAT(names, ::testing::UnorderedElementsAre("splined-7x6", "splined-9x8", "splined"));
  EXPECT_EQ(result["recommended"].as<std::string>(), "splined-7x6");
  EXPECT_THAT(Run({"try", "session.yaml", "--models", "splined-7x6,splined-all", "-o", "out"}).err,
              HasSubstr("splined-7x6: named twice"));
}

TEST_F(TryCommand, RecommendsTheTrueModelAndNeitherATooSimpleNorATooRichOne) {
  constexpr double kNoise = 0.1;
  WriteProblem(MakeProblem(5, {.cameras = 1, .frames = 20, .noise = kNoise}));
  const Outcome outcome = Run({"try",
                               "session.yaml",
                               "--models",
                               "pinhole-radtan12,pinhole,pinhole-radial3,kannala-brandt4",
                               "-o",
                               "out"});
  ASSERT_EQ(outcome.status, kDone) << outcome.err;
  EXPECT_THAT(outcome.out, HasSubstr("\nrecommended: pinhole-radial3, "));
  const YAML::Node result = YAML::Load(Read("out/try.yaml"));
  EXPECT_EQ(result["recommended"].as<std::string>(), "pinhole-radial3");
  EXPECT_EQ(result["folds"].as<int>(), 5);
  EXPECT_EQ(result["models"].size(), 4u);

  // Noise alone is left: of a length sqrt(2) times that of a coordinate, less what the poses took.
  const double rms = Number("pinhole-radial3", "held_out_rms");
  EXPECT_NEAR(rms, std::sqrt(2) * kNoise, 3 * Number("pinhole-radial3", "held_out_sigma") + 0.005);
  EXPECT_LT(Number("pinhole-radial3", "held_out_sigma"), 0.05 * rms);
  // More parameters follow noise: better in the sample and not outside.
  EXPECT_LT(Number("pinhole-radtan12", "in_sample_rms"),
            Number("pinhole-radial3", "in_sample_rms"));
  EXPECT_GT(Number("pinhole-radtan12", "held_out_rms"), 0.999 * rms);
  EXPECT_GT(Number("pinhole-radtan12", "image_sigma"), Number("pinhole-radial3", "image_sigma"));
  EXPECT_GT(Number("pinhole", "held_out_rms"), 3 * rms);
  EXPECT_LT(Number("pinhole", "probability"), 0.01);
  EXPECT_EQ(Row("pinhole-radial3").at("parameters"), "7");

  // What matters stands beside each model, in pixels.
  EXPECT_EQ(Row("pinhole-radial3").at("judgement"), "\"recommended\"");
  EXPECT_EQ(Row("pinhole").at("judgement"), "\"worse than the best\"");
  EXPECT_GT(Number("pinhole", "difference"), 3 * kNoise);
  EXPECT_LT(Number("pinhole-radtan12", "difference"), Number("pinhole", "difference"));
  EXPECT_EQ(result["target"]["recommended"].as<std::string>(), "held");
  EXPECT_THAT(outcome.out, HasSubstr("\ntarget: held, "));

  // The calibrations are files like others.
  const Outcome compare = Run({"compare",
                               "out/models/pinhole-radial3/calibration.yaml",
                               "out/models/pinhole-radtan12/calibration.yaml"});
  EXPECT_EQ(compare.status, kDone) << compare.err;
  const std::string page = Read("out/try.html");
  EXPECT_THAT(page, AllOf(HasSubstr("Camera models compared"), HasSubstr("pinhole-radtan12")));
  const std::string open = R"(id="report-data">)";
  const size_t begin = page.find(open) + open.size();
  const auto data =
      nlohmann::json::parse(page.substr(begin, page.find("</script>", begin) - begin));
  EXPECT_EQ(data["cameras"][0]["fields"].size(), 4u);
  int points = 0;
  for (const auto& cell : data["cameras"][0]["fields"][0]["field"]["points"])
    points += cell.get<int>();
  EXPECT_EQ(points, data["points"].get<int>());
  for (const auto& model : data["models"]) {
    const YAML::Node row = result["models"][model["model"].get<std::string>()];
    if (!model.contains("projection")) continue;
    const auto projection = row["projection"].as<double>();
    EXPECT_NEAR(model["projection"].get<double>(), projection, 1e-3 * projection);
    EXPECT_NE(projection, row["image_sigma"].as<double>()) << "a quantile, not the RMS";
  }
}

TEST_F(TryCommand, AModelThatFailsIsARowWithItsReason) {
  // A lens of 200 degrees.
  Write("target.yaml", "plenocal: 1\ntype: chessboard\ncolumns: 14\nrows: 10\nsquare: 0.03\n");
  Write("spec.yaml",
        "plenocal: 1\nseed: 3\ntarget: target.yaml\ncameras:\n  cam: {model: kannala-brandt4, "
        "image_size: [640, 480], parameters: {f_x: 183, f_y: 183, c_x: 320, c_y: 240}, "
        "detection_sigma: 0.05}\nposes: {frames: 30, distance: [0.18, 0.45], partial: 0.3}\n");
  ASSERT_EQ(Run({"simulate", "spec.yaml", "--points", "-o", "set"}).status, kDone);
  const Outcome outcome =
      Run({"try", "set/session.yaml", "--models", "pinhole-radtan4,kannala-brandt4", "-o", "out"});
  ASSERT_EQ(outcome.status, kDone) << outcome.err;
  EXPECT_THAT(outcome.out, HasSubstr("90 degrees and more off the optical axis"));
  EXPECT_THAT(outcome.out, HasSubstr("recommended: kannala-brandt4"));
  EXPECT_THAT(Read("out/try.yaml"), HasSubstr("failure: \""));
  // Alone it leaves nothing to recommend.
  const Outcome none =
      Run({"try", "set/session.yaml", "--models", "pinhole-radtan4", "-o", "none"});
  EXPECT_EQ(none.status, kJobFailed);
  EXPECT_THAT(none.err, HasSubstr("90 degrees and more off the optical axis"));
  EXPECT_TRUE(Results("none").empty());
}

TEST_F(TryCommand, NamesWhatTheModelLacks) {
  WriteProblem(MakeProblem(5, {.cameras = 1, .frames = 20, .noise = 0.1}));
  const Outcome outcome = Run({"try", "session.yaml", "--models", "pinhole", "-o", "out"});
  ASSERT_EQ(outcome.status, kDone) << outcome.err;
  const std::string what = "cam0: the residuals contain radial terms (";
  EXPECT_THAT(outcome.out, HasSubstr(what));
  EXPECT_THAT(Read("out/try.html"), HasSubstr(what));
  const YAML::Node missing = YAML::Load(Read("out/try.yaml"))["missing"][0];
  EXPECT_EQ(missing["family"].as<std::string>(), "radial");
  EXPECT_EQ(missing["remedy"].as<std::string>(), "try pinhole+radial4");
  EXPECT_LT(missing["probability"].as<double>(), 1e-6);
}

TEST_F(TryCommand, StressTestsOfTheRecommendedModel) {
  SyntheticProblem problem = MakeProblem(1, {.cameras = 1, .frames = 20, .noise = 0.1});
  std::vector<View>& views = problem.input.cameras[0].views;
  for (size_t v = 10; v < views.size(); ++v) {
    for (Observation& seen : views[v].observations) seen.values[0] += 8;
  }
  WriteProblem(problem);
  const Outcome outcome =
      Run({"try", "session.yaml", "--models", "pinhole-radial3", "--stress", "-o", "out"});
  ASSERT_EQ(outcome.status, kDone) << outcome.err;
  EXPECT_THAT(outcome.out, HasSubstr("\n* first/second"));
  const std::string reading = "only the first and second half of the frames differ";
  EXPECT_THAT(outcome.out, HasSubstr(reading));
  EXPECT_THAT(Read("out/try.html"), AllOf(HasSubstr(reading), HasSubstr("cam0, upper left")));
  const YAML::Node stress = YAML::Load(Read("out/try.yaml"))["stress"];
  ASSERT_EQ(stress.size(), 8u);
  EXPECT_EQ(stress[1]["test"].as<std::string>(), "time");
  EXPECT_LT(stress[1]["probability"].as<double>(), 0.05);
  EXPECT_GT(stress[1]["factor"].as<double>(), 1.05);
}

// A small part of bench/try_simulated.
class TryOnSimulatedLens
    : public TryCommand,
      public ::testing::WithParamInterface<std::pair<const char*, const char*>> {};

TEST_P(TryOnSimulatedLens, FindsTheModelBehindIt) {
  const auto& [model, parameters] = GetParam();
  Write("target.yaml", "plenocal: 1\ntype: chessboard\ncolumns: 14\nrows: 10\nsquare: 0.03\n");
  Write("spec.yaml",
        fmt::format("plenocal: 1\nseed: 1\ntarget: target.yaml\ncameras:\n  cam: {{model: {}, "
                    "image_size: [640, 480], parameters: {{{}}}, detection_sigma: 0.05}}\nposes: "
                    "{{frames: 20, distance: [0.18, 0.45], partial: 0.3}}\n",
                    model,
                    parameters));
  ASSERT_EQ(Run({"simulate", "spec.yaml", "--points", "-o", "set"}).status, kDone);
  // kannala-brandt4 would be practically equal to the fisheyes, and is of wider use.
  const std::string models = "pinhole,pinhole-radtan,fov,ucm,eucm,double-sphere,division";
  const Outcome outcome = Run({"try", "set/session.yaml", "--models", models, "-o", "out"});
  ASSERT_EQ(outcome.status, kDone) << outcome.err;
  EXPECT_THAT(outcome.out, HasSubstr(fmt::format("\nrecommended: {}, ", model)));
}

INSTANTIATE_TEST_SUITE_P(
    Lenses,
    TryOnSimulatedLens,
    ::testing::Values(std::pair("pinhole-radtan",
                                "f_x: 430, f_y: 432, c_x: 316, c_y: 244, k_1: -0.21, k_2: 0.09, "
                                "p_1: 0.0012, p_2: -0.0016, k_3: -0.02"),
                      std::pair("fov", "f_x: 270, f_y: 271, c_x: 325, c_y: 236, omega: 0.93"),
                      std::pair("double-sphere",
                                "f_x: 205, f_y: 206, c_x: 316, c_y: 244, xi: -0.21, alpha: 0.58")),
    [](const auto& test) {
      std::string name(test.param.first);
      std::erase(name, '-');
      return name;
    });

TEST_F(TryCommand, VariesOneCameraOfARigOrAll) {
  SyntheticProblem problem = MakeProblem(7, {.cameras = 2, .frames = 10, .noise = 0.1});
  WriteProblem(problem);
  const std::string name = problem.input.cameras[1].name;
  const std::string other = problem.input.cameras[0].name;
  const Outcome one = Run({"try",
                           "session.yaml",
                           "--camera",
                           name,
                           "--models",
                           "pinhole,pinhole-radial3",
                           "-o",
                           "out"});
  ASSERT_EQ(one.status, kDone) << one.err;
  const YAML::Node varied = YAML::Load(Read("out/models/pinhole/calibration.yaml"))["cameras"];
  EXPECT_EQ(varied[name]["model"].as<std::string>(), "pinhole");
  EXPECT_EQ(varied[other]["model"].as<std::string>(), "pinhole-radial3");
  EXPECT_EQ(Row("pinhole-radial3").at("parameters"), "7");

  const Outcome all =
      Run({"try", "session.yaml", "--models", "pinhole,pinhole-radial3", "-o", "out"});
  ASSERT_EQ(all.status, kDone) << all.err;
  EXPECT_EQ(Row("pinhole-radial3").at("parameters"), "14");
  EXPECT_THAT(all.out, HasSubstr("recommended: pinhole-radial3"));
}

TEST_F(TryCommand, OutliersCountForNoModel) {
  SyntheticProblem problem = MakeProblem(5, {.cameras = 1, .frames = 10, .noise = 0.1});
  for (size_t v = 0; v < 10; v += 3) {
    problem.input.cameras[0].views[v].observations[17].values[0] += 20;
  }
  WriteProblem(problem);
  ASSERT_EQ(Run({"try", "session.yaml", "--models", "pinhole,pinhole-radial3", "-o", "out"}).status,
            kDone);
  EXPECT_EQ(YAML::Load(Read("out/try.yaml"))["outliers"].as<int>(), 4);
  EXPECT_LT(Number("pinhole-radial3", "held_out_rms"), 0.2);
}

TEST_F(TryCommand, NamesSettingsThatHoldForOneModelAlone) {
  WriteProblem(MakeProblem(5, {.cameras = 1, .frames = 8, .noise = 0.1}));
  const std::vector<std::string> arguments{
      "try", "session.yaml", "--models", "pinhole,pinhole-radial3", "--folds", "2", "-o", "out"};
  constexpr const char* kMessage =
      "cam0: what the session states about parameters holds for pinhole-radial3 alone";
  EXPECT_THAT(Run(arguments).err, ::testing::Not(HasSubstr(kMessage)));
  const std::string session = Read("session.yaml"), model = "model: pinhole-radial3\n";
  const size_t at = session.find(model);
  ASSERT_NE(at, std::string::npos);
  Write("session.yaml",
        session.substr(0, at + model.size()) + "    initial: {f_x: 1000}\n" +
            session.substr(at + model.size()));
  const Outcome outcome = Run(arguments);
  EXPECT_EQ(outcome.status, kDone) << outcome.err;
  EXPECT_THAT(outcome.err, HasSubstr(kMessage));
}

TEST_F(TryCommand, RefusesWhatItCannotTry) {
  WriteProblem(MakeProblem(5, {.cameras = 1, .frames = 3, .noise = 0.1}));
  const auto fails = [&](std::vector<std::string> more, int status, const std::string& part) {
    more.insert(more.begin(), {"try", "session.yaml", "-o", "out"});
    const Outcome outcome = Run(more);
    EXPECT_EQ(outcome.status, status) << outcome.err;
    EXPECT_THAT(outcome.err, HasSubstr(part));
    EXPECT_TRUE(Results("out").empty());
  };
  fails({"--models", "pinhol"}, kWrongInput, "did you mean 'pinhole'?");
  fails({"--models", "pinhole,pinhole"}, kWrongInput, "named twice");
  fails({"--models", "focused-plenoptic"}, kWrongInput, "do not measure the same");
  fails({"--camera", "nobody"}, kWrongInput, "no such camera");
  fails({"--camera", "cam1"}, kWrongInput, "did you mean 'cam0'?");
  fails({"--folds", "1"}, kWrongInput, "--folds");
  fails({"--models", "pinhole"}, kJobFailed, "3 frames: too few");
}

}  // namespace TEST_FILE
}  // namespace plenocal::testing
