// SPDX-License-Identifier: Apache-2.0
//
// Camera models from outside: `plenocal --plugin`, `plenocal models check`.
#include <fmt/format.h>

#include <cmath>
#include <filesystem>

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

}  // namespace TEST_FILE
}  // namespace plenocal::testing
