// SPDX-License-Identifier: Apache-2.0
#include "assess/frames/exclusion_preview.h"

#include <gtest/gtest.h>

#include "assess/views/view_information.h"
#include "calib/estimate/calibrate.h"
#include "calib/estimate/describe.h"
#include "tests/calib/synthetic.h"

namespace plenocal::testing {
namespace TEST_FILE {

struct Known {
  CalibrationRecord record;
  RigEstimate rig;
};

Known KnownFrom(const CalibrationInput& input, const ViewTarget& shape) {
  Known known{Describe(Calibrate(input, {})), {}};
  known.rig = MakeRigEstimate(known.record);
  SetFactors(known.record, shape, &known.rig);
  return known;
}

double RmsOf(const CalibrationRecord& record) {
  double square = 0, count = 0;
  for (const CalibratedCamera& camera : record.cameras) {
    square += camera.fit.rms * camera.fit.rms * camera.fit.points;
    count += camera.fit.points;
  }
  return std::sqrt(square / count);
}

// Against the adjustment without the points.
TEST(PreviewExclusion, IsTheCalibrationWithoutThePoints) {
  const SyntheticProblem problem = MakeProblem(6, {.cameras = 2, .frames = 12, .noise = 0.1});
  ViewTarget shape{.markers = problem.markers};
  const Known known = KnownFrom(problem.input, shape);
  // Three frames of both cameras, and half of the points of one image.
  const auto leaves_out = [&](int camera, int frame, int marker) {
    return frame < 3 || (camera == 1 && frame == 5 && marker % 2 == 0);
  };
  CalibrationInput rest = problem.input;
  for (size_t c = 0; c < rest.cameras.size(); ++c) {
    std::vector<View>& views = rest.cameras[c].views;
    for (size_t f = 0; f < views.size(); ++f) {
      std::erase_if(views[f].observations, [&](const Observation& seen) {
        return leaves_out(static_cast<int>(c), static_cast<int>(f), seen.marker);
      });
    }
    std::erase_if(views, [](const View& view) { return view.observations.empty(); });
  }
  const Known without = KnownFrom(rest, shape);

  const ExclusionPreview preview =
      PreviewExclusion(known.rig, shape, [&](const BundleObservation& each) {
        return leaves_out(each.camera, each.frame, each.seen.marker);
      });
  EXPECT_NEAR(preview.rms_before, RmsOf(known.record), 1e-4);
  EXPECT_NEAR(preview.rms_after, RmsOf(without.record), 2e-3);
  EXPECT_GT(preview.sigma_after, 1.05 * preview.sigma_before);
  // The factors of the calibration without the points are other estimates.
  const ExclusionPreview nothing =
      PreviewExclusion(without.rig, shape, [](const BundleObservation&) { return false; });
  EXPECT_NEAR(preview.sigma_after / nothing.sigma_before, 1, 0.15);
  EXPECT_EQ(nothing.points, 0u);
  EXPECT_NEAR(nothing.sigmas, 0, 1e-9);
  EXPECT_EQ(nothing.rms_after, nothing.rms_before);

  double most = 0;
  for (size_t c = 0; c < known.record.cameras.size(); ++c) {
    const CalibratedCamera& camera = known.record.cameras[c];
    for (size_t k = 0; k < camera.params.size(); ++k) {
      if (!(camera.Sigma(k) > 0)) continue;
      const double change = without.record.cameras[c].params[k] - camera.params[k];
      most = std::max(most, std::abs(change) / camera.Sigma(k));
    }
  }
  EXPECT_GT(most, 0.2);
  // Extrinsics may change more.
  EXPECT_GT(preview.sigmas, 0.8 * most);
  EXPECT_LT(preview.sigmas, 3 * most);
}

}  // namespace TEST_FILE
}  // namespace plenocal::testing
