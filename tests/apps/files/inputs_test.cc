// SPDX-License-Identifier: Apache-2.0
//
// Inputs that are no files, that are outputs too, and that would be too much.
#include <fmt/format.h>
#include <sys/stat.h>

#include "tests/apps/workspace.h"

namespace plenocal::testing {
namespace TEST_FILE {

using ::testing::AllOf;
using ::testing::HasSubstr;
namespace fs = std::filesystem;
using Arguments = std::vector<std::string>;

class Inputs : public Workspace {
 protected:
  Inputs() {
    const SyntheticProblem problem = EasyProblem(2);
    WriteProblem(problem);
    // A model that has a place in other tools' files.
    std::string session = Read("session.yaml");
    for (int camera = 0; camera < 2; ++camera) {
      session = Replaced(session, "pinhole-radial3", "pinhole-radtan4");
    }
    Write("session.yaml", session);
    const auto [width, height] = problem.input.cameras[0].image_size;
    for (const char* image : {"image.pgm", "right.pgm"}) {
      Write(image,
            fmt::format("P5 {} {} 255\n", width, height) +
                std::string(static_cast<size_t>(width) * static_cast<size_t>(height), 'x'));
    }
  }

  // Status and one line with all of `parts`; nothing else in the folder changes.
  void ExpectRefused(const Arguments& arguments, const std::vector<std::string>& parts) const {
    const auto before = Files("");
    const Outcome outcome = Run(arguments);
    EXPECT_EQ(outcome.status, kWrongInput) << outcome.err;
    EXPECT_EQ(Lines(outcome.err).size(), 1U) << outcome.err;
    for (const std::string& part : parts) EXPECT_THAT(outcome.err, HasSubstr(part));
    EXPECT_EQ(Files(""), before);
  }
};

TEST_F(Inputs, ThatAreNoRegularFilesAreRefusedAtOnce) {
  ASSERT_EQ(mkfifo(Path("pipe").c_str(), 0600), 0);
  const std::string session = Read("session.yaml");
  for (const std::string file : {"pipe", "/dev/zero", "/"}) {
    ExpectRefused({"import", file, "--format", "kalibr", "-o", "out"}, {file});
    ExpectRefused({"target", file, "-o", "target.pdf"}, {file});
    Write("other.yaml", Replaced(session, "target.yaml", file));
    ExpectRefused({"calibrate", "other.yaml", "-o", "out"}, {file + ": is a d"});
    Write("other.yaml", Replaced(session, "cam0.csv", file));
    ExpectRefused({"calibrate", "other.yaml", "-o", "out"}, {file + ": is a d"});
  }
  ExpectRefused({"calibrate", "pipe.yaml", "-o", "out"}, {"pipe.yaml: no such file"});
  fs::rename(Path("pipe"), Path("pipe.yaml"));
  ExpectRefused({"calibrate", "pipe.yaml", "-o", "out"}, {"pipe.yaml: is a device, pipe"});
  fs::rename(Path("pipe.yaml"), Path("pipe.png"));
  Write("images.yaml",
        "plenocal: 1\ntarget: target.yaml\ncameras:\n  cam:\n    model: pinhole-radial3\n"
        "    images: pipe.png\n");
  EXPECT_THAT(Run({"calibrate", "images.yaml", "-o", "out"}).err, HasSubstr("pipe.png"));
}

TEST_F(Inputs, AreReplacedByNoCommand) {
  Calibrate();
  EXPECT_EQ(
      Run({"export", "out/calibration.yaml", "--format", "kalibr", "-o", "chain.yaml"}).status,
      kDone);
  fs::copy(Path("target.yaml"), Path("target.pdf"));
  Write("poses.txt", "0 0 0 0 0 0 0 1\n1 1 0 0 0 0 0 1\n2 1 1 0 0 0 0 1\n3 1 1 2 0 0 0 1\n");
  fs::copy(Path("poses.txt"), Path("poses.png"));
  const std::string calibration = "out/calibration.yaml";
  for (const Arguments& arguments :
       {Arguments{"export", calibration, "--format", "kalibr", "-o", calibration},
        {"import", "chain.yaml", "--format", "kalibr", "-o", "chain.yaml"},
        {"target", "target.pdf", "-o", "target.pdf"},
        {"map", calibration, "--camera", "cam0", "-o", calibration},
        {"convert", calibration, "--camera", "cam0", "--to", "pinhole", "-o", "out"},
        {"undistort", calibration, "--camera", "cam0", "image.pgm", "-o", "out"},
        {"rectify", calibration, "image.pgm", "right.pgm", "-o", "out"},
        {"evaluate",
         "--estimate",
         "poses.png",
         "--truth",
         "poses.txt",
         "--chart",
         "poses.png",
         "--quiet"},
        {"calibrate", "session.yaml", "-o", "."}}) {
    SCOPED_TRACE(arguments[0]);
    ExpectRefused(arguments, {"the results would replace this input", "-o"});
  }
}

TEST_F(Inputs, NeverHaveOthersFilesWrittenOutsideOfTheOutput) {
  Calibrate();
  const std::string calibration = Read("out/calibration.yaml");
  for (const std::string name : {"../../evil", "/tmp/plenocal_evil", "a/b", ".."}) {
    Write("bad.yaml", Replaced(calibration, "  cam0:", "  " + name + ":"));
    ExpectRefused({"export", "bad.yaml", "--format", "mrcal", "-o", "out/x.cameramodel"},
                  {"bad.yaml:", name, "file names"});
    EXPECT_FALSE(fs::exists("/tmp/plenocal_evil"));
  }
}

TEST_F(Inputs, MayHaveTheirColumnsInAnyOrder) {
  Calibrate();
  EXPECT_EQ(Run({"report", "out"}).status, kDone);
  const std::string page = Read("out/report.html");
  const Table poses(Read("out/poses.csv"));
  const std::vector<std::string> columns{"frame", "qw", "y", "z", "qx", "qy", "qz", "x"};
  std::string text = "frame,qw,y,z,qx,qy,qz,x\n";
  for (size_t row = 0; row < poses.Rows(); ++row) {
    for (const std::string& column : columns) {
      text += (column == "frame" ? "" : ",") + poses.Column(column)[row];
    }
    text += '\n';
  }
  Write("out/poses.csv", text);
  EXPECT_EQ(Run({"report", "out"}).status, kDone);
  EXPECT_EQ(Read("out/report.html"), page);
}

TEST_F(Inputs, OfHugeTargetsAreNotPrinted) {
  for (const std::string square : {"30 m", "1000 m"}) {
    Write("board.yaml",
          "plenocal: 1\ntype: chessboard\ncolumns: 6\nrows: 5\nsquare: " + square + "\n");
    for (const std::string paper : {"a4", "fit"}) {
      const Outcome outcome = Run({"target", "board.yaml", "--paper", paper, "-o", "board.pdf"});
      if (outcome.status == kDone) continue;  // one sheet of any size
      EXPECT_EQ(outcome.status, kWrongInput) << outcome.err;
      EXPECT_EQ(Lines(outcome.err).size(), 1U) << outcome.err;
    }
    ExpectRefused({"target", "board.yaml", "--paper", "a4", "-o", "new.pdf"},
                  {"pages of paper a4"});
  }
}

TEST_F(Inputs, OnTheCommandLineAreNumbers) {
  Calibrate();
  for (const std::string number : {"nan", "inf", "-inf", "NaN"}) {
    // Those outside of a range are refused for that.
    ExpectRefused({"map", "out/calibration.yaml", "--camera", "cam0", "--fov", number, "-o", "new"},
                  {"--fov: ", number});
    ExpectRefused({"focus", "raw.png", "--grid", "x.csv", "--scale", number, "-o", "new"},
                  {"--scale: ", number});
  }
}

// A grid of RxLive whose <name> is `text`.
std::string Grid(const std::string& name, const std::string& text) {
  std::string xml = R"(<RayCalibData version="1.0">
<offset><x>13.1</x><y>-20.3</y></offset><diameter>23.2</diameter><rotation>1.5708</rotation>
<lens_base_x><x>0</x><y>1</y></lens_base_x><lens_base_y><x>0.866025</x><y>0.5</y></lens_base_y>
<distortion><function>constant</function></distortion>
<lens_type id="0"><offset><x>0</x><y>0</y></offset></lens_type>
</RayCalibData>
)";
  return name.empty() ? xml : Replaced(xml, name, text);
}

TEST_F(Inputs, OfGridsThatAreNoneAreRefused) {
  const auto import = [&] {
    return Arguments{"import", "grid.xml", "--format", "raytrix", "--size", "200x200", "-o", "new"};
  };
  for (const auto& [name, text] : std::vector<std::pair<std::string, std::string>>{
           {"<y>-20.3</y>", "<y>-1e308</y>"},
           {"<x>13.1</x>", "<x>1e9</x>"},
           {"<lens_base_x><x>0</x>", "<lens_base_x><x>-2147483648</x>"},
           {"<offset><x>0</x><y>0</y>", "<offset><x>1e300</x><y>0</y>"}}) {
    Write("grid.xml", Grid(name, text));
    ExpectRefused(import(), {"grid.xml"});
  }
  Write("grid.xml", Grid("", ""));
  EXPECT_EQ(Run(import()).status, kDone);
}

}  // namespace TEST_FILE
}  // namespace plenocal::testing
