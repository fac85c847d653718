// SPDX-License-Identifier: Apache-2.0
//
// The documents' examples, run as a reader would: the lines of all ```sh blocks of a document and
// those after a `$` in blocks without a language, which show the output as well, in order, in a
// folder that has the project's `examples` and `tests/data`.
#include <fmt/format.h>

#include <algorithm>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <optional>
#include <regex>
#include <set>
#include <string>
#include <vector>

#include "engine/recording/messages/bag_file.h"
#include "tests/apps/workspace.h"
#include "tests/engine/recording/message_bytes.h"
#include "tests/optional_data.h"

namespace plenocal::testing {
namespace TEST_FILE {

using ::testing::HasSubstr;
namespace fs = std::filesystem;

class Documentation : public Workspace {
 protected:
  void RunExamplesOf(const std::string& document) const {
    const fs::path path = fs::path(PLENOCAL_DOCS) / document;
    ASSERT_TRUE(fs::exists(path)) << path;
    fs::copy(path, Path("document.md"));
    std::string script = fmt::format("set -euo pipefail\nPATH={}:$PATH\n",
                                     fs::path(PLENOCAL_PROGRAM).parent_path().string());
    std::optional<std::string> language;  // of the block that is open
    bool any = false;
    for (const std::string& line : Lines(Read("document.md"))) {
      if (line.starts_with("```")) {
        language = language ? std::nullopt : std::optional(line.substr(3));
        any = any || language == "sh";
      } else if (language == "sh") {
        script += line + "\n";
      } else if (language == "" && line.starts_with("$ ")) {
        script += line.substr(2) + "\n";
      }
    }
    ASSERT_TRUE(any) << "no ```sh block in " << path;
    Write("script", script);
    fs::copy(PLENOCAL_EXAMPLES, Path("examples"), fs::copy_options::recursive);
    fs::create_directories(Path("tests"));
    fs::create_directory_symlink(PLENOCAL_TEST_DATA, Path("tests/data"));
    const std::string command = fmt::format("cd '{}' && bash script >log 2>&1", Path("").string());
    ASSERT_EQ(std::system(command.c_str()), 0) << Read("log");
  }

  /// The verdict in a report: its findings in words.
  [[nodiscard]] std::string Verdict(const std::string& folder) const {
    const std::string page = Read(folder + "/report.html");
    const size_t begin = page.find("\"headline\":");
    return begin == std::string::npos ? "" : page.substr(begin);
  }
};

TEST_F(Documentation, AFirstCalibrationIsGoodAndIsHandedOver) {
  RunExamplesOf("first_calibration.md");
  EXPECT_THAT(Verdict("first/result"), HasSubstr("This calibration is good."));
  EXPECT_TRUE(fs::exists(Path("camera.yml")));
  EXPECT_EQ(std::distance(fs::directory_iterator(Path("straight")), {}), 21);
}

TEST_F(Documentation, AFirstPlenopticRigGivesTheFiguresOfItsPage) {
  RunExamplesOf("first_plenoptic_rig.md");
  EXPECT_THAT(Read("log"), HasSubstr("2066 micro lenses, 2 unusable, 3 types: 694, 686, 686"));
  EXPECT_THAT(Read("log"), HasSubstr("400 x 400 pixels, virtual depth known in 97 %"));
  const YAML::Node camera = Result("result")["cameras"]["plenoptic"];
  EXPECT_NEAR(camera["parameters"]["f_L"].as<double>(), 0.01220131, 0.0000001);
  EXPECT_NEAR(camera["residuals"]["rms"].as<double>(), 0.0288, 0.0001);
  EXPECT_THAT(Verdict("result"), HasSubstr("This calibration is good."));
  EXPECT_TRUE(fs::exists(Path("points.ply")));
}

TEST_F(Documentation, ConventionsAreShownOnARig) {
  RunExamplesOf("conventions.md");
  const YAML::Node xi = Result("rig/result")["cameras"]["right"]["xi_camera_rig"];
  EXPECT_NEAR(xi[0].as<double>(), -0.1, 2e-3);
}

TEST_F(Documentation, BadSetsOfTheRecordingGuideGetTheVerdictsItNames) {
  RunExamplesOf("recordings.md");
  EXPECT_THAT(Verdict("results/varied"), HasSubstr("This calibration is good"));
  EXPECT_THAT(Verdict("results/one-distance"), HasSubstr("all images are from one distance"));
  EXPECT_THAT(Verdict("results/no-tilt"), HasSubstr("the target was not tilted"));
  EXPECT_THAT(Verdict("results/no-tilt"), HasSubstr("cam.f_x, cam.f_y: their standard error is"));
  EXPECT_THAT(Verdict("results/corner"),
              HasSubstr("points only in the upper left corner of the image"));
  for (const char* kind : {"varied", "one-distance", "no-tilt", "corner"}) {
    const YAML::Node camera = Result(fmt::format("results/{}", kind))["cameras"]["cam"];
    EXPECT_NEAR(camera["residuals"]["rms"].as<double>(), 0.132, 0.008) << kind;
  }
}

/// The 13 pairs of the chessboard as a bag of ROS 1, a second apart.
std::string StereoBag() {
  const fs::path images = fs::path(PLENOCAL_TEST_DATA) / "frames/stereo_chess_opencv";
  const std::vector<std::string> sides{"left", "right"};
  std::string bag(kBagMagic);
  for (int side = 0; side < 2; ++side) {
    bag += BagConnection(
        side, "/" + sides[side] + "/image_raw/compressed", "sensor_msgs/CompressedImage");
  }
  for (std::uint32_t number = 1; number <= 14; ++number) {
    for (int side = 0; side < 2; ++side) {
      std::ifstream file(images / fmt::format("{}{:02}.jpg", sides[side], number),
                         std::ios::binary);
      if (!file) continue;  // there is no tenth
      const std::string jpeg(std::istreambuf_iterator<char>(file), {});
      bag += BagMessage(side,
                        number,
                        0,
                        MessageWriter(MessageWriter::Form::kRos1)
                            .Header(number, 0)
                            .Text("jpeg")
                            .Bytes(jpeg)
                            .Done());
    }
  }
  return bag;
}

TEST_F(Documentation, ABagOfRosIsCalibratedAndGoesBackToItsTools) {
  Write("calibration.bag", StereoBag());
  RunExamplesOf("ros.md");
  const Eigen::Matrix4d T = Matrix(Result("OUT")["cameras"]["right"]["T_camera_rig"]);
  // OpenCV's (tests/data), which takes the bent board for flat and finds it in ten of the pairs.
  constexpr double kBaseline = 3.3106 * 0.025, kRelative = 0.01;
  EXPECT_NEAR((T.topRightCorner<3, 1>().norm()), kBaseline, kRelative * kBaseline);
  constexpr double kRounding = 1e-9;  // of the files' digits
  EXPECT_LT((Matrix(Result("EARLIER")["cameras"]["right"]["T_camera_rig"]) - T).norm(), kRounding);
  EXPECT_LT((Matrix(Result("CAMCHAIN")["cameras"]["cam1"]["T_camera_rig"]) - T).norm(), kRounding);
}

// Of a camera that a page calibrates; the figures are those that the page states.
double Rms(const YAML::Node& calibration, const std::string& camera) {
  return calibration["cameras"][camera]["residuals"]["rms"].as<double>();
}

TEST_F(Documentation, FromOpenCvAPairGoesThereAndBack) {
  RunExamplesOf("from_opencv.md");
  EXPECT_THAT(Read("log"), HasSubstr("\nsame within uncertainty"));
  for (const char* name : {"M1: ", "D1: ", "M2: ", "D2: ", "R: ", "T: "}) {
    EXPECT_THAT(Read("stereo.yml"), HasSubstr(name));
  }
  EXPECT_EQ(std::distance(fs::directory_iterator(Path("rectified/left")), {}), 9);
}

TEST_F(Documentation, FromKalibrAPairGoesThereAndBack) {
  RunExamplesOf("from_kalibr.md");
  EXPECT_THAT(Read("log"), HasSubstr("\nsame within uncertainty"));
  EXPECT_THAT(Verdict("result"), HasSubstr("This calibration is good"));
  EXPECT_THAT(Read("camchain.yaml"), HasSubstr("distortion_model: equidistant"));
  EXPECT_THAT(Read("camchain.yaml"), HasSubstr("T_cn_cnm1"));
}

TEST_F(Documentation, FromMatlabAPairGoesThereAndBack) {
  RunExamplesOf("from_matlab.md");
  EXPECT_THAT(Read("log"), HasSubstr("\nsame within uncertainty"));
  EXPECT_THAT(Read("stereo.mat"), HasSubstr("RadialDistortion1"));
}

TEST_F(Documentation, FromMrcalCornersAndModelsAreRead) {
  const fs::path set = OptionalData("frames/corners_mrcal_figueroa");
  if (!fs::exists(set)) GTEST_SKIP() << Absent(set);
  RunExamplesOf("from_mrcal.md");
  EXPECT_NEAR(Rms(Result("result"), "camera"), 0.61, 0.005);
  EXPECT_THAT(Verdict("result"), HasSubstr("the residuals have a pattern"));
  EXPECT_THAT(Read("camera.cameramodel"), HasSubstr("LENSMODEL_OPENCV8"));
}

TEST_F(Documentation, FromCompoteObservationsGiveTheFiguresOfItsPage) {
  const fs::path set = OptionalData("plenoptic_real/r12a");
  if (!fs::exists(set)) GTEST_SKIP() << Absent(set);
  RunExamplesOf("from_compote.md");
  const YAML::Node values = Result("r12a")["cameras"]["r12"]["parameters"];
  EXPECT_NEAR(values["f_L"].as<double>(), 51.60e-3, 0.005e-3);
  EXPECT_NEAR(values["b_L0"].as<double>(), 58.68e-3, 0.005e-3);
  EXPECT_NEAR(values["B"].as<double>(), 0.388e-3, 0.0005e-3);
}

TEST_F(Documentation, WhereOpenCvFailsCornersAreFoundAndAFisheyeIsCalibrated) {
  for (const char* name : {"frames/charuco_lifecam", "frames/mono_fisheye_ocamcalib"}) {
    const fs::path set = OptionalData(name);
    if (!fs::exists(set)) GTEST_SKIP() << Absent(set);
  }
  RunExamplesOf("opencv_fails.md");
  EXPECT_THAT(Read("log"), HasSubstr("cam: 13 images, target found in 13, 631 points"));
  EXPECT_NEAR(Rms(Result("fisheye"), "cam"), 0.20, 0.005);
  EXPECT_THAT(Read("fisheye.yml"), HasSubstr("fisheye_model: 1"));
}

TEST_F(Documentation, CommandsOfEachPageAreRunOrNameTheReadersFiles) {
  const std::set<std::string> others{
      "data.md",       // ctest
      "fleet.md",      // the reader's plan
      "new_model.md",  // scripts/add
      "python.md",     // installation
      "suggest.md",    // the reader's images
      "workbench.md",  // a server
  };
  std::ifstream file(__FILE__);
  const std::string own(std::istreambuf_iterator<char>(file), {});
  for (const auto& entry : fs::directory_iterator(PLENOCAL_DOCS)) {
    const std::string name = entry.path().filename().string();
    if (entry.path().extension() != ".md" || others.contains(name)) continue;
    std::ifstream page(entry.path());
    const std::string text(std::istreambuf_iterator<char>(page), {});
    if (text.find("\n```sh\n") == std::string::npos) continue;
    EXPECT_THAT(own, HasSubstr("RunExamplesOf(\"" + name + "\")")) << "add a test of this page";
  }
}

// The ```yaml blocks of a document, without the blanks that all lines of a block begin with.
std::vector<std::string> YamlBlocks(const fs::path& document) {
  std::ifstream file(document);
  std::vector<std::string> blocks;
  size_t indent = std::string::npos;  // of the block that is open
  for (std::string line; std::getline(file, line);) {
    const size_t first = line.find_first_not_of(' ');
    if (indent != std::string::npos && first != std::string::npos && line.find("```") == first) {
      indent = std::string::npos;
    } else if (indent != std::string::npos) {
      blocks.back() += line.substr(std::min(indent, line.size())) + "\n";
    } else if (first != std::string::npos && line.substr(first) == "```yaml") {
      indent = first;
      blocks.emplace_back();
    }
  }
  return blocks;
}

TEST_F(Documentation, FilesOfTheReadmeAreRead) {
  const std::vector<std::string> blocks =
      YamlBlocks(fs::path(PLENOCAL_DOCS).parent_path() / "README.md");
  ASSERT_EQ(blocks.size(), 1U);
  Write("session.yaml", blocks[0]);
  // The images alone are missing.
  EXPECT_THAT(Run({"calibrate", "session.yaml", "-o", "out"}).err, HasSubstr("no file matches"));
}

TEST_F(Documentation, ReadmeAndGuideHaveEachCommand) {
  const fs::path docs = PLENOCAL_DOCS;
  const auto text = [](const fs::path& path) {
    std::ifstream file(path);
    return std::string(std::istreambuf_iterator<char>(file), {});
  };
  const std::string readme = text(docs.parent_path() / "README.md"),
                    guide = text(docs / "guide.md");
  const std::string help = Run({"--help"}).out;
  const std::string heading = "Subcommands:\n";
  ASSERT_THAT(help, HasSubstr(heading));
  int commands = 0;
  for (const std::string& line : Lines(help.substr(help.find(heading) + heading.size()))) {
    if (!line.starts_with("  ") || line.size() < 3 || line[2] == ' ') continue;
    const std::string name = line.substr(2, line.find(' ', 2) - 2);
    const std::regex quoted(fmt::format("`(plenocal )?{}[` ]", name));
    EXPECT_TRUE(std::regex_search(readme, quoted)) << "README.md: " << name;
    EXPECT_TRUE(std::regex_search(guide, quoted)) << "docs/guide.md: " << name;
    ++commands;
  }
  EXPECT_GE(commands, 17);
}

}  // namespace TEST_FILE
}  // namespace plenocal::testing
