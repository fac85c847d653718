// SPDX-License-Identifier: Apache-2.0
//
// make_problem CAMERAS FRAMES exact|bent FOLDER
//
// Writes session.yaml, target.yaml, camN.csv and truth.csv (the true parameters): a board of 10 x 7
// markers, 0.2 px noise. The true markers lie at their nominal places (exact) or 0.5 mm about them
// in each coordinate (bent).
#include <fmt/core.h>

#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <string>

#include "calib/files/detections.h"
#include "tests/calib/synthetic.h"

int main(int argc, char** argv) {
  if (argc != 5) {
    fmt::print(stderr, "usage: make_problem CAMERAS FRAMES exact|bent FOLDER\n");
    return 2;
  }
  const bool bent = std::string(argv[3]) == "bent";
  const std::filesystem::path folder = argv[4];
  const auto problem = plenocal::testing::MakeProblem(1,
                                                      {.cameras = std::atoi(argv[1]),
                                                       .frames = std::atoi(argv[2]),
                                                       .noise = 0.2,
                                                       .marker_tolerance = bent ? 0.0005 : 0});

  std::ofstream(folder / "target.yaml")
      << "plenocal: 1\ntype: chessboard\ncolumns: 10\nrows: 7\nsquare: 0.03\ntolerance: 0.0005\n";
  std::ofstream session(folder / "session.yaml");
  session << "plenocal: 1\ntarget: target.yaml\ncameras:\n";
  for (const auto& camera : problem.input.cameras) {
    session << fmt::format("  {}: {{model: {}, detections: {}.csv, image_size: [{}, {}]}}\n",
                           camera.name,
                           camera.model->name,
                           camera.name,
                           camera.image_size[0],
                           camera.image_size[1]);
    std::ofstream(folder / (camera.name + ".csv"))
        << plenocal::DetectionsCsv(camera.views, *camera.model);
  }
  std::ofstream truth(folder / "truth.csv");
  truth << "camera,parameter,value\n";
  for (size_t c = 0; c < problem.params.size(); ++c) {
    const auto& camera = problem.input.cameras[c];
    for (size_t i = 0; i < problem.params[c].size(); ++i) {
      truth << fmt::format(
          "{},{},{}\n", camera.name, camera.model->params[i].name, problem.params[c][i]);
    }
  }
  return session && truth ? 0 : 1;
}
