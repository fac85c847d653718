// SPDX-License-Identifier: Apache-2.0
//
// Models of fisheye lenses on a real set with views held out (shared/data; skipped where it is
// absent), and a camera that is held in all.
#include <fmt/format.h>

#include <cmath>
#include <fstream>
#include <sstream>

#include "tests/apps/workspace.h"

namespace plenocal::testing {
namespace {

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
  const fs::path set = fs::path(PLENOCAL_SHARED_DATA) / "frames/fisheye_3plane_ovcube";
  if (!fs::exists(set)) GTEST_SKIP() << set << " is absent";
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
                         ::testing::Values("kannala-brandt4", "double-sphere"),
                         [](const auto& test) {
                           return test.param == std::string("double-sphere") ? "DoubleSphere"
                                                                             : "KannalaBrandt4";
                         });

}  // namespace
}  // namespace plenocal::testing
