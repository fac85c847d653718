// SPDX-License-Identifier: Apache-2.0
//
// Exact images of a tilted micro-lens array, calibrated by models without a tilt.
#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <cstdio>

#include "assess/causes/cause.h"
#include "calib/base/statistics.h"
#include "models/registry.h"
#include "tests/calib/plenoptic_synthetic.h"

namespace plenocal {

Cause ArrayTiltedCause();

namespace testing {
namespace TEST_FILE {

using ::testing::IsEmpty;

constexpr double kTiltX = 4e-4, kTiltY = -7e-4;

/// The same images with residuals of another size.
struct Tilted {
  explicit Tilted(double factor = 1) {
    static const Calibration kCalibration = [] {
      const CameraModel* const model = FindModel(CameraModels(), "focused-plenoptic");
      PlenopticProblem problem = MakePlenopticProblem(3,
                                                      {.state_sigmas = false,
                                                       .frames = 5,
                                                       .columns = 4,
                                                       .rows = 3,
                                                       .tilt = {kTiltX, kTiltY},
                                                       .virtual_depth = 2});
      CameraInput& camera = problem.input.cameras[0];
      camera.model = model;
      camera.initial.assign(problem.params.begin(), problem.params.end() - 2);
      camera.fixed.resize(camera.initial.size());
      Calibration made = Calibrate(problem.input, {.threads = 1, .progress = {}});
      made.bundle.cameras[0].noise = {};
      return made;
    }();
    calibration = kCalibration;
    const auto residuals = Residuals(calibration.bundle, 0);
    std::vector<BundleObservation>& observations = calibration.bundle.observations;
    for (size_t i = 0; i < observations.size(); ++i) {
      observations[i].used = true;
      observations[i].assumed_sigma = 1e-3;
      for (size_t axis = 0; axis < 2; ++axis) {
        observations[i].seen.values[axis] += (factor - 1) * residuals[i][axis];
        squares += std::pow(factor * residuals[i][axis], 2);
      }
    }
  }

  // Gives the camera another model, whose other parameters are known.
  void SetModel(const char* name, const std::vector<double>& more) {
    BundleCamera& camera = calibration.bundle.cameras[0];
    camera.model = FindModel(CameraModels(), name);
    camera.params.insert(camera.params.end(), more.begin(), more.end());
    camera.fixed.resize(camera.params.size(), true);
    camera.at_bound.clear();
    ASSERT_EQ(camera.params.size(), camera.model->params.size());
  }
  [[nodiscard]] double Param(size_t k) const { return calibration.bundle.cameras[0].params[k]; }

  [[nodiscard]] double Distance() const {
    std::vector<double> distances;
    for (const RigidTransform& T : calibration.bundle.T_rig_target) distances.push_back(T.t.norm());
    return Median(distances);
  }
  // At the edge of the image's shorter side (docs/plenoptic.md, "Tilted arrays").
  [[nodiscard]] double Error(double angle) const {
    const double f = Param(0), b_L0 = Param(1), B = Param(2), e = f - b_L0;
    const double delta = angle * 1800 / 2 * 5.5e-6;
    return std::abs((1 + Distance() * e * (e + b_L0) / (f * f * b_L0)) * delta / B);
  }
  [[nodiscard]] std::vector<Finding> Find() const {
    return ArrayTiltedCause().find({.calibration = &calibration});
  }

  Calibration calibration;
  double squares = 0;  ///< of all residuals, px^2
};

TEST(ArrayTilted, MeasuresTheTiltAndItsErrorOfDistances) {
  const Tilted tilted;
  const std::vector<Finding> found = tilted.Find();
  ASSERT_EQ(found.size(), 1U);
  const double angle = std::hypot(kTiltX, kTiltY);
  EXPECT_EQ(found[0].code, "array_tilted");
  EXPECT_EQ(found[0].role, FindingRole::kCause);
  EXPECT_NEAR(*found[0].value, angle, 0.05 * angle);
  EXPECT_EQ(found[0].limit, 0);
  double t_x = 0, t_y = 0;
  ASSERT_EQ(std::sscanf(found[0].what.c_str(),
                        "the micro-lens array is tilted against the sensor by about %*f mrad (t_x "
                        "%lf, t_y %lf)",
                        &t_x,
                        &t_y),
            2);
  EXPECT_NEAR(t_x, 1e3 * kTiltX, 0.05);
  EXPECT_NEAR(t_y, 1e3 * kTiltY, 0.05);
  EXPECT_EQ(found[0].what,
            fmt::format("the micro-lens array is tilted against the sensor by about {:.2g} mrad "
                        "(t_x {:.2g}, t_y {:.2g}), which focused-plenoptic takes as parallel: "
                        "distances at {:.2g} m are up to {:.2g} % off towards the edges of the "
                        "image.",
                        1e3 * *found[0].value,
                        t_x,
                        t_y,
                        tilted.Distance(),
                        100 * tilted.Error(*found[0].value)));
  EXPECT_EQ(found[0].remedy,
            "Set model: focused-plenoptic-tilt, or compare both with 'plenocal try'.");
}

// The tilt goes with the residuals.
TEST(ArrayTilted, IsGradedByTheErrorOfDistances) {
  const double angle = *Tilted().Find().at(0).value, error = Tilted().Error(angle);
  const auto find = [&](double wanted) { return Tilted(wanted / error).Find(); };
  EXPECT_EQ(find(0.0202).at(0).grade, Grade::kBad);
  EXPECT_EQ(find(0.0198).at(0).grade, Grade::kUsable);
  EXPECT_EQ(find(0.00303).at(0).grade, Grade::kUsable);
  EXPECT_THAT(find(0.00297), IsEmpty());
  EXPECT_NEAR(*find(0.01).at(0).value, 0.01 / error * angle, 0.01 * angle);
}

// Two more unknowns explain all residuals: F is half of their squares, 6.9 at a level of 1e-3.
TEST(ArrayTilted, IsBeyondTheNoise) {
  for (const double F : {6.4, 7.6}) {
    Tilted tilted;
    const double sigma = std::sqrt(tilted.squares / 2 / F);
    for (BundleObservation& seen : tilted.calibration.bundle.observations)
      seen.assumed_sigma = sigma;
    EXPECT_EQ(tilted.Find().size(), F > 6.9 ? 1U : 0U) << F;
  }
}

// A pupil in the thin lens is that of the model without a pupil.
TEST(ArrayTilted, IsTheSameWithAKnownPupil) {
  const std::vector<Finding> expected = Tilted().Find();
  Tilted pupil;
  pupil.SetModel("focused-plenoptic-pupil", {pupil.Param(1)});
  Tilted thick;
  thick.SetModel("plenoptic-thick", {1 / thick.Param(1), 0, 0, 0, 0});
  for (const Tilted* tilted : {&pupil, &thick}) {
    const std::vector<Finding> found = tilted->Find();
    ASSERT_EQ(found.size(), 1U);
    EXPECT_NEAR(*found[0].value, *expected[0].value, 1e-3 * *expected[0].value);
    // But for the model's name.
    EXPECT_EQ(found[0].what.substr(0, 60), expected[0].what.substr(0, 60));
    EXPECT_EQ(found[0].what.substr(found[0].what.find("takes")),
              expected[0].what.substr(expected[0].what.find("takes")));
  }
}

TEST(ArrayTilted, IsForPlenopticCamerasWithoutATilt) {
  Tilted tilt;
  tilt.SetModel("focused-plenoptic-tilt", {0, 0});
  EXPECT_THAT(tilt.Find(), IsEmpty());
  Tilted flat;
  flat.calibration.bundle.cameras[0].params[2] = 0;
  EXPECT_THAT(flat.Find(), IsEmpty());
  Tilted pinhole;
  BundleCamera& camera = pinhole.calibration.bundle.cameras[0];
  camera.model = FindModel(CameraModels(), "pinhole");
  camera.params.resize(4), camera.fixed.resize(4);
  EXPECT_THAT(pinhole.Find(), IsEmpty());
}

}  // namespace TEST_FILE
}  // namespace testing
}  // namespace plenocal
