// SPDX-License-Identifier: Apache-2.0
//
// The documents' examples, run as a reader would: the lines of all ```sh blocks of a document, in
// order, in a folder that has the project's `examples`.
#include <fmt/format.h>

#include <cstdlib>

#include "tests/apps/workspace.h"

namespace plenocal::testing {
namespace {

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
    bool inside = false, any = false;
    for (const std::string& line : Lines(Read("document.md"))) {
      if (line.starts_with("```")) {
        inside = line == "```sh";
        any = any || inside;
      } else if (inside) {
        script += line + "\n";
      }
    }
    ASSERT_TRUE(any) << "no ```sh block in " << path;
    Write("script", script);
    fs::copy(PLENOCAL_EXAMPLES, Path("examples"), fs::copy_options::recursive);
    const std::string command = fmt::format("cd '{}' && bash script >log 2>&1", Path("").string());
    ASSERT_EQ(std::system(command.c_str()), 0) << Read("log");
  }

  /// The verdict in a report: its findings in words.
  [[nodiscard]] std::string Verdict(const std::string& folder) const {
    const std::string page = Read(folder + "/report.html");
    const size_t begin = page.find("\"verdict\":");
    return begin == std::string::npos ? "" : page.substr(begin);
  }
};

TEST_F(Documentation, ConventionsAreShownOnARig) {
  RunExamplesOf("conventions.md");
  const YAML::Node xi = Result("rig/result")["cameras"]["right"]["xi_camera_rig"];
  EXPECT_NEAR(xi[0].as<double>(), -0.1, 2e-3);
}

TEST_F(Documentation, BadSetsOfTheRecordingGuideGetTheVerdictsItNames) {
  RunExamplesOf("recording.md");
  EXPECT_THAT(Verdict("results/varied"), HasSubstr("This calibration is good"));
  EXPECT_THAT(Verdict("results/one-distance"), HasSubstr("all images are from one distance"));
  EXPECT_THAT(Verdict("results/no-tilt"), HasSubstr("the target was not tilted"));
  EXPECT_THAT(Verdict("results/no-tilt"), HasSubstr("cam.f_x, cam.f_y: uncertain"));
  EXPECT_THAT(Verdict("results/corner"),
              HasSubstr("points only in the upper left corner of the image"));
  for (const char* kind : {"varied", "one-distance", "no-tilt", "corner"}) {
    const YAML::Node camera = Result(fmt::format("results/{}", kind))["cameras"]["cam"];
    EXPECT_NEAR(camera["residuals"]["rms"].as<double>(), 0.132, 0.008) << kind;
  }
}

}  // namespace
}  // namespace plenocal::testing
