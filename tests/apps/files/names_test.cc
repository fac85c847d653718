// SPDX-License-Identifier: Apache-2.0
//
// Names of cameras and frames in the files that the program writes and reads again.
#include <fmt/format.h>

#include "tests/apps/workspace.h"

namespace plenocal::testing {
namespace TEST_FILE {

using ::testing::HasSubstr;
using ::testing::Not;
namespace fs = std::filesystem;

class Names : public Workspace {
 protected:
  Names() { WriteProblem(EasyProblem()); }
  void NameCamera(const std::string& quoted) const {
    Write("session.yaml",
          Replaced(Replaced(SessionText(EasyProblem()), "  cam0:", fmt::format("  {}:", quoted)),
                   "pinhole-radial3",
                   "pinhole-radtan4"));
  }
};

TEST_F(Names, OfCamerasComeBackFromTheResult) {
  for (const std::string name :
       {"{a}", "[left]", "&a", "@a", "null", "true", "1", "#a", "=", "é"}) {
    NameCamera("\"" + name + "\"");
    Calibrate();
    const YAML::Node result = Result();
    EXPECT_EQ(result["cameras"].begin()->first.as<std::string>(), name);
    EXPECT_EQ(Run({"report", "out"}).status, kDone) << name;
    for (const char* format : {"ros", "kalibr"}) {
      const Outcome outcome =
          Run({"export", "out/calibration.yaml", "--format", format, "-o", "x.yaml"});
      EXPECT_EQ(outcome.status, kDone) << outcome.err;
      const YAML::Node file = YAML::Load(Read("x.yaml"));
      EXPECT_EQ(format == std::string("ros") ? file["camera_name"].as<std::string>()
                                             : file["cam0"]["rostopic"].as<std::string>(),
                format == std::string("ros") ? name : "/" + name + "/image_raw");
    }
    fs::remove_all(Path("out"));
  }
}

TEST_F(Names, OfCamerasThatNoFileCanHaveAreRefused) {
  for (const std::string quoted : {"\"\\\"\"", "a/b", "..", "\"a\\nb\"", "\"a\\eb\"", "\"a b\""}) {
    NameCamera(quoted);
    ExpectFailure(kWrongInput, {"session.yaml:", "this name"});
    EXPECT_THAT(Run({"calibrate", "session.yaml", "-o", "out"}).err, Not(HasSubstr("\x1b")));
  }
}

TEST_F(Names, OfFramesComeBackFromTheResult) {
  const SyntheticProblem problem = EasyProblem();
  for (const std::string name : {"a,b", "say \"hi\"", "#1", " x ", "{a}", "é"}) {
    std::string cell = "\"";
    for (const char c : name) cell += c == '"' ? "\"\"" : std::string(1, c);
    std::string text = DetectionsText(problem.input.cameras[0]);
    const std::string frame = problem.input.cameras[0].views[0].frame;
    for (const std::string old = "\n" + frame + ","; text.find(old) != std::string::npos;) {
      text = Replaced(text, old, "\n" + cell + "\",");
    }
    Write("cam0.csv", text);
    Calibrate();
    EXPECT_THAT(Read("out/poses.csv"), HasSubstr(name == "{a}" || name == "é" ? name : cell));
    const Outcome report = Run({"report", "out"});
    EXPECT_EQ(report.status, kDone) << report.err;
    fs::remove_all(Path("out"));
  }
}

// An image for which the '*' of a pattern stands for nothing; here it cannot be read.
TEST_F(Names, OfFramesAreNeverEmpty) {
  fs::create_directory(Path("images"));
  Write("images/left.png", "");
  Write("session.yaml",
        "plenocal: 1\ntarget: target.yaml\ncameras:\n  cam:\n    model: pinhole-radial3\n"
        "    images: images/left*.png\n");
  const Outcome outcome = Run({"calibrate", "session.yaml", "-o", "out"});
  EXPECT_EQ(outcome.status, kJobFailed) << outcome.err;
  EXPECT_THAT(outcome.err, HasSubstr("is empty (0 bytes)"));
}

TEST_F(Names, OfFramesThatCannotBeWrittenAreRefused) {
  fs::create_directory(Path("images"));
  Write("session.yaml",
        "plenocal: 1\ntarget: target.yaml\ncameras:\n  cam:\n    model: pinhole-radial3\n"
        "    images: images\n");
  for (const std::string name : {"a\nb", "a\x1b[2J", "\xff"}) {
    Write("images/" + name + ".png", "");
    const Outcome outcome = Run({"calibrate", "session.yaml", "-o", "out"});
    EXPECT_EQ(outcome.status, kWrongInput);
    EXPECT_THAT(outcome.err, HasSubstr("rename the file"));
    EXPECT_EQ(Lines(outcome.err).size(), 1U) << outcome.err;
    EXPECT_THAT(outcome.err, Not(HasSubstr("\x1b")));
    EXPECT_THAT(outcome.err, Not(HasSubstr("\xff")));
    fs::remove(Path("images/" + name + ".png"));
  }
}

// Latin-1, as old archives have them.
TEST_F(Names, OfFoldersThatNoSessionCanHoldAreRefused) {
  for (const std::string name : {"b\xfc"
                                 "cher",
                                 "b\u00fc"
                                 "cher",
                                 "a \\ufffd \"b\"",
                                 "\u200cx"}) {
    fs::create_directory(Path(name));
    for (const char* image : {"/1.png", "/2.png"}) Write(name + image, "");
    const Outcome outcome = Run({"init", name, "-o", "proposed.yaml"});
    const bool is_utf8 = name[1] != '\xfc';
    EXPECT_EQ(outcome.err.find("is not UTF-8, as a session is; rename it") == std::string::npos,
              is_utf8)
        << outcome.err;
    const bool is_named = outcome.err.find(
                              "b\\xfc"
                              "cher") != std::string::npos;
    EXPECT_NE(is_named, is_utf8) << outcome.err;
  }
}

}  // namespace TEST_FILE
}  // namespace plenocal::testing
