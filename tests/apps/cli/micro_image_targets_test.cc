// SPDX-License-Identifier: Apache-2.0
//
// Raw plenoptic images of each kind of target, from the image to the measurements in micro images.
// (Tags: the tests on `sim_small`.)
#include <Eigen/Core>
#include <algorithm>
#include <array>
#include <map>
#include <string>
#include <vector>

#include "calib/base/statistics.h"
#include "calib/io/yaml.h"
#include "tests/apps/workspace.h"

namespace plenocal::testing {
namespace TEST_FILE {

class MicroImageTargets : public Workspace {
 protected:
  // A session with images of the target, set/session.yaml.
  void Simulate(const std::string& target,
                const std::string& poses,
                const std::string& camera = "") const {
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
              "    micro_lenses: {pitch: 18, rotation: 0.1, focus: [3.6, 3.35, 3.1]}\n" +
              camera);
    const Outcome made = Run({"simulate", "spec.yaml", "-o", "set"});
    EXPECT_EQ(made.status, kDone) << made.err;
  }
  // A measured marker, px.
  struct Measured {
    std::string view;
    Eigen::Vector2d error, offset;  // from where it truly is; from there to the centre
    double weight;
  };
  std::vector<Measured> Detect(const std::string& session) const {
    const Outcome detected = Run({"detect", session, "-o", "out", "--fresh"});
    EXPECT_EQ(detected.status, kDone) << detected.err;
    struct Row {
      std::string view;
      Eigen::Vector2d place, centre;
    };
    const auto rows = [](const Table& table) {
      const auto frame = table.Column("frame"), marker = table.Column("marker");
      const auto x = table.Numbers("x"), y = table.Numbers("y");
      const auto lens_x = table.Numbers("lens_x"), lens_y = table.Numbers("lens_y");
      std::vector<Row> all;
      for (size_t i = 0; i < x.size(); ++i) {
        all.push_back({frame[i] + " " + marker[i], {x[i], y[i]}, {lens_x[i], lens_y[i]}});
      }
      return all;
    };
    const std::vector<Row> truth = rows(Table(Read("set/truth/detections_plenoptic.csv")));
    const Table table(Read("out/detections_plenoptic.csv"));
    const std::vector<double> sigma = table.Numbers("sigma");
    const std::vector<Row> found = rows(table);
    std::vector<Measured> measured;
    for (size_t i = 0; i < found.size(); ++i) {
      Measured one{.view = found[i].view, .error = {1e9, 0}, .offset = {0, 0}, .weight = 0};
      double nearest = 1;  // px between the true centre and the one found
      for (const Row& other : truth) {
        const double away = (other.centre - found[i].centre).norm();
        if (other.view != one.view || away > nearest) continue;
        nearest = away;
        one.error = found[i].place - other.place;
        one.offset = other.place - other.centre;
        one.weight = 1 / (sigma[i] * sigma[i]);
      }
      measured.push_back(one);
    }
    return measured;
  }
  // Distances of the measured markers from where they truly are in the same micro image, px.
  std::vector<double> Errors(const std::string& target) const {
    Simulate(target, "{frames: 2, distance: [0.42, 0.5], tilt: 0.3, partial: 0}");
    std::vector<double> errors;
    for (const Measured& one : Detect("set/session.yaml")) errors.push_back(one.error.norm());
    return errors;
  }
  // Relative error of the inverse virtual depth that the micro images of all markers imply: the
  // share of their distance from the centre that they are pushed outward.
  static double Push(const std::vector<Measured>& measured) {
    std::map<std::string, std::vector<const Measured*>> views;
    for (const Measured& one : measured) {
      if (one.error.norm() < 0.1) views[one.view].push_back(&one);
    }
    double right = 0, information = 0;
    for (const auto& [view, of_marker] : views) {
      Eigen::Vector2d error(0, 0), offset(0, 0);
      double weights = 0;
      for (const Measured* one : of_marker) {
        error += one->weight * one->error;
        offset += one->weight * one->offset;
        weights += one->weight;
      }
      for (const Measured* one : of_marker) {
        const Eigen::Vector2d arm = one->offset - offset / weights;
        right += one->weight * arm.dot(one->error - error / weights);
        information += one->weight * arm.squaredNorm();
      }
    }
    return right / information;
  }
};

TEST_F(MicroImageTargets, ChessboardCorners) {
  const std::vector<double> errors =
      Errors("type: chessboard\ncolumns: 6\nrows: 5\nsquare: 0.011\n");
  EXPECT_GT(errors.size(), 150u);
  EXPECT_LT(Median(errors), 0.06);
}

TEST_F(MicroImageTargets, BlurGivesTheFocalLengthOfEachLensType) {
  Simulate("type: chessboard\ncolumns: 6\nrows: 5\nsquare: 0.011\n",
           "{frames: 8, distance: [0.36, 0.6], tilt: 0.5, partial: 0}");
  const Outcome outcome = Run({"calibrate", "set/session.yaml", "-o", "out"});
  ASSERT_EQ(outcome.status, kDone) << outcome.err;
  const YAML::Node camera = Result()["cameras"]["plenoptic"];
  std::vector<std::pair<double, double>> found;  // with standard errors
  for (const YAML::Node& type : camera["lens_types"]) {
    found.emplace_back(type["focal_length"].as<double>(), type["sigma_focal_length"].as<double>());
    EXPECT_LT(type["near"].as<double>(), type["in_focus"].as<double>());
  }
  std::ranges::sort(found);
  ASSERT_EQ(found.size(), 3u);
  const auto B = camera["parameters"]["B"].as<double>();
  constexpr std::array kFocus{3.6, 3.35, 3.1};  // virtual depths: in the order of focal lengths
  for (size_t i = 0; i < 3; ++i) {
    const double truth = B * kFocus[i] / (kFocus[i] - 1);
    // The three have most of their error in common: -2.2, -3.2 and -2.4 of these.
    EXPECT_NEAR(found[i].first, truth, 3.5 * found[i].second);
    EXPECT_LT(found[i].second, 0.015 * truth);
  }
  EXPECT_NE(Read("out/report.html").find("focal_length_sigma"), std::string::npos);
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

TEST_F(MicroImageTargets, SmallTagsOfAGridInGreyAndInAMosaic) {
  // Bits of 1.5 to 2.5 px: what is around a tag blurs into its corners.
  Simulate("type: aprilgrid\ncolumns: 7\nrows: 7\nsize: 0.018\nspacing: 0.3\n",
           "{frames: 6, distance: [0.4, 0.7], tilt: 0.5, partial: 0}",
           "    full_well: 1000000000\n    read_noise: 0\n    bits: 16\n");
  const auto median = [](const std::vector<Measured>& measured) {
    std::vector<double> errors(measured.size());
    std::transform(measured.begin(), measured.end(), errors.begin(), [](const Measured& one) {
      return one.error.norm();
    });
    return Median(errors);
  };
  const std::vector<Measured> grey = Detect("set/session.yaml");
  EXPECT_GT(grey.size(), 500u);
  EXPECT_LT(median(grey), 0.0145);
  EXPECT_NEAR(Push(grey), 0, 0.0004);
  std::string session = Read("set/session.yaml");
  session.replace(session.find("    pixel_size"), 0, "    bayer: RGGB\n");
  Write("set/mosaic.yaml", session);
  const std::vector<Measured> mosaic = Detect("set/mosaic.yaml");
  EXPECT_GT(mosaic.size(), 400u);
  EXPECT_LT(median(mosaic), 0.0125);
  // 0.0008 if the drawing is not the mean that the values are.
  EXPECT_NEAR(Push(mosaic), 0, 0.0006);
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

TEST_F(MicroImageTargets, WhiteImagesOfAnotherFocusAreNamed) {
  Simulate("type: chessboard\ncolumns: 6\nrows: 5\nsquare: 0.011\n",
           "{frames: 5, distance: [0.38, 0.6], tilt: 0.5, partial: 0}");
  const auto findings = [&](const std::string& session) {
    const Outcome outcome = Run({"calibrate", session, "-o", "out"});
    EXPECT_EQ(outcome.status, kDone) << outcome.err;
    return Result()["verdict"]["findings"];
  };
  for (const YAML::Node& finding : findings("set/session.yaml")) {
    EXPECT_NE(finding["code"].as<std::string>(), "white_lattice");
  }
  Write("spec.yaml", Replaced(Read("spec.yaml"), "pitch: 18", "pitch: 18.02"));
  EXPECT_EQ(Run({"simulate", "spec.yaml", "-o", "other"}).status, kDone);
  Write("set/other.yaml",
        Replaced(Read("set/session.yaml"), "white_images: plen", "white_images: ../other/plen"));
  std::string what;
  for (const YAML::Node& finding : findings("set/other.yaml")) {
    if (finding["code"].as<std::string>() == "white_lattice") {
      what = finding["what"].as<std::string>();
    }
  }
  EXPECT_THAT(what, ::testing::HasSubstr("pitch -1.1e-03"));
}

TEST_F(MicroImageTargets, AWrongBayerOrderIsNamed) {
  const auto detect = [&](const std::string& simulated, const std::string& stated) {
    Simulate("type: chessboard\ncolumns: 6\nrows: 5\nsquare: 0.011\n",
             "{frames: 1, distance: [0.42, 0.5], tilt: 0.3, partial: 0}",
             simulated);
    const std::string session = Read("set/session.yaml");
    Write("set/session.yaml",
          simulated.empty() ? Replaced(session, "    pixel_size", stated + "    pixel_size")
                            : Replaced(session, simulated, stated));
    return Run({"detect", "set/session.yaml", "-o", "out"}).err;
  };
  using ::testing::HasSubstr;
  const std::string rggb = "    bayer: RGGB\n";
  EXPECT_THAT(detect(rggb, rggb), ::testing::Not(HasSubstr("bayer")));
  EXPECT_THAT(detect(rggb, "    bayer: GBRG\n"), HasSubstr("the order is RGGB or BGGR"));
  EXPECT_THAT(detect(rggb, ""), HasSubstr("look like raw colour mosaics"));
  EXPECT_THAT(detect("", rggb), HasSubstr("alike in the white images"));
}

}  // namespace TEST_FILE
}  // namespace plenocal::testing
