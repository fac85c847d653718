// SPDX-License-Identifier: Apache-2.0
//
// Raw plenoptic images of each kind of target, from the image to the measurements in micro images.
// (Tags: the tests on `sim_small`.)
#include <algorithm>
#include <cmath>
#include <string>
#include <vector>

#include "calib/median.h"
#include "calib/yaml.h"
#include "tests/apps/workspace.h"

namespace plenocal::testing {
namespace {

class MicroImageTargets : public Workspace {
 protected:
  // A session with images of the target, set/session.yaml.
  void Simulate(const std::string& target, const std::string& poses) const {
    Write("target.yaml", "plenocal: 1\ntolerance: 0.0001\n" + target);
    Write("spec.yaml",
          "plenocal: 1\nseed: 3\ntarget: target.yaml\nwhite_images: 2\nposes: " + poses +
              "\ncameras:\n"
              "  plenoptic:\n"
              "    model: focused-plenoptic\n"
              "    image_size: [420, 420]\n"
              "    pixel_size: 7.4e-6\n"
              "    parameters: {f_L: 0.0125, b_L0: 0.0119876, B: 0.000244, c_x: 211, c_y: 208, "
              "A_0: -200}\n"
              "    blur: 0.35\n"
              "    micro_lenses: {pitch: 18, rotation: 0.1, focus: [3.6, 3.35, 3.1]}\n");
    const Outcome made = Run({"simulate", "spec.yaml", "-o", "set"});
    EXPECT_EQ(made.status, kDone) << made.err;
  }
  // Distances of the measured markers from where they truly are in the same micro image, px.
  std::vector<double> Errors(const std::string& target) const {
    Simulate(target, "{frames: 2, distance: [0.42, 0.5], tilt: 0.3, partial: 0}");
    const Outcome detected = Run({"detect", "set/session.yaml", "-o", "out"});
    EXPECT_EQ(detected.status, kDone) << detected.err;
    struct Row {
      std::string view;
      double x, y, lens_x, lens_y;
    };
    const auto rows = [&](const std::string& file) {
      const Table table(Read(file));
      const auto frame = table.Column("frame"), marker = table.Column("marker");
      const auto x = table.Numbers("x"), y = table.Numbers("y");
      const auto lens_x = table.Numbers("lens_x"), lens_y = table.Numbers("lens_y");
      std::vector<Row> all;
      for (size_t i = 0; i < x.size(); ++i) {
        all.push_back({frame[i] + " " + marker[i], x[i], y[i], lens_x[i], lens_y[i]});
      }
      return all;
    };
    const std::vector<Row> truth = rows("set/truth/detections_plenoptic.csv");
    std::vector<double> errors;
    for (const Row& row : rows("out/detections_plenoptic.csv")) {
      double error = 1e9, nearest = 1;  // px between the true centre and the one found
      for (const Row& other : truth) {
        const double away = std::hypot(other.lens_x - row.lens_x, other.lens_y - row.lens_y);
        if (other.view != row.view || away > nearest) continue;
        nearest = away;
        error = std::hypot(other.x - row.x, other.y - row.y);
      }
      errors.push_back(error);
    }
    return errors;
  }
};

TEST_F(MicroImageTargets, ChessboardCorners) {
  const std::vector<double> errors =
      Errors("type: chessboard\ncolumns: 6\nrows: 5\nsquare: 0.011\n");
  EXPECT_GT(errors.size(), 150u);
  EXPECT_LT(Median(errors), 0.06);
}

TEST_F(MicroImageTargets, CharucoCornersBesideTheirMarkers) {
  // Without the markers in the drawing corners are off by a pixel.
  const std::vector<double> errors = Errors(
      "type: charuco\ncolumns: 5\nrows: 4\nsquare: 0.016\nmarker: 0.0112\ndictionary: "
      "DICT_4X4_50\n");
  EXPECT_GT(errors.size(), 60u);
  EXPECT_LT(Median(errors), 0.05);
  EXPECT_LT(*std::max_element(errors.begin(), errors.end()), 0.3);
}

TEST_F(MicroImageTargets, CirclesThatMicroImagesHoldWhole) {
  const std::vector<double> errors =
      Errors("type: circles\ncolumns: 6\nrows: 5\nspacing: 0.0085\npattern: symmetric\n");
  EXPECT_GT(errors.size(), 100u);
  EXPECT_LT(Median(errors), 0.02);
  EXPECT_LT(*std::max_element(errors.begin(), errors.end()), 0.1);
}

TEST_F(MicroImageTargets, TableOfDetectionsSaysAllThatTheImagesSay) {
  Simulate("type: chessboard\ncolumns: 6\nrows: 5\nsquare: 0.011\n",
           "{frames: 5, distance: [0.38, 0.6], tilt: 0.5, partial: 0}");
  Outcome outcome = Run({"calibrate", "set/session.yaml", "-o", "images"});
  ASSERT_EQ(outcome.status, kDone) << outcome.err;
  const auto calibrate = [&](const std::string& detections, const std::string& out) {
    Write("again.yaml",
          "plenocal: 1\ntarget: set/target.yaml\ncameras:\n  plenoptic:\n"
          "    model: focused-plenoptic\n    image_size: [420, 420]\n    pixel_size: 7.4e-6\n"
          "    detections: " +
              detections + "\n");
    outcome = Run({"calibrate", "again.yaml", "-o", out});
    EXPECT_EQ(outcome.status, kDone) << outcome.err;
    return YamlNode::ReadFile(Path(out + "/calibration.yaml"));
  };
  const auto images = YamlNode::ReadFile(Path("images/calibration.yaml"));
  const auto table = calibrate("images/detections_plenoptic.csv", "table");
  const auto number = [](const YamlNode& result, const char* of, const char* parameter) {
    return result.At("cameras").At("plenoptic").At(of).At(parameter).AsNumber();
  };
  for (const char* parameter : {"f_L", "b_L0", "B", "c_x", "A_0"}) {
    const double sigma = number(images, "sigma", parameter);
    EXPECT_NEAR(number(table, "parameters", parameter),
                number(images, "parameters", parameter),
                1e-3 * sigma)
        << parameter;
    EXPECT_NEAR(number(table, "sigma", parameter), sigma, 1e-3 * sigma) << parameter;
  }
  // Without the columns of shared errors B is thought to be better than it is.
  std::string rows = Read("images/detections_plenoptic.csv");
  for (size_t at; (at = rows.find("_shared_")) != std::string::npos;)
    rows.replace(at, 8, "_other_");
  Write("alone.csv", rows);
  EXPECT_LT(number(calibrate("alone.csv", "alone"), "sigma", "B"),
            0.98 * number(images, "sigma", "B"));
}

}  // namespace
}  // namespace plenocal::testing
