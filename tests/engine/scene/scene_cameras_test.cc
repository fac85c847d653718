// SPDX-License-Identifier: Apache-2.0
//
// Scenes of ordinary cameras of unknown focal length or unknown extrinsics, and of plenoptic ones.
#include <gmock/gmock.h>

#include <algorithm>
#include <cmath>

#include "calib/adjust/bundle.h"
#include "calib/camera/rays.h"
#include "engine/scene/scene_calibration.h"
#include "models/registry.h"
#include "tests/calib/random.h"
#include "tests/refusal.h"

namespace plenocal::testing {
namespace TEST_FILE {

constexpr double kFocal = 500, kNoise = 0.05;  // px
constexpr int kPoints = 24, kFrames = 3;       // the fewest
const std::vector<double> kPlenoptic{0.016, 0.0155, 0.0005, 500, 500, 0, 0, 0, 0};

// A scene of 0.4 m, seen from 0.6 m.
struct MadeScene {
  SceneCalibrationInput input{.cameras = {}, .distances = {}};
  std::vector<Eigen::Vector3d> points;
  std::vector<RigidTransform> T_camera_rig;
  Random random{7};

  MadeScene() {
    for (int k = 0; k < kPoints; ++k) points.push_back(random.Uniforms<3>(-0.2, 0.2));
  }

  static RigidTransform PoseOf(int frame) {
    const double angle = 0.2 * frame;
    return {ExpRotation({0.3 * std::sin(3 * angle), angle, 0.2 * angle}),
            {0.03 - 0.03 * frame, 0.02 * std::sin(2.0 * frame), 0.6 + 0.03 * frame}};
  }

  CameraInput& Add(const char* model,
                   const RigidTransform& T,
                   const std::vector<double>& params,
                   bool known,
                   std::optional<RigidTransform> T_known) {
    T_camera_rig.push_back(T);
    CameraInput& camera = input.cameras.inputs.emplace_back();
    camera.name = "c" + std::to_string(T_camera_rig.size());
    camera.model = FindModel(CameraModels(), model);
    camera.image_size = {1000, 1000};
    if (camera.model->plenoptic) camera.config = {5e-6};
    camera.initial.assign(params.begin(), params.end());
    camera.fixed.assign(params.size(), known);
    BundleCamera truth;
    truth.model = camera.model;
    truth.config = camera.config;
    truth.params = params;
    for (int frame = 0; frame < kFrames; ++frame) {
      View& view = camera.views.emplace_back();
      view.frame = std::to_string(frame);
      for (int k = 0; k < kPoints; ++k) {
        const Eigen::Vector3d p = T * (PoseOf(frame) * points[static_cast<size_t>(k)]);
        AddPoint(truth, k, p, &view);
      }
    }
    input.cameras.T_camera_rig.push_back(T_known);
    input.cameras.fixed_extrinsics.push_back(T_known.has_value());
    input.cameras.without_sigmas.push_back(false);
    return camera;
  }

  // In an ordinary camera once, in a plenoptic one through four micro lenses beside its image.
  void AddPoint(const BundleCamera& camera, int number, const Eigen::Vector3d& p, View* view) {
    for (int lens = 0; lens < (camera.model->plenoptic ? 4 : 1); ++lens) {
      Observation seen{.marker = number, .detector_sigma = kNoise};
      const double f = (kPlenoptic[1] + kPlenoptic[2]) / 5e-6;
      seen.values[2] = 500 + f * p.x() / p.z() + (lens % 2 == 0 ? -20 : 20);
      seen.values[3] = 500 + f * p.y() / p.z() + (lens / 2 == 0 ? -20 : 20);
      double u[kMaxObservationSize];
      if (!Project(camera, seen.values.data(), p, u)) continue;
      seen.values[0] = u[0] + random.Gaussian(kNoise);
      seen.values[1] = u[1] + random.Gaussian(kNoise);
      view->observations.push_back(seen);
    }
  }

  // The start is so good that this many iterations suffice; from another scale it takes more.
  [[nodiscard]] Calibration Calibrate(int iterations) const {
    Calibration found = CalibrateScene(input, {});
    EXPECT_TRUE(found.converged);
    EXPECT_LE(found.iterations, iterations);
    return found;
  }

  // Distances of the points over the true ones, as a median.
  [[nodiscard]] double Scale(const Calibration& found) const {
    std::vector<double> ratios;
    const std::vector<BundleMarker>& markers = found.bundle.markers;
    for (size_t k = 1; k < markers.size(); ++k) {
      const auto truth = [&](size_t m) { return points[static_cast<size_t>(markers[m].number)]; };
      ratios.push_back((markers[k].position - markers[0].position).norm() /
                       (truth(k) - truth(0)).norm());
    }
    std::ranges::nth_element(ratios, ratios.begin() + std::ssize(ratios) / 2);
    return ratios[ratios.size() / 2];
  }

  // All points at this scale.
  void ExpectShape(const Calibration& found, double within) const {
    const double scale = Scale(found);
    const std::vector<BundleMarker>& markers = found.bundle.markers;
    EXPECT_EQ(markers.size(), points.size());
    for (size_t k = 1; k < markers.size(); ++k) {
      const double truth = (points[static_cast<size_t>(markers[k].number)] -
                            points[static_cast<size_t>(markers[0].number)])
                               .norm();
      EXPECT_NEAR(
          (markers[k].position - markers[0].position).norm(), scale * truth, within * scale);
    }
  }
};

const std::vector<double> kPinhole{kFocal, kFocal, 500, 500};
const RigidTransform kRight{ExpRotation({0.01, 0.1, -0.02}), {-0.1, 0.01, 0.02}};
const RigidTransform kThird{ExpRotation({-0.02, 0.05, 0.03}), {0.08, -0.02, 0.01}};

TEST(SceneCameras, OfUnknownFocalLengthTakeTheOneThatFits) {
  constexpr double kTrue = 950;
  MadeScene made;
  CameraInput& camera = made.Add("pinhole", {}, {kTrue, kTrue, 500, 500}, true, {});
  camera.initial[0].reset();
  camera.initial[1].reset();
  camera.fixed[0] = camera.fixed[1] = false;
  const Calibration found = made.Calibrate(10);
  EXPECT_NEAR(found.bundle.cameras[0].params[0] / kTrue, 1, 0.02);
  EXPECT_NEAR(found.bundle.cameras[0].params[1] / kTrue, 1, 0.02);
  EXPECT_EQ(found.bundle.cameras[0].params[2], 500);
  EXPECT_EQ(found.frames.size(), static_cast<size_t>(kFrames));
  made.ExpectShape(found, 0.02);
}

// The first ordinary one starts alone, wherever it stands.
TEST(SceneCameras, StartWithAnOrdinaryOneWhereThereIsOne) {
  MadeScene made;
  made.Add("focused-plenoptic", {}, kPlenoptic, true, {});
  made.Add("pinhole", kRight, kPinhole, true, {});
  for (CameraInput& camera : made.input.cameras.inputs) camera.views.resize(2);
  EXPECT_THAT(Refusal([&] { CalibrateScene(made.input, {}); }),
              ::testing::StartsWith("job: c2: poses for 2 of 2 frames only"));
  made.input.cameras.inputs.pop_back();
  made.input.cameras.T_camera_rig.pop_back();
  EXPECT_THAT(Refusal([&] { CalibrateScene(made.input, {}); }),
              ::testing::StartsWith("job: c1: poses for 2 of 2 frames only"));
}

TEST(SceneCameras, HaveTheRulesOfTheirParameters) {
  MadeScene made;
  made.Add("pinhole", {}, kPinhole, true, RigidTransform{});
  CameraInput& right = made.Add("pinhole", kRight, kPinhole, true, kRight);
  right.initial[0] = 490;
  right.initial[1] = 520;
  right.fixed[0] = right.fixed[1] = false;
  right.rules.resize(4);
  right.rules[1].tied_to = ParamIndex{1, 0};
  const Calibration found = made.Calibrate(19);
  EXPECT_NEAR(found.bundle.cameras[1].params[0], kFocal, 2);
  EXPECT_EQ(found.bundle.cameras[1].params[0], found.bundle.cameras[1].params[1]);
}

TEST(SceneCameras, OfAKnownPairHaveTheirExtrinsicsInThePoints) {
  // The first camera has another frame than the rig's; the third is to be found.
  MadeScene made;
  made.Add("pinhole", {}, kPinhole, true, RigidTransform{});
  made.Add("pinhole", kRight, kPinhole, true, kRight);
  made.Add("pinhole", kThird, kPinhole, true, {});
  const Calibration found = made.Calibrate(12);
  EXPECT_NEAR(made.Scale(found), 1, 1e-2);
  made.ExpectShape(found, 0.01);
  EXPECT_EQ(found.bundle.cameras[1].T_camera_rig.t, kRight.t);
  EXPECT_TRUE(found.bundle.cameras[0].is_master);
  EXPECT_TRUE(found.bundle.cameras[1].is_master);
  EXPECT_FALSE(found.bundle.cameras[2].is_master);
  EXPECT_LT((found.bundle.cameras[2].T_camera_rig.t - kThird.t).norm(), 5e-3);
  EXPECT_LT(LogRotation(found.bundle.cameras[2].T_camera_rig.R * kThird.R.transpose()).norm(),
            5e-3);
  ASSERT_EQ(found.fits.size(), 3U);
  EXPECT_EQ(found.fits[0].detector_sigma, kNoise);
}

TEST(SceneCameras, WhoseDetectorsStateNoSigmaHaveTheOneOfTheirResiduals) {
  MadeScene made;
  made.Add("pinhole", {}, kPinhole, true, RigidTransform{});
  made.Add("pinhole", kRight, kPinhole, true, kRight);
  for (View& view : made.input.cameras.inputs[1].views) {
    for (Observation& seen : view.observations) seen.detector_sigma = 0;
  }
  const Calibration found = made.Calibrate(17);
  EXPECT_EQ(found.fits[0].detector_sigma, kNoise);
  EXPECT_EQ(found.fits[1].detector_sigma, 0);
  EXPECT_NEAR(found.fits[1].noise_sigma, kNoise, 0.5 * kNoise);
}

TEST(SceneCameras, AfterAnUnknownOneOfAKnownPairAreInTheRigsFrame) {
  MadeScene made;
  made.Add("pinhole", {}, kPinhole, true, {});
  made.Add("pinhole", kRight, kPinhole, true, kRight);
  // A rule of the whole session, which the pair's start does not follow.
  made.Add("pinhole", kThird, kPinhole, true, kThird).rules.resize(4);
  made.input.cameras.inputs[2].rules[1].tied_to = ParamIndex{2, 0};
  const Calibration found = made.Calibrate(14);
  EXPECT_NEAR(made.Scale(found), 1, 1e-2);
  EXPECT_LT((found.bundle.cameras[2].T_camera_rig.t - kThird.t).norm(), 1e-12);
  // Poses of the rig are those of its frame, not of the pair's first camera.
  const RigidTransform moved =
      found.bundle.T_rig_target[2] * found.bundle.T_rig_target[0].Inverse();
  const RigidTransform truth = MadeScene::PoseOf(2) * MadeScene::PoseOf(0).Inverse();
  EXPECT_LT((moved.t - truth.t).norm(), 5e-3);
  EXPECT_LT(LogRotation(moved.R * truth.R.transpose()).norm(), 5e-3);
}

TEST(SceneCameras, OfKnownExtrinsicsGiveTheScaleToOneThatStartsAlone) {
  MadeScene made;
  made.Add("pinhole", {}, kPinhole, true, {});
  CameraInput& right = made.Add("pinhole", kRight, kPinhole, true, kRight);
  right.initial[3].reset();  // not all is known
  right.fixed[3] = false;
  const Calibration found = made.Calibrate(24);
  EXPECT_NEAR(made.Scale(found), 1, 0.02);
  EXPECT_FALSE(found.bundle.scale_distance);
  EXPECT_LT((found.bundle.cameras[1].T_camera_rig.t - kRight.t).norm(), 1e-12);
  EXPECT_NEAR(found.bundle.cameras[1].params[3], 500, 2);
}

TEST(SceneCameras, OfKnownPlenopticOnesFollowAKnownPair) {
  MadeScene made;
  made.Add("pinhole", {}, kPinhole, true, RigidTransform{});
  made.Add("pinhole", kRight, kPinhole, true, kRight);
  made.Add("focused-plenoptic", kThird, kPlenoptic, true, kThird);
  const Calibration found = made.Calibrate(10);
  EXPECT_NEAR(made.Scale(found), 1, 1e-2);
  made.ExpectShape(found, 0.01);
  EXPECT_EQ(found.bundle.cameras[2].params, kPlenoptic);
  EXPECT_GT(found.fits[2].points, 4 * kPoints);
  EXPECT_LT(found.fits[2].noise_sigma, 2 * kNoise);
}

TEST(SceneCameras, OfAPlenopticOneHaveTheScaleOfItsSensorsDistance) {
  MadeScene made;
  CameraInput& camera = made.Add("focused-plenoptic", {}, kPlenoptic, true, {});
  // The virtual image determines b_L0 + B; lengths are up to the scale that B gives.
  camera.fixed[0] = false;
  const Calibration found = made.Calibrate(9);
  EXPECT_NEAR(made.Scale(found), 1, 0.05);
  EXPECT_NEAR(found.bundle.cameras[0].params[0], kPlenoptic[0], 1e-4);
  EXPECT_EQ(found.bundle.cameras[0].params[2], kPlenoptic[2]);
  made.ExpectShape(found, 0.02);
}

}  // namespace TEST_FILE
}  // namespace plenocal::testing
