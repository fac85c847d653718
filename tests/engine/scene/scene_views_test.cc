// SPDX-License-Identifier: Apache-2.0
//
// Scenes of one camera and of a pair from tracks, up to the scale of one.
#include "engine/scene/scene_views.h"

#include <gmock/gmock.h>

#include "models/registry.h"
#include "tests/calib/random.h"
#include "tests/refusal.h"

namespace plenocal::testing {
namespace TEST_FILE {

using ::testing::IsEmpty;

constexpr double kFocal = 500, kNoise = 0.05;  // px

BundleCamera Camera(const std::string& name, double x, double focal = kFocal) {
  BundleCamera camera{.name = name,
                      .image_size = {800, 600},
                      .model = FindModel(CameraModels(), "pinhole"),
                      .config = {},
                      .params = {focal, focal, 400, 300},
                      .fixed = std::vector<bool>(4, true),
                      .T_camera_rig = {Eigen::Matrix3d::Identity(), {-x, 0, 0}}};
  camera.is_master = true;
  return camera;
}

RigidTransform PoseOf(int frame) {
  return {ExpRotation({0.04 * frame, -0.1 * frame, 0.02 * frame}), {0.3 * frame, 0.05 * frame, 0}};
}

// Points 100, 101, ... of a cloud before the cameras, in frames a, b, ...
SceneTracks Tracks(const std::vector<BundleCamera>& cameras, int count, int frames) {
  Random random(3);
  SceneTracks tracks;
  std::vector<Eigen::Vector3d> points;
  for (int k = 0; k < count; ++k) {
    points.emplace_back(random.Uniform(-1, 1), random.Uniform(-1, 1), random.Uniform(2, 5));
  }
  for (int f = 0; f < frames; ++f)
    tracks.frames.push_back(std::string(1, static_cast<char>('a' + f)));
  for (const BundleCamera& camera : cameras) {
    std::vector<View>& views = tracks.views.emplace_back();
    for (int f = 0; f < frames; ++f) {
      View& view = views.emplace_back();
      view.frame = tracks.frames[static_cast<size_t>(f)];
      for (int k = 0; k < count; ++k) {
        const Eigen::Vector3d p =
            camera.T_camera_rig * (PoseOf(f) * points[static_cast<size_t>(k)]);
        Observation& seen = view.observations.emplace_back();
        seen.marker = 100 + k;
        seen.values = {400 + kFocal * p.x() / p.z() + random.Gaussian(kNoise),
                       300 + kFocal * p.y() / p.z() + random.Gaussian(kNoise)};
        seen.detector_sigma = kNoise;
      }
    }
  }
  return tracks;
}

// Rotations with respect to the first frame, and ratios of translations.
void ExpectPath(const ReconstructedScene& scene, double scale) {
  ASSERT_TRUE(scene.T_rig_target[0]);
  const RigidTransform first = scene.T_rig_target[0]->Inverse();
  for (size_t f = 1; f < scene.T_rig_target.size(); ++f) {
    ASSERT_TRUE(scene.T_rig_target[f]);
    const RigidTransform found = *scene.T_rig_target[f] * first;
    const RigidTransform truth = PoseOf(static_cast<int>(f));
    EXPECT_LT(LogRotation(found.R * truth.R.transpose()).norm(), 3e-3);
    EXPECT_LT((found.t - scale * truth.t).norm(), 0.02 * scale);
  }
}

TEST(SceneViews, OfOneCameraHaveNoScale) {
  const std::vector<BundleCamera> cameras{Camera("left", 0)};
  const ReconstructedScene scene = ReconstructScene(Tracks(cameras, 40, 3), cameras, {});
  EXPECT_EQ(scene.frames, 3U);
  EXPECT_GT(scene.points.size(), 35U);
  EXPECT_GE(scene.points.begin()->first, 100);
  ASSERT_TRUE(scene.T_rig_target[2] && scene.T_rig_target[0]);
  const double found = (*scene.T_rig_target[2] * scene.T_rig_target[0]->Inverse()).t.norm();
  ExpectPath(scene, found / PoseOf(2).t.norm());
  // The median length of two Gaussian coordinates is 1.18 sigmas.
  EXPECT_GT(scene.median_residual, 0.6 * kNoise);
  EXPECT_LT(scene.median_residual, 1.5 * kNoise);
}

TEST(SceneViews, OfAPairHaveItsScale) {
  const std::vector<BundleCamera> cameras{Camera("left", 0), Camera("right", 0.4)};
  SceneTracks tracks = Tracks(cameras, 30, 2);
  for (std::vector<View>& views : tracks.views) {
    for (View& view : views) {
      for (Observation& seen : view.observations) seen.detector_sigma = 10 * kNoise;
    }
  }
  const ReconstructedScene scene = ReconstructScene(tracks, cameras, {});
  EXPECT_EQ(scene.frames, 2U);
  ExpectPath(scene, 1);
  // In pixels, whatever the detector states.
  EXPECT_GT(scene.median_residual, 0.6 * kNoise);
  EXPECT_LT(scene.median_residual, 1.5 * kNoise);
}

TEST(SceneViews, NeedTwentyPointsInCommon) {
  const std::vector<BundleCamera> cameras{Camera("left", 0)};
  EXPECT_EQ(Refusal([&] { ReconstructScene(Tracks(cameras, 19, 2), cameras, {}); }),
            "job: left: no two frames with 20 points in common between which the camera moved; "
            "record frames that overlap more, or give a calibrated pair ('from')");
  EXPECT_EQ(Refusal([&] { ReconstructScene(Tracks(cameras, 20, 2), cameras, {}); }), "");
}

// The two frames with most parallax start; turns are none. Their first frame is the scene's.
TEST(SceneViews, StartWithTheFramesThatAreFarthestApart) {
  const std::vector<BundleCamera> cameras{Camera("left", 0)};
  struct Place {
    double x = 0, turn = 0;
  };
  for (const auto& [places, first] :
       {std::pair(std::vector<Place>{{0.05, 0.3}, {0, 0}, {0.25, 0}}, size_t{1}),
        {{{0, 0}, {0.2, 0.3}, {0.25, 0}}, 0},
        {{{0.25, 0}, {0.2, 0.3}, {0.01, 0.1}, {0, 0}}, 0}}) {
    Random random(3);
    SceneTracks tracks{.frames = {}, .times = {}, .views = {{}}};
    for (size_t f = 0; f < places.size(); ++f) {
      tracks.frames.push_back(std::to_string(f));
      View& view = tracks.views[0].emplace_back();
      view.frame = tracks.frames.back();
      Random same(5);
      for (int k = 0; k < 30; ++k) {
        const Eigen::Vector3d point(same.Uniform(-1, 1), same.Uniform(-1, 1), same.Uniform(2.5, 5));
        const Eigen::Vector3d p =
            ExpRotation({0, places[f].turn, 0}) * (point - Eigen::Vector3d(places[f].x, 0, 0));
        Observation seen{.marker = k, .detector_sigma = kNoise};
        seen.values[0] = 400 + kFocal * p.x() / p.z() + random.Gaussian(kNoise);
        seen.values[1] = 300 + kFocal * p.y() / p.z() + random.Gaussian(kNoise);
        view.observations.push_back(seen);
      }
    }
    const ReconstructedScene scene = ReconstructScene(tracks, cameras, {});
    ASSERT_EQ(scene.frames, places.size());
    const RigidTransform& start = scene.T_rig_target[first].value();
    EXPECT_LT(LogRotation(start.R).norm(), 0.02);
    for (size_t f = 0; f < places.size(); ++f) {
      const RigidTransform turn = *scene.T_rig_target[f] * start.Inverse();
      EXPECT_NEAR(LogRotation(turn.R).y(), places[f].turn - places[first].turn, 0.01);
    }
  }
}

// Two more frames show points that no other does, without a motion between them.
TEST(SceneViews, MeasureResidualsOfFramesWithAPose) {
  const std::vector<BundleCamera> cameras{Camera("left", 0)};
  SceneTracks tracks = Tracks(cameras, 30, 3);
  View still = tracks.views[0][0];
  for (Observation& seen : still.observations) seen.marker += 1000;
  for (const char* frame : {"x", "y"}) {
    tracks.frames.emplace_back(frame);
    still.frame = frame;
    tracks.views[0].push_back(still);
  }
  const ReconstructedScene scene = ReconstructScene(tracks, cameras, {});
  EXPECT_EQ(scene.frames, 3U);
  EXPECT_FALSE(scene.T_rig_target[3]);
  EXPECT_LT(scene.points.rbegin()->first, 1000);
  EXPECT_LT(scene.median_residual, 1.5 * kNoise);
}

TEST(SceneViews, KeepToAPrior) {
  std::vector<BundleCamera> cameras{Camera("left", 0)};
  const SceneTracks tracks = Tracks(cameras, 30, 3);
  cameras[0].fixed[0] = false;
  CalibrationPrior prior;
  prior.unknowns = {{.camera = 0, .param = 0, .value = kFocal + 4}};
  prior.T_camera_rig = {{}};
  prior.weight = Eigen::MatrixXd::Constant(1, 1, 1e3);
  const ReconstructedScene scene = ReconstructScene(tracks, cameras, prior);
  EXPECT_NEAR(scene.cameras[0].params[0], kFocal + 4, 0.1);
}

TEST(SceneViews, ImproveAFocalLengthOnTheWay) {
  std::vector<BundleCamera> cameras{Camera("left", 0)};
  const SceneTracks tracks = Tracks(cameras, 40, 5);
  cameras = {Camera("left", 0, 530)};
  cameras[0].fixed = {false, false, true, true};
  const ReconstructedScene scene = ReconstructScene(tracks, cameras, {});
  EXPECT_NEAR(scene.cameras[0].params[0], kFocal, 5);
  EXPECT_NEAR(scene.cameras[0].params[1], kFocal, 5);
}

TEST(SceneViews, WithoutAStartStayAsTheyAre) {
  const std::vector<BundleCamera> cameras{Camera("left", 0), Camera("right", 0.4)};
  Bundle bundle = MakeSceneBundle(Tracks(cameras, 20, 2), cameras);
  SceneState state = MakeSceneState(&bundle);
  AdjustStarted(false, &state);
  for (const BundleMarker& marker : bundle.markers) EXPECT_EQ(marker.position.norm(), 0);
  SceneTracks empty{.frames = {}, .times = {}, .views = {{}, {}}};
  const ReconstructedScene scene = ReconstructScene(empty, cameras, {});
  EXPECT_EQ(scene.frames, 0U);
  EXPECT_THAT(scene.points, IsEmpty());
}

}  // namespace TEST_FILE
}  // namespace plenocal::testing
