// SPDX-License-Identifier: Apache-2.0
//
// What is said of calibrations that are not good: is any number another than before?
#include <gtest/gtest.h>

#include <vector>

#include "assess/causes/diagnose.h"
#include "assess/frames/frame_influence.h"
#include "assess/missing/missing_families.h"
#include "calib/estimate/describe.h"
#include "calib/files/calibration_file.h"
#include "models/registry.h"
#include "tests/calib/plenoptic_synthetic.h"
#include "tests/calib/synthetic.h"
#include "tests/digest.h"

namespace plenocal::testing {
namespace TEST_FILE {

constexpr double kTolerance = 1e-3;  // of all numbers together: digits that round the other way

double DigestOf(const CalibrationInput& input) {
  const Calibration calibration = Calibrate(input, {.threads = 1, .progress = {}});
  CalibrationRecord record = Describe(calibration);
  Diagnose(
      input, calibration, {}, CameraModels(), [] { return true; }, &record);
  Digest digest;
  digest.AddNumbersOf(CalibrationYaml(record));
  for (const FrameInfluence& each : FrameInfluences(record)) digest.Add(each.sigmas);
  if (input.cameras[0].model->plenoptic) return digest.Sum();
  for (const MissingFamily& each : FindMissingFamilies(calibration, 0)) {
    digest.AddAll(std::vector{each.degrees * 1.0, each.probability, 10 * each.gain});
  }
  return digest.Sum();
}

/// In the second half of the frames the points are 0.4 % farther from (320, 240) px, as after a
/// zoom.
CalibrationInput Zoomed(CalibrationInput input) {
  for (CameraInput& camera : input.cameras) {
    for (size_t v = camera.views.size() / 2; v < camera.views.size(); ++v) {
      for (Observation& each : camera.views[v].observations) {
        each.values[0] += 0.004 * (each.values[0] - 320);
        each.values[1] += 0.004 * (each.values[1] - 240);
      }
    }
  }
  return input;
}

TEST(SameResults, OfDoubtfulCalibrations) {
  CalibrationInput with_skew = MakeProblem(71, {.frames = 10, .fov_deg = 90, .noise = 0.1}).input;
  CalibrationInput pinhole = with_skew;
  SetModel(*FindModel(CameraModels(), "pinhole-radial3+skew"), &with_skew.cameras[0]);
  SetModel(*FindModel(CameraModels(), "pinhole"), &pinhole.cameras[0]);
  const SyntheticOptions pair{.cameras = 2, .frames = 12, .noise = 0.1, .visible = 0.8};
  EXPECT_NEAR(DigestOf(with_skew), 58.6751, kTolerance);
  EXPECT_NEAR(DigestOf(pinhole), -54.1477, kTolerance);
  EXPECT_NEAR(DigestOf(MakeProblem(72, {.frames = 3, .noise = 0.4}).input), -81.4819, kTolerance);
  EXPECT_NEAR(DigestOf(Zoomed(MakeProblem(73, pair).input)), -31.3605, kTolerance);
  SyntheticOptions scattered = pair;
  scattered.marker_tolerance = 0.002;
  EXPECT_NEAR(DigestOf(MakeProblem(74, scattered).input), -4.1383, kTolerance);
}

TEST(SameResults, OfDoubtfulPlenopticCalibrations) {
  EXPECT_NEAR(
      DigestOf(MakePlenopticProblem(75, {.noise = 0.2, .frames = 4}).input), 116.9679, kTolerance);
  EXPECT_NEAR(DigestOf(MakePlenopticProblem(76, {.noise = 0.1, .frame_slope = 0.01}).input),
              97.0626,
              kTolerance);
}

}  // namespace TEST_FILE
}  // namespace plenocal::testing
