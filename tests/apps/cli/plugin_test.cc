// SPDX-License-Identifier: Apache-2.0
//
// Camera models from outside: `plenocal --plugin`, `--model-file`, `plenocal models check`.
#include <fmt/format.h>

#include <cmath>
#include <filesystem>
#include <map>
#include <string>
#include <vector>

#include "tests/apps/workspace.h"

namespace plenocal::testing {
namespace TEST_FILE {

using ::testing::AllOf;
using ::testing::HasSubstr;
using ::testing::Not;
namespace fs = std::filesystem;

class Plugin : public Workspace {
 protected:
  // The program with one of the plug-ins that the build made (tests/plugins).
  [[nodiscard]] Outcome RunWith(const std::string& plugin,
                                const std::vector<std::string>& arguments) const {
    std::vector<std::string> all{"--plugin", Library(plugin)};
    all.insert(all.end(), arguments.begin(), arguments.end());
    return Run(all);
  }
  [[nodiscard]] static std::string Library(const std::string& plugin) {
    return (fs::path(PLENOCAL_PLUGINS) / ("lib" + plugin + ".so")).string();
  }
  void ExpectRefused(const std::string& file, const std::string& why) const {
    const Outcome outcome = Run({"--plugin", file, "models"});
    EXPECT_EQ(outcome.status, kWrongInput);
    EXPECT_EQ(outcome.out, "");
    EXPECT_EQ(Lines(outcome.err).size(), 1u) << outcome.err;
    EXPECT_THAT(outcome.err, AllOf(HasSubstr(file), HasSubstr(why)));
  }
};

TEST_F(Plugin, IsKnownToEveryCommand) {
  fs::copy(PLENOCAL_EXAMPLES, Path("examples"), fs::copy_options::recursive);
  const auto done = [&](const std::vector<std::string>& arguments) {
    Outcome outcome = RunWith("stereographic", arguments);
    EXPECT_EQ(outcome.status, kDone) << outcome.err;
    return outcome.out;
  };
  EXPECT_THAT(done({"models"}), AllOf(HasSubstr("\nstereographic\n"), HasSubstr("\nucm\n")));
  done({"simulate", "examples/new_model/fisheye.yaml", "--points", "-o", "set"});
  EXPECT_THAT(done({"calibrate", "set/session.yaml", "-o", "out"}),
              HasSubstr("fisheye  (stereographic, 640 x 480 px)"));
  const YAML::Node found = Result()["cameras"]["fisheye"];
  const YAML::Node truth = YAML::Load(Read("set/truth/calibration.yaml"))["cameras"]["fisheye"];
  for (const auto& parameter : truth["parameters"]) {
    const auto name = parameter.first.as<std::string>();
    const double error = found["parameters"][name].as<double>() - parameter.second.as<double>();
    EXPECT_LT(std::abs(error), 4 * found["sigma"][name].as<double>()) << name;
  }
  EXPECT_EQ(Result()["provenance"]["command"].as<std::string>(),
            "plenocal --plugin " + Library("stereographic") + " calibrate set/session.yaml -o out");
  done({"report", "out"});
  EXPECT_THAT(done({"compare", "out/calibration.yaml", "set/truth/calibration.yaml"}),
              HasSubstr("\nsame within uncertainty\n"));
  done({"convert", "out/calibration.yaml", "--to", "kannala-brandt4", "-o", "converted"});
  done({"export", "converted/calibration.yaml", "--format", "opencv", "-o", "opencv.yaml"});
  done({"convert", "converted/calibration.yaml", "--to", "stereographic", "-o", "back"});
  EXPECT_THAT(done({"try", "set/session.yaml", "--models", "stereographic,pinhole", "-o", "tried"}),
              HasSubstr("\nrecommended: stereographic, "));

  // The session may name it; given twice it is loaded once.
  Write("set/with.yaml",
        Read("set/session.yaml") + fmt::format("plugins: [{}]\n", Library("stereographic")));
  const Outcome named = Run({"calibrate", "set/with.yaml", "-o", "named", "--no-report"});
  EXPECT_EQ(named.status, kDone) << named.err;
  done({"calibrate", "set/with.yaml", "-o", "named", "--no-report"});

  const Outcome without = Run({"calibrate", "set/session.yaml", "-o", "without"});
  EXPECT_EQ(without.status, kWrongInput);
  EXPECT_THAT(without.err, AllOf(HasSubstr("'stereographic'"), HasSubstr("--plugin")));
}

TEST_F(Plugin, MadeOfTheHeadersOfFormulasProjectsAsTheFormulas) {
  const std::string formulas = fs::path(PLENOCAL_PLUGIN_SOURCES) / "formulas.model.yaml";
  fs::copy(PLENOCAL_EXAMPLES, Path("examples"), fs::copy_options::recursive);
  const std::map<std::string, std::string> parameters{
      {"formula-radius", "{f_x: 210, f_y: 212, c_x: 322, c_y: 243, k_1: -0.02, k_2: 0.003}"},
      {"formula-map", "{f_x: 300, f_y: 302, c_x: 322, c_y: 243, xi: 0.6}"}};
  for (const auto& [model, values] : parameters) {
    const Outcome checked = RunWith("formula_headers", {"models", "check", model});
    EXPECT_EQ(checked.status, kDone) << checked.out;
    Write("set.yaml",
          fmt::format("plenocal: 1\nseed: 3\ntarget: examples/simulate/target.yaml\n"
                      "poses: {{kind: varied, frames: 5, distance: [0.15, 0.4]}}\ncameras:\n"
                      "  cam: {{model: {}, image_size: [640, 480], parameters: {}}}\n",
                      model,
                      values));
    const auto points = [&, &model = model](const std::string& option, const std::string& file) {
      const Outcome done =
          Run({option, file, "simulate", "set.yaml", "--points", "-o", model + option});
      EXPECT_EQ(done.status, kDone) << done.err;
      return Lines(Read(model + option + "/detections_cam.csv"));
    };
    const std::vector<std::string> of_header = points("--plugin", Library("formula_headers")),
                                   of_formula = points("--model-file", formulas);
    EXPECT_GT(of_header.size(), 100U);
    EXPECT_EQ(of_header, of_formula) << model;
  }
}

TEST_F(Plugin, HeadersAreWrittenOfLensesWithAnInverseAlone) {
  Write("lenses.yaml", R"(models:
  bent: {source: a, params: {k: {}}, ray: [x, y, 1 + k*(x^2 + y^2)]}
  short: {source: a, params: {k: {}}, radius: theta*(1 + k*theta^2), domain: theta < 1.5}
  open:
    source: a
    params: {k: {scale: 0.4}}
    let: {g: 1 + k*(X^2 + Y^2)/Z^2}
    map: [X/Z*g, Y/Z*g]
    domain: Z > 0
    example: [500, 500, 320, 240, -0.1]
)");
  const std::map<std::string, std::string> refused{{"bent", "radius or map"},
                                                   {"short", "remove the domain"},
                                                   {"open", "'domain' and 'unmap'"},
                                                   {"pinhole", "made of no formula"},
                                                   {"nothing", "nothing"}};
  for (const auto& [model, why] : refused) {
    const Outcome outcome = Run({"--model-file", "lenses.yaml", "models", "--header", model});
    EXPECT_EQ(outcome.status, kWrongInput) << model;
    EXPECT_EQ(outcome.out, "") << model;
    EXPECT_THAT(outcome.err, HasSubstr(why)) << model;
  }
}

TEST_F(Plugin, MayStandBesideOthers) {
  const Outcome outcome =
      Run({"--plugin", Library("stereographic"), "--plugin", Library("wrong_models"), "models"});
  EXPECT_EQ(outcome.status, kDone) << outcome.err;
  EXPECT_THAT(outcome.out,
              AllOf(HasSubstr("\nstereographic\n"),
                    HasSubstr("\nwrong-inverse\n"),
                    HasSubstr("\nwrong-derivative\n")));
}

TEST_F(Plugin, MayBeNamedByTheEnvironment) {
  const std::string both = Library("stereographic") + "::" + Library("wrong_models");
  const Outcome outcome = Run({"models"}, {.environment = {{"PLENOCAL_PLUGINS", both}}});
  EXPECT_EQ(outcome.status, kDone) << outcome.err;
  EXPECT_THAT(outcome.out, AllOf(HasSubstr("\nstereographic\n"), HasSubstr("\nwrong-inverse\n")));
  // Named twice, by the user's profile and for this command, it is one plug-in.
  const Outcome again = Run({"--plugin", Library("stereographic"), "models"},
                            {.environment = {{"PLENOCAL_PLUGINS", both}}});
  EXPECT_EQ(again.status, kDone) << again.err;
  const Outcome missing = Run({"models"}, {.environment = {{"PLENOCAL_PLUGINS", "nowhere.so"}}});
  EXPECT_EQ(missing.status, kWrongInput);
  EXPECT_THAT(
      missing.err,
      AllOf(HasSubstr("PLENOCAL_PLUGINS"), HasSubstr("nowhere.so"), HasSubstr("no such file")));
}

TEST_F(Plugin, IsRefusedWithOneMessageWhereItCannotBeUsed) {
  ExpectRefused("nowhere.so", "no such file");
  fs::create_directory(Path("folder.so"));
  ExpectRefused("folder.so", "is no file");
  Write("text.so",
        "A text that is longer than the header of a shared library, which has 64 bytes.");
  ExpectRefused("text.so", "is no shared library");
  Write("empty.so", "");
  ExpectRefused("empty.so", "is no shared library");
  fs::copy(Library("stereographic"), Path("short.so"));
  fs::resize_file(Path("short.so"), fs::file_size(Path("short.so")) / 2);
  ExpectRefused("short.so", "is cut off");
  ExpectRefused(Library("no_plugin"), "is no plug-in");
  ExpectRefused(Library("another_version"),
                "was built against another version (plenocal 0.0.1, interface 01234567; this is "
                "plenocal ");

  // The same file again (PLENOCAL_PLUGINS, a session) changes nothing; a copy of it is another.
  EXPECT_EQ(
      Run({"--plugin", Library("stereographic"), "--plugin", Library("stereographic"), "models"})
          .status,
      kDone);
  fs::copy(Library("stereographic"), Path("copy.so"));
  const Outcome twice =
      Run({"--plugin", Library("stereographic"), "--plugin", "copy.so", "models"});
  EXPECT_EQ(twice.status, kWrongInput);
  EXPECT_THAT(twice.err, HasSubstr("there is a camera model 'stereographic' already"));
}

TEST_F(Plugin, IsSoughtWhereItWasNamedAndNotInTheSystemsFolders) {
  fs::copy(Library("stereographic"), Path("mine.so"));
  EXPECT_EQ(Run({"--plugin", "mine.so", "models"}).status, kDone);
  EXPECT_EQ(Run({"--plugin", "libm.so.6", "models"}).status, kWrongInput);
}

TEST_F(Plugin, LeavesUnknownCommandsToTheMessageThatHelps) {
  const Outcome outcome = RunWith("stereographic", {"calibrat", "session.yaml"});
  EXPECT_EQ(outcome.status, kWrongInput);
  EXPECT_THAT(outcome.err, HasSubstr("unknown command 'calibrat'; did you mean 'calibrate'?"));
}

TEST_F(Plugin, StandsBeforeTheCommand) {
  const Outcome outcome =
      Run({"calibrate", "--plugin", Library("stereographic"), "session.yaml", "-o", "out"});
  EXPECT_EQ(outcome.status, kWrongInput);
  EXPECT_THAT(outcome.err, HasSubstr("--plugin stands before the command"));
}

TEST_F(Plugin, ModelsCheckAcceptsARightModelAndSaysWhatIsWrongInOthers) {
  const Outcome right = RunWith("stereographic", {"models", "check", "stereographic"});
  EXPECT_EQ(right.status, kDone) << right.out << right.err;
  EXPECT_THAT(right.out, Not(HasSubstr("VIOLATED")));

  const Outcome inverse = RunWith("wrong_models", {"models", "check", "wrong-inverse"});
  EXPECT_EQ(inverse.status, kJobFailed);
  EXPECT_THAT(inverse.out, HasSubstr("VIOLATED   the whole example image is seen"));
  EXPECT_THAT(inverse.out, HasSubstr("pixel (0, 0), 0.3 m along its ray: y off by 486\n"));
  EXPECT_THAT(inverse.err, HasSubstr("camera model wrong-inverse violates"));

  const Outcome derivative = RunWith("wrong_models", {"models", "check", "wrong-derivative"});
  EXPECT_EQ(derivative.status, kJobFailed);
  EXPECT_THAT(derivative.out, HasSubstr("VIOLATED   derivatives agree with differences"));
  EXPECT_THAT(derivative.out, HasSubstr("derivative of x by z at "));

  const Outcome unknown = Run({"models", "check", "pinhol"});
  EXPECT_EQ(unknown.status, kWrongInput);
  EXPECT_THAT(unknown.err, HasSubstr("did you mean 'pinhole'?"));
  EXPECT_EQ(Run({"models", "check", "focused-plenoptic"}).status, kDone);
}

// --- formulas: `--model-file`, `models` of sessions and calibrations ---

constexpr const char* kFormula =
    "models:\n"
    "  page-fisheye:\n"
    "    source: A page\n"
    "    params: {k_1: {scale: 0.41}, k_2: {scale: 0.16}, k_3: {scale: 0.067}, k_4: {scale: 0.027}}\n"
    "    radius: theta*(1 + sum(i, 1, 4, k_i*theta^(2*i)))\n";

class FormulaModel : public Workspace {
 protected:
  void SetUp() override {
    Workspace::SetUp();
    Write("page.model.yaml", kFormula);
    Write("target.yaml", "plenocal: 1\ntype: chessboard\ncolumns: 8\nrows: 5\nsquare: 0.03\n");
    Write("spec.yaml",
          "plenocal: 1\nseed: 3\ntarget: target.yaml\n"
          "poses: {kind: varied, frames: 12, distance: [0.15, 0.4]}\n"
          "cameras: {cam: {model: page-fisheye, image_size: [640, 480], parameters: {f_x: 210, "
          "f_y: 212, c_x: 322, c_y: 243, k_1: -0.01, k_2: 0.003, k_3: -0.0002, k_4: 0.00001}}}\n");
  }
  std::string Done(const std::vector<std::string>& arguments) {
    Outcome outcome = Run(arguments);
    EXPECT_EQ(outcome.status, kDone) << outcome.err;
    return outcome.out;
  }
  std::string Refused(const std::vector<std::string>& arguments) {
    Outcome outcome = Run(arguments);
    EXPECT_EQ(outcome.status, kWrongInput);
    return outcome.err;
  }
};

TEST_F(FormulaModel, IsKnownToEveryCommandAndTravelsWithItsCalibration) {
  const std::string file = "page.model.yaml";
  EXPECT_THAT(Done({"--model-file", file, "models"}), HasSubstr("\npage-fisheye\n"));
  EXPECT_THAT(Done({"--model-file", file, "models", "check", "page-fisheye"}),
              Not(HasSubstr("VIOLATED")));
  Done({"--model-file", file, "simulate", "spec.yaml", "--points", "-o", "set"});
  EXPECT_THAT(Refused({"calibrate", "set/session.yaml", "-o", "out"}), HasSubstr("--model-file"));

  // Without the option from here on: the session names the file, the calibration has the text.
  Write("set/session.yaml", Read("set/session.yaml") + "models: [../page.model.yaml]\n");
  Done({"calibrate", "set/session.yaml", "-o", "out"});
  EXPECT_THAT(Done({"compare", "out/calibration.yaml", "set/truth/calibration.yaml"}),
              HasSubstr("\nsame within uncertainty\n"));
  Done({"report", "out"});
  Done({"convert", "out/calibration.yaml", "--to", "kannala-brandt4", "-o", "converted"});
  EXPECT_THAT(Read("converted/calibration.yaml"), Not(HasSubstr("models:")));
  EXPECT_THAT(Done({"try", "set/session.yaml", "--models", "page-fisheye,pinhole", "-o", "tried"}),
              HasSubstr("\nrecommended: page-fisheye, "));

  // The header of the same equations gives the same.
  const YAML::Node formula = Result()["cameras"]["cam"];
  std::string session = Read("set/session.yaml");
  session.replace(session.find("page-fisheye"), 12, "kannala-brandt4");
  Write("set/session.yaml", session);
  Done({"calibrate", "set/session.yaml", "-o", "out", "--no-report"});
  const YAML::Node header = Result()["cameras"]["cam"];
  for (const auto& parameter : header["parameters"]) {
    const auto name = parameter.first.as<std::string>();
    const double difference =
        formula["parameters"][name].as<double>() - parameter.second.as<double>();
    EXPECT_LT(std::abs(difference), 1e-4 * header["sigma"][name].as<double>()) << name;
  }
}

TEST_F(FormulaModel, OfAnotherTextAndTheSameNameIsRefused) {
  Done({"--model-file", "page.model.yaml", "simulate", "spec.yaml", "--points", "-o", "set"});
  Write("other.model.yaml", "models: {page-fisheye: {radius: 2*theta}}\n");
  EXPECT_THAT(Refused({"--model-file",
                       "other.model.yaml",
                       "convert",
                       "set/truth/calibration.yaml",
                       "--to",
                       "eucm",
                       "-o",
                       "out"}),
              AllOf(HasSubstr("other.model.yaml"),
                    HasSubstr("truth/calibration.yaml:"),
                    HasSubstr("another formula of this name")));
  EXPECT_THAT(Refused({"--model-file", "nowhere.model.yaml", "models"}), HasSubstr("nowhere"));
  EXPECT_THAT(Refused({"calibrate", "--model-file", "page.model.yaml", "s.yaml", "-o", "out"}),
              HasSubstr("--model-file stands before the command"));
}

TEST_F(FormulaModel, MayStandInTheSession) {
  Done({"--model-file", "page.model.yaml", "simulate", "spec.yaml", "--points", "-o", "set"});
  Write("set/session.yaml", Read("set/session.yaml") + kFormula);
  Done({"calibrate", "set/session.yaml", "-o", "out", "--no-report"});
  Write("set/session.yaml", Read("set/session.yaml") + "    unmap: [x, y, 1]\n");
  EXPECT_THAT(Refused({"calibrate", "set/session.yaml", "-o", "out"}),
              AllOf(HasSubstr("set/session.yaml:"), HasSubstr("page-fisheye.unmap")));
}

}  // namespace TEST_FILE
}  // namespace plenocal::testing
