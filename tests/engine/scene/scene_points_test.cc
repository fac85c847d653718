// SPDX-License-Identifier: Apache-2.0
//
// Points of a pair at the limits of parallax and residuals, poses at those of their numbers.
#include <gmock/gmock.h>

#include <cmath>
#include <limits>
#include <numbers>

#include "calib/adjust/poses.h"
#include "calib/camera/rays.h"
#include "calib/space/point_fit.h"
#include "engine/scene/scene_start.h"
#include "engine/scene/scene_tracks.h"
#include "models/registry.h"
#include "tests/calib/random.h"

namespace plenocal::testing {
namespace TEST_FILE {

using ::testing::ElementsAre;

constexpr double kFocal = 500, kBase = 0.2;  // px, m

BundleCamera Camera(double x) {
  BundleCamera camera{.name = "c",
                      .image_size = {800, 600},
                      .model = FindModel(CameraModels(), "pinhole"),
                      .config = {},
                      .params = {kFocal, kFocal, 400, 300},
                      .fixed = std::vector<bool>(4, true),
                      .T_camera_rig = {Eigen::Matrix3d::Identity(), {-x, 0, 0}}};
  camera.is_master = true;
  return camera;
}

// Exact observations of points by a pair in frames with these poses.
Bundle Exact(const std::vector<Eigen::Vector3d>& points, const std::vector<RigidTransform>& poses) {
  Bundle bundle;
  bundle.cameras = {Camera(0), Camera(kBase)};
  bundle.T_rig_target = poses;
  for (size_t m = 0; m < points.size(); ++m) {
    bundle.markers.push_back(
        {.number = static_cast<int>(m), .position = points[m], .nominal = points[m]});
  }
  for (int frame = 0; frame < static_cast<int>(poses.size()); ++frame) {
    for (int c = 0; c < 2; ++c) {
      for (int m = 0; m < static_cast<int>(points.size()); ++m) {
        const Eigen::Vector3d p =
            bundle.cameras[static_cast<size_t>(c)].T_camera_rig *
            (poses[static_cast<size_t>(frame)] * points[static_cast<size_t>(m)]);
        BundleObservation seen{.camera = c, .frame = frame, .marker = m, .seen = {}};
        seen.seen.values[0] = 400 + kFocal * p.x() / p.z();
        seen.seen.values[1] = 300 + kFocal * p.y() / p.z();
        bundle.observations.push_back(seen);
      }
    }
  }
  return bundle;
}

TEST(SceneResiduals, AreLengthsInTheImage) {
  Bundle bundle = Exact({{0.1, 0.2, 2}}, {{}});
  BundleObservation& seen = bundle.observations[1];
  EXPECT_NEAR(ResidualLength(bundle, seen), 0, 1e-9);
  seen.seen.values[0] += 3;
  seen.seen.values[1] -= 4;
  EXPECT_NEAR(ResidualLength(bundle, seen), 5, 1e-9);
  bundle.T_rig_target[0].t.z() = -5;
  EXPECT_EQ(ResidualLength(bundle, seen), std::numeric_limits<double>::infinity());
}

TEST(SceneResiduals, TheLimitIsThatOfUsedOnesWithPoseAndPoint) {
  Bundle bundle = Exact({{0, 0, 2}, {0.1, 0, 2}, {0.2, 0, 2}}, {{}, {}});
  SceneState state = MakeSceneState(&bundle);
  EXPECT_EQ(ResidualLimit(state), 0);
  // Three good lengths 1, 2, 4; larger ones without a pose, a point or use.
  for (BundleObservation& seen : bundle.observations) {
    const bool good = seen.frame == 1 && seen.marker < 2;
    seen.seen.values[0] += good ? 1 << (2 * seen.camera + seen.marker) : 100;
    if (good && seen.camera == 1 && seen.marker == 1) seen.used = false;
  }
  state.has_pose = {false, true};
  state.has_point = {true, true, false};
  // 3.3 sigmas, half of a Gaussian's deviations are below 0.6745 of them.
  EXPECT_NEAR(ResidualLimit(state), 3.3 / 0.67448975 * 2, 1e-6);
}

bool IsPlaced(Bundle bundle, double limit, double least_parallax) {
  SceneState state = MakeSceneState(&bundle);
  state.least_parallax = least_parallax;
  state.has_pose.assign(bundle.T_rig_target.size(), true);
  const Eigen::Vector3d truth = bundle.markers[0].position;
  bundle.markers[0].position = {7, 8, 9};
  Triangulate(0, limit, &state);
  EXPECT_LT(
      (bundle.markers[0].position - (state.has_point[0] ? truth : Eigen::Vector3d(7, 8, 9))).norm(),
      state.has_point[0] ? 0.05 : 1e-15);
  return state.has_point[0];
}

TEST(ScenePoints, NeedTheLeastParallax) {
  for (const double least : {1.0 / 60, 1.0 / 200}) {
    const double z = kBase / least;
    EXPECT_TRUE(IsPlaced(Exact({{kBase / 2, 0, 0.99 * z}}, {{}}), 0.1, least));
    EXPECT_FALSE(IsPlaced(Exact({{kBase / 2, 0, 1.01 * z}}, {{}}), 0.1, least));
  }
}

TEST(ScenePoints, AgreeWithAllObservationsUpToTheLimit) {
  for (const double up : {1.96, 2.04}) {
    Bundle bundle = Exact({{kBase / 2, 0, 2}}, {{}});
    bundle.observations[1].seen.values[1] += up;  // half of it in each image
    EXPECT_EQ(IsPlaced(bundle, 1, 1.0 / 60), up < 2);
  }
}

TEST(ScenePoints, LieBeforeTheCameras) {
  Bundle bundle = Exact({{kBase / 2, 0, 2}}, {{}});
  std::swap(bundle.observations[0].seen.values, bundle.observations[1].seen.values);
  EXPECT_FALSE(IsPlaced(bundle, 1e9, 1.0 / 60));
}

TEST(ScenePoints, OfOneCameraAreMeasuredFromTheFirstFrameThatHasAPose) {
  const RigidTransform moved{ExpRotation({0, 0.1, 0}), {-0.3, 0.1, 0.05}};
  Bundle bundle = Exact({{0.1, 0.2, 2}}, {{}, moved, moved});
  std::erase_if(bundle.observations,
                [](const BundleObservation& seen) { return seen.camera == 1; });
  const Eigen::Vector3d truth = bundle.markers[0].position;
  // Frames 1 and 2 have no parallax; frame 0 counts once it has a pose.
  for (const bool has_first : {false, true}) {
    SceneState state = MakeSceneState(&bundle);
    state.has_pose = {has_first, true, true};
    bundle.markers[0].position.setZero();
    Triangulate(2, 0.1, &state);
    EXPECT_EQ(state.has_point[0], has_first);
    if (has_first) {
      EXPECT_LT((bundle.markers[0].position - truth).norm(), 1e-6);
    }
  }
  SceneState state = MakeSceneState(&bundle);
  state.has_pose = {true, true, true};
  Triangulate(0, 0.1, &state);
  EXPECT_FALSE(state.has_point[0]);
}

// So that robust sigmas are not those of rounding.
void AddNoise(Bundle* bundle) {
  Random random(9);
  for (BundleObservation& seen : bundle->observations) {
    for (size_t k = 0; k < 2; ++k) seen.seen.values[k] += random.Gaussian(0.01);
  }
}

std::vector<Eigen::Vector3d> Cloud(int count) {
  Random random(6);
  std::vector<Eigen::Vector3d> points;
  for (int k = 0; k < count; ++k) {
    points.emplace_back(random.Uniform(-1, 1), random.Uniform(-0.7, 0.7), random.Uniform(2, 4));
  }
  return points;
}

const RigidTransform kMoved{ExpRotation({0.02, -0.05, 0.03}), {-0.1, 0.05, 0.1}};

// The pose of frame 0, whose first `wrong` points are elsewhere in both images.
std::optional<PoseSearch> Search(int count,
                                 int wrong,
                                 std::optional<double> limit = {},
                                 size_t fewest = kFewestAgreeing) {
  Bundle bundle = Exact(Cloud(count), {kMoved});
  AddNoise(&bundle);
  Random random(8);
  for (BundleObservation& seen : bundle.observations) {
    if (seen.marker >= wrong) continue;
    seen.seen.values[0] = random.Uniform(0, 800);
    seen.seen.values[1] = random.Uniform(0, 600);
  }
  bundle.T_rig_target[0] = {};
  SceneState state = MakeSceneState(&bundle);
  state.has_point.assign(bundle.markers.size(), true);
  std::optional<PoseSearch> found = FindPose(state, 0, limit, fewest);
  EXPECT_EQ(bundle.T_rig_target[0].t.norm(), 0);
  if (found) {
    EXPECT_LT((found->T_rig_target.t - kMoved.t).norm(), 1e-3);
    EXPECT_LT(LogRotation(found->T_rig_target.R * kMoved.R.transpose()).norm(), 1e-3);
    EXPECT_EQ(found->candidates, static_cast<size_t>(count));
  }
  return found;
}

TEST(ScenePoses, AreThoseOfTheMajority) {
  const auto found = Search(20, 6);
  ASSERT_TRUE(found);
  EXPECT_GE(found->inliers, 12U);
  EXPECT_LE(found->inliers, 14U);
}

TEST(ScenePoses, NeedEightLandmarks) {
  EXPECT_TRUE(Search(8, 0));
  EXPECT_FALSE(Search(7, 0));
}

TEST(ScenePoses, WithALimitAreThoseOfTheMostThatAgree) {
  const auto found = Search(40, 25, 2.0);
  ASSERT_TRUE(found);
  EXPECT_EQ(found->inliers, 15U);
  EXPECT_NEAR(found->sigma, 2.0 / 3.3, 1e-12);
  EXPECT_TRUE(Search(40, 28, 2.0));
  EXPECT_TRUE(Search(40, 25, 2.0, 15));
  EXPECT_FALSE(Search(40, 25, 2.0, 16));
}

// By all that agree, not by three: at the optimum of all residuals.
TEST(ScenePoses, AreRefinedByAllThatAgree) {
  Bundle bundle = Exact(Cloud(40), {kMoved});
  Random random(9);
  for (BundleObservation& seen : bundle.observations) {
    for (size_t k = 0; k < 2; ++k) seen.seen.values[k] += random.Gaussian(0.5);
  }
  Bundle best = bundle;
  for (int k = 0; k < 5; ++k) AdjustPose(0, best.observations.size(), &best);
  const RigidTransform& optimum = best.T_rig_target[0];
  bundle.T_rig_target[0] = {};
  SceneState state = MakeSceneState(&bundle);
  state.has_point.assign(40, true);
  for (const std::optional<double> limit : {std::optional<double>(), std::optional(4.0)}) {
    const std::optional<PoseSearch> found = FindPose(state, 0, limit);
    ASSERT_TRUE(found);
    // Within a standard error: of 80 residuals one may be taken for an outlier.
    EXPECT_LT((found->T_rig_target.t - optimum.t).norm(), 8e-4);
    EXPECT_LT(LogRotation(found->T_rig_target.R * optimum.R.transpose()).norm(), 4e-4);
    EXPECT_EQ(found->inliers, 40U);
    if (!limit) {
      EXPECT_NEAR(found->sigma, 0.5, 0.1);
    }
  }
}

TEST(ScenePoses, AgreeWithPointsInAllOfTheirObservations) {
  Bundle bundle = Exact(Cloud(20), {kMoved});
  AddNoise(&bundle);
  for (BundleObservation& seen : bundle.observations) {
    if (seen.camera == static_cast<int>(seen.marker % 2) && seen.marker < 5) {
      seen.seen.values[0] += 40;
    }
  }
  SceneState state = MakeSceneState(&bundle);
  state.has_point.assign(20, true);
  const std::optional<PoseSearch> found = FindPose(state, 0, 1.0);
  ASSERT_TRUE(found);
  EXPECT_EQ(found->inliers, 15U);
  EXPECT_EQ(found->candidates, 20U);
}

// Beyond 76 degrees from the axis a direction starts no pose.
TEST(ScenePoses, StartFromDirectionsBeforeTheCamera) {
  for (const double angle : {75.5, 76.5}) {
    Bundle bundle;
    BundleCamera& camera = bundle.cameras.emplace_back();
    camera.model = FindModel(CameraModels(), "equidistant");
    ASSERT_NE(camera.model, nullptr);
    camera.params.assign(camera.model->params.size(), 0);
    camera.params[0] = camera.params[1] = 200;
    camera.params[2] = camera.params[3] = 500;
    camera.fixed.assign(camera.params.size(), true);
    bundle.T_rig_target.resize(1);
    Random random(3);
    for (int m = 0; m < 8; ++m) {
      const double theta = (m == 0 ? angle : random.Uniform(10, 60)) * std::numbers::pi / 180;
      const double around = random.Uniform(0, 6);
      const Eigen::Vector3d p =
          random.Uniform(2, 4) * Eigen::Vector3d(std::sin(theta) * std::cos(around),
                                                 std::sin(theta) * std::sin(around),
                                                 std::cos(theta));
      bundle.markers.push_back({.number = m, .position = p, .nominal = p});
      double u[kMaxObservationSize] = {};
      const double values[kMaxObservationSize] = {};
      ASSERT_TRUE(Project(camera, values, p, u));
      BundleObservation seen{.marker = m, .seen = {}};
      seen.seen.values = {u[0] + random.Gaussian(0.01), u[1] + random.Gaussian(0.01)};
      bundle.observations.push_back(seen);
    }
    SceneState state = MakeSceneState(&bundle);
    state.has_point.assign(8, true);
    EXPECT_EQ(FindPose(state, 0).has_value(), angle < 76) << angle;
  }
}

// Frame 1 shows ten known points, five in each camera, and others that frame 2 places.
TEST(ScenePoses, ThatWereNotFoundAreTriedAgainAfterOthers) {
  const std::vector<Eigen::Vector3d> points = Cloud(50);
  const RigidTransform step{ExpRotation({0, 0, 0.02}), {0.05, 0, 0}};
  for (const bool places : {true, false}) {
    Bundle bundle = Exact(points, {{}, kMoved, step});
    AddNoise(&bundle);
    std::erase_if(bundle.observations, [&](const BundleObservation& seen) {
      if (seen.frame == 0) return seen.marker >= 19;
      if (seen.frame == 2) return seen.marker < 10;
      if (seen.marker < 10) return seen.camera != static_cast<int>(seen.marker % 2);
      return seen.marker < 19 || !places;
    });
    bundle.T_rig_target.assign(3, {});
    SceneState state = MakeSceneState(&bundle);
    state.has_pose[0] = true;
    for (size_t m = 0; m < 19; ++m) state.has_point[m] = true;
    std::vector<size_t> counts;
    EXPECT_EQ(FollowByOverlap([&](size_t count) { counts.push_back(count); }, &state),
              places ? 3U : 2U);
    EXPECT_EQ(counts, places ? (std::vector<size_t>{2, 3}) : std::vector<size_t>{2});
    EXPECT_THAT(state.has_pose, ElementsAre(true, places, true));
    if (places) {
      EXPECT_LT((bundle.T_rig_target[1].t - kMoved.t).norm(), 1e-3);
    }
  }
}

TEST(ScenePoses, FollowTheFrameWithMostKnownPointsFirst) {
  // Frame 0 shows points 0 to 19; of frames 1 and 2 one shows 12 to 31, the other 4 to 23; frame 3
  // shows seven of the first.
  const std::vector<Eigen::Vector3d> points = Cloud(32);
  const RigidTransform step{ExpRotation({0, 0, 0.02}), {0.05, 0, 0}};
  const std::vector<RigidTransform> poses{{}, step, step * step, kMoved};
  for (const size_t most : {1U, 2U}) {
    Bundle bundle = Exact(points, poses);
    AddNoise(&bundle);
    std::erase_if(bundle.observations, [&](const BundleObservation& seen) {
      const int first[] = {0, most == 1 ? 4 : 12, most == 2 ? 4 : 12, 0};
      const int last[] = {19, most == 1 ? 23 : 31, most == 2 ? 23 : 31, 6};
      return seen.marker < first[seen.frame] || seen.marker > last[seen.frame];
    });
    bundle.T_rig_target.assign(4, {});
    SceneState state = MakeSceneState(&bundle);
    state.has_pose[0] = true;
    for (size_t m = 0; m < 20; ++m) state.has_point[m] = true;
    std::vector<size_t> counts;
    std::vector<bool> after_first;
    const size_t posed = FollowByOverlap(
        [&](size_t count) {
          counts.push_back(count);
          if (counts.size() == 1) after_first = state.has_pose;
        },
        &state);
    EXPECT_EQ(posed, 3U);
    EXPECT_THAT(counts, ElementsAre(2, 3));
    EXPECT_THAT(after_first, ElementsAre(true, most == 1, most == 2, false));
    EXPECT_THAT(state.has_pose, ElementsAre(true, true, true, false));
    EXPECT_LT((bundle.T_rig_target[1].t - poses[1].t).norm(), 1e-3);
    KeepStarted(state, &bundle);
    for (const BundleObservation& seen : bundle.observations) {
      EXPECT_NE(seen.frame, 3);
      EXPECT_TRUE(state.has_point[static_cast<size_t>(seen.marker)]);
    }
    EXPECT_GE(bundle.observations.size(), 100U);
  }
}

TEST(ScenePoses, LimitTheResidualsOfPointsByTheirSigma) {
  Bundle bundle = Exact(Cloud(20), {{}, kMoved});
  AddNoise(&bundle);
  bundle.T_rig_target[1] = {};
  SceneState state = MakeSceneState(&bundle);
  state.has_point.assign(20, true);
  state.has_pose = {true, false};
  const std::optional<PoseSearch> found = FindPose(state, 1);
  ASSERT_TRUE(found);
  EXPECT_NEAR(FollowFrames({1}, &state), 3.3 * found->sigma, 1e-12);
  EXPECT_LT((bundle.T_rig_target[1].t - kMoved.t).norm(), 1e-3);
}

// A plenoptic camera sees distances by itself: its rays through several micro lenses meet. Exact
// observations in one frame of this pose; each point through four lenses.
Bundle Plenoptic(const std::vector<Eigen::Vector3d>& points, const RigidTransform& pose = {}) {
  Bundle bundle;
  BundleCamera& camera = bundle.cameras.emplace_back();
  camera.model = FindModel(CameraModels(), "focused-plenoptic");
  camera.config = {5e-6};
  camera.params = {0.016, 0.0155, 0.0005, 500, 500, 0, 0, 0, 0};
  camera.fixed.assign(9, true);
  bundle.T_rig_target = {pose};
  for (const Eigen::Vector3d& point : points) {
    const int m = static_cast<int>(bundle.markers.size());
    const Eigen::Vector3d p = pose * point;
    bundle.markers.push_back({.number = m, .position = point, .nominal = point});
    for (int lens = 0; lens < 4; ++lens) {
      BundleObservation seen{.frame = 0, .marker = m, .seen = {}};
      seen.seen.values[2] = 500 + 3200 * p.x() / p.z() + 40 * (lens % 2) - 20;
      seen.seen.values[3] = 500 + 3200 * p.y() / p.z() + 40 * (lens / 2) - 10;
      double u[kMaxObservationSize];
      EXPECT_TRUE(Project(camera, seen.seen.values.data(), p, u));
      seen.seen.values[0] = u[0];
      seen.seen.values[1] = u[1];
      bundle.observations.push_back(seen);
    }
  }
  return bundle;
}

TEST(ScenePoints, OfAPlenopticViewNeedAsMuchSpreadOfTheirRaysAsTheirNoiseAllows) {
  const RigidTransform pose{ExpRotation({0.1, 0.2, -0.1}), {0.02, -0.01, 0.1}};
  const Eigen::Vector3d point(0.02, 0.01, 0.5);
  Bundle bundle = Plenoptic({point}, pose);
  std::vector<Ray> rays;
  for (const BundleObservation& seen : bundle.observations) {
    rays.push_back(Unproject(bundle.cameras[0], seen.seen.values.data()).value());
  }
  BundleObservation beside = bundle.observations[0];
  beside.seen.values[0] += 1;
  const Ray moved = Unproject(bundle.cameras[0], beside.seen.values.data()).value();
  const double by_px =
      std::asin(rays[0].direction.normalized().cross(moved.direction.normalized()).norm());
  // Ten standard errors of the distance.
  const double largest = std::sqrt(NearestToRays(rays).value().spread) / (10 * by_px);
  bundle.markers[0].position.setZero();
  for (const double factor : {0.97, 1.03}) {
    for (BundleObservation& seen : bundle.observations) seen.assumed_sigma = factor * largest;
    SceneState state = MakeSceneState(&bundle);
    state.has_pose = {true};
    Triangulate(0, 0.1, &state);
    EXPECT_EQ(state.has_point[0], factor < 1);
    if (factor < 1) {
      EXPECT_LT((bundle.markers[0].position - point).norm(), 1e-6);
    }
    bundle.markers[0].position.setZero();
  }
  // No more than the parallax of two frames.
  for (BundleObservation& seen : bundle.observations) seen.assumed_sigma = 1000 * largest;
  for (const double factor : {1.9, 2.1}) {
    SceneState state = MakeSceneState(&bundle);
    state.has_pose = {true};
    state.least_parallax = factor * std::sqrt(NearestToRays(rays).value().spread);
    Triangulate(0, 0.1, &state);
    EXPECT_EQ(state.has_point[0], factor < 2);
  }
}

TEST(ScenePoses, OfAPlenopticCameraAreFoundByWhereItsRaysMeet) {
  Random random(6);
  std::vector<Eigen::Vector3d> points;
  for (int k = 0; k < 12; ++k) {
    points.emplace_back(
        random.Uniform(-0.05, 0.05), random.Uniform(-0.05, 0.05), random.Uniform(0.4, 0.7));
  }
  const RigidTransform pose{ExpRotation({0.05, -0.1, 0.2}), {0.01, -0.02, 0.05}};
  Bundle bundle = Plenoptic(points, pose);
  for (BundleObservation& seen : bundle.observations) {
    for (size_t k = 0; k < 2; ++k) seen.seen.values[k] += random.Gaussian(0.005);
  }
  bundle.T_rig_target[0] = {};
  SceneState state = MakeSceneState(&bundle);
  state.has_point.assign(points.size(), true);
  const std::optional<PoseSearch> found = FindPose(state, 0);
  ASSERT_TRUE(found);
  EXPECT_EQ(found->candidates, points.size());
  EXPECT_LT((found->T_rig_target.t - pose.t).norm(), 2e-3);
  EXPECT_LT(LogRotation(found->T_rig_target.R * pose.R.transpose()).norm(), 3e-3);
}

TEST(SceneScaleOwn, IsThatOfThePlacesWhereRaysOfSingleViewsMeet) {
  constexpr double kFactor = 2.5;
  Bundle bundle = Plenoptic({{0, 0.005, 0.4}, {0.01, 0.005, 0.5}, {0.02, 0.005, 0.6}});
  bundle.T_rig_target.emplace_back();
  for (BundleMarker& marker : bundle.markers) marker.position *= kFactor;
  SceneState state = MakeSceneState(&bundle);
  state.has_point.assign(3, true);
  EXPECT_FALSE(ScaleByOwnDistances(state));
  state.has_pose[0] = true;
  EXPECT_NEAR(ScaleByOwnDistances(state).value(), 1 / kFactor, 1e-6);
  // The median of three.
  bundle.markers[2].position *= 10;
  EXPECT_NEAR(ScaleByOwnDistances(state).value(), 1 / kFactor, 1e-6);
  bundle.markers[1].position *= 10;
  EXPECT_NEAR(ScaleByOwnDistances(state).value(), 0.1 / kFactor, 1e-7);
  state.has_point = {false, false, true};
  EXPECT_NEAR(ScaleByOwnDistances(state).value(), 0.1 / kFactor, 1e-7);
  // Two rays suffice.
  bundle.observations.resize(10);
  EXPECT_NEAR(ScaleByOwnDistances(state).value(), 0.1 / kFactor, 1e-7);
  bundle.markers[2].position.z() *= -1;
  EXPECT_FALSE(ScaleByOwnDistances(state));
  Bundle pair = Exact({{0, 0, 2}}, {{}});
  SceneState ordinary = MakeSceneState(&pair);
  ordinary.has_pose = {true};
  ordinary.has_point = {true};
  EXPECT_FALSE(ScaleByOwnDistances(ordinary));
}

}  // namespace TEST_FILE
}  // namespace plenocal::testing
