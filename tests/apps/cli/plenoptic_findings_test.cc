// SPDX-License-Identifier: Apache-2.0
//
// Findings on plenoptic cameras, by simulated points: a tilted micro-lens array before a model
// without a tilt; the remedy for parameters that the distances do not determine; errors of the
// micro-image centres.
#include <fmt/format.h>
#include <gmock/gmock.h>

#include <cmath>

#include "calib/io/yaml.h"
#include "tests/apps/workspace.h"

namespace plenocal::testing {
namespace TEST_FILE {

using ::testing::AllOf;
using ::testing::HasSubstr;
using ::testing::Not;

class PlenopticFindings : public Workspace {
 protected:
  // Calibrates points of a camera, whose array is tilted (rad), by the model without a tilt.
  Outcome Calibrate(double t_x, double t_y, const std::string& poses) const {
    Write("target.yaml",
          "plenocal: 1\ntype: aprilgrid\ncolumns: 5\nrows: 5\nsize: 0.024\nspacing: 0.3\n"
          "tolerance: 0.0003\n");
    Write("spec.yaml",
          fmt::format(
              "plenocal: 1\nseed: 5\ntarget: target.yaml\nposes: {{{}}}\ncameras:\n  raw: {{model: "
              "focused-plenoptic-tilt, image_size: [900, 900], pixel_size: 5.5e-6, "
              "detection_sigma: 0.03, parameters: {{f_L: 0.0161, b_L0: 0.0154, B: 0.00033, c_x: "
              "455, c_y: 441, A_0: -180, t_x: {}, t_y: {}}}, micro_lenses: {{pitch: 23, rotation: "
              "0.01, focus: [2.4, 3.1, 4.6]}}}}\n",
              poses,
              t_x,
              t_y));
    EXPECT_EQ(Run({"simulate", "spec.yaml", "--points", "-o", "set"}).status, kDone);
    Write("set/session.yaml",
          Replaced(Read("set/session.yaml"), "focused-plenoptic-tilt", "focused-plenoptic"));
    const Outcome outcome = Run({"calibrate", "set/session.yaml", "-o", "out"});
    EXPECT_EQ(outcome.status, kDone) << outcome.err;
    return outcome;
  }

  static constexpr const char* kManyDistances =
      "kind: varied, frames: 10, distance: [0.3, 0.6], partial: 0.3";
};

TEST_F(PlenopticFindings, ATiltIsNamedWithItsAngle) {
  const double t_x = 0.0024, t_y = -0.0032;
  EXPECT_THAT(Calibrate(t_x, t_y, kManyDistances).out, HasSubstr("array_tilted"));
  for (const YAML::Node& finding : Result()["verdict"]["findings"]) {
    if (finding["code"].as<std::string>() != "array_tilted") continue;
    // One linear step, with outliers rejected before the wrong model.
    EXPECT_NEAR(finding["value"].as<double>(), std::hypot(t_x, t_y), 0.15 * std::hypot(t_x, t_y));
    EXPECT_EQ(finding["grade"].as<std::string>(), "bad");
    EXPECT_THAT(finding["what"].as<std::string>(), HasSubstr("distances at 0.4"));
  }
}

TEST_F(PlenopticFindings, AParallelArrayIsNotNamed) {
  EXPECT_THAT(Calibrate(0, 0, kManyDistances).out, Not(HasSubstr("array_tilted")));
}

TEST_F(PlenopticFindings, TheRemedyForOneDistanceStatesIt) {
  EXPECT_THAT(Calibrate(0, 0, "kind: varied, frames: 2, distance: [0.4, 0.41]").out,
              AllOf(HasSubstr("the target was seen from 0.3"), Not(HasSubstr("from inf"))));
}

TEST_F(PlenopticFindings, ErrorsOfCentresBesideTheDetectionsAreInTheStandardErrors) {
  const auto sigma = [&] { return Result()["cameras"]["raw"]["sigma"]["c_x"].as<double>(); };
  Calibrate(0, 0, kManyDistances);
  const double exact = sigma();
  const std::string lattice = "plenocal: 1\nimage_size: [900, 900]\ncovariance: [[400]]\n";
  Write("set/lattice_raw.yaml", lattice);
  EXPECT_EQ(Run({"calibrate", "set/session.yaml", "-o", "out"}).status, kDone);
  EXPECT_GT(sigma(), 5 * exact);
  Write("set/lattice_raw.yaml", Replaced(lattice, "[900, 900]", "[900, 800]"));
  const Outcome refused = Run({"calibrate", "set/session.yaml", "-o", "other"});
  EXPECT_EQ(refused.status, kWrongInput);
  EXPECT_THAT(refused.err, HasSubstr("lattice_raw.yaml:2:13: image_size: "));
}

}  // namespace TEST_FILE
}  // namespace plenocal::testing
