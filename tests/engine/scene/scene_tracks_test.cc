// SPDX-License-Identifier: Apache-2.0
//
// Bundles of tracks, start values of cameras, and the distance that holds the scale.
#include "engine/scene/scene_tracks.h"

#include <gmock/gmock.h>

#include "engine/scene/scene_views.h"
#include "engine/scene/virtual_camera.h"
#include "models/registry.h"

namespace plenocal::testing {
namespace TEST_FILE {

using ::testing::ElementsAre;
using ::testing::IsEmpty;

Observation SeenAt(int marker, double x, double sigma = 0) {
  Observation seen;
  seen.marker = marker;
  seen.values[0] = x;
  seen.detector_sigma = sigma;
  return seen;
}

BundleCamera CameraOf(const char* model) {
  BundleCamera camera;
  camera.model = FindModel(CameraModels(), model);
  camera.params.assign(camera.model->params.size(), 1);
  camera.fixed.assign(camera.params.size(), false);
  return camera;
}

TEST(SceneTracks, PointsOfTwoViewsBecomeLandmarks) {
  SceneTracks tracks{.frames = {"b", "a"}, .times = {}, .views = {}};
  // 9 is seen twice in one view alone, 7 in two cameras, 3 in two frames, 5 once.
  tracks.views = {
      {{.frame = "a", .observations = {SeenAt(7, 1, 0.5), SeenAt(3, 2)}},
       {.frame = "b", .observations = {SeenAt(9, 3), SeenAt(9, 4), SeenAt(3, 5), SeenAt(5, 6)}}},
      {{.frame = "a", .observations = {SeenAt(7, 7)}}}};
  tracks.views[0][0].by_nuisance = {{0.1, 0.2}, {0.3, 0.4}};
  const Bundle bundle = MakeSceneBundle(tracks, {CameraOf("pinhole"), CameraOf("pinhole")});
  ASSERT_EQ(bundle.markers.size(), 2U);
  EXPECT_EQ(bundle.markers[0].number, 3);
  EXPECT_EQ(bundle.markers[1].number, 7);
  EXPECT_EQ(bundle.T_rig_target.size(), 2U);
  EXPECT_TRUE(bundle.HasLandmarks());
  EXPECT_EQ(bundle.cameras[0].nuisances.size(), 1U);
  EXPECT_THAT(bundle.cameras[1].nuisances, IsEmpty());
  struct Row {
    int frame, camera, marker;
    double x, sigma;
    std::vector<double> by;
  };
  const std::vector<Row> expected{{0, 0, 0, 5, 1, {}},
                                  {1, 0, 0, 2, 1, {0.3, 0.4}},
                                  {1, 0, 1, 1, 0.5, {0.1, 0.2}},
                                  {1, 1, 1, 7, 1, {}}};
  ASSERT_EQ(bundle.observations.size(), expected.size());
  for (size_t i = 0; i < expected.size(); ++i) {
    const BundleObservation& seen = bundle.observations[i];
    EXPECT_EQ(seen.frame, expected[i].frame) << i;
    EXPECT_EQ(seen.camera, expected[i].camera) << i;
    EXPECT_EQ(seen.marker, expected[i].marker) << i;
    EXPECT_EQ(seen.seen.values[0], expected[i].x) << i;
    EXPECT_EQ(seen.assumed_sigma, expected[i].sigma) << i;
    EXPECT_EQ(seen.by_nuisance, expected[i].by) << i;
  }
}

TEST(SceneTracks, ObservationsAreSortedByFrameThenCameraThenMarker) {
  Bundle bundle;
  for (const auto& [frame, camera, marker] :
       std::vector<std::array<int, 3>>{{1, 0, 0}, {0, 1, 0}, {0, 0, 2}, {0, 0, 1}, {0, 1, 0}}) {
    BundleObservation seen{.camera = camera, .frame = frame, .marker = marker, .seen = {}};
    seen.seen.values[0] = static_cast<double>(bundle.observations.size());
    bundle.observations.push_back(seen);
  }
  SortObservations(&bundle);
  std::vector<double> order;
  for (const BundleObservation& seen : bundle.observations) order.push_back(seen.seen.values[0]);
  EXPECT_THAT(order, ElementsAre(3, 2, 1, 4, 0));
}

TEST(SceneTracks, TypicalSigmasAreMediansOfEachCamera) {
  Bundle bundle;
  bundle.cameras.resize(3);
  for (const auto& [camera, sigma] :
       std::vector<std::pair<int, double>>{{0, 5}, {2, 0.25}, {0, 1}, {0, 3}, {2, 0.5}}) {
    bundle.observations.push_back({.camera = camera, .seen = {}, .assumed_sigma = sigma});
  }
  EXPECT_THAT(TypicalSigmas(bundle), ElementsAre(3, 1, 0.5));
}

TEST(VirtualCamera, ParametersHaveTheirIndices) {
  const CameraModel& model = *FindModel(CameraModels(), "pinhole");
  EXPECT_EQ(ParamOf(model, "c_x"), 2U);
  EXPECT_EQ(ParamOf(model, "B"), 4U);
  EXPECT_TRUE(IsFocal(model.params[0]));
  EXPECT_TRUE(IsFocal(model.params[1]));
  EXPECT_FALSE(IsFocal(model.params[2]));
  EXPECT_FALSE(IsFocal(FindModel(CameraModels(), "focused-plenoptic")->params[0]));  // f_L, m
}

TEST(VirtualCamera, OrdinaryCamerasStartInTheMiddleOfTheirImage) {
  CameraInput camera;
  camera.model = FindModel(CameraModels(), "pinhole-radial3");
  camera.image_size = {640, 481};
  camera.initial.resize(camera.model->params.size());
  EXPECT_THAT(OrdinaryStart(camera, 700), ElementsAre(700, 700, 319.5, 240, 0, 0, 0));
  camera.initial[1] = 650;
  camera.initial[2] = 300;
  camera.initial[5] = 0.1;
  EXPECT_THAT(OrdinaryStart(camera, 700), ElementsAre(700, 650, 300, 240, 0, 0.1, 0));
}

TEST(VirtualCamera, APlenopticCamerasImageHasTheFocalLengthOfLensAndSensor) {
  CameraInput camera;
  camera.name = "raw";
  camera.model = FindModel(CameraModels(), "focused-plenoptic");
  camera.image_size = {1000, 900};
  camera.config = {5e-6};
  camera.initial.resize(camera.model->params.size());
  CameraInput image = VirtualCamera(camera);
  EXPECT_EQ(image.name, "raw");
  EXPECT_EQ(image.model->name, "pinhole-radial3");
  EXPECT_EQ(image.image_size, camera.image_size);
  EXPECT_EQ(image.initial, std::vector<std::optional<double>>(7));
  EXPECT_EQ(image.fixed, std::vector<bool>(7, false));
  camera.initial = {0.016, 0.0155, 0.0005, 480, 430, {}, {}, {}, {}};
  image = VirtualCamera(camera);
  EXPECT_NEAR(image.initial[0].value(), 3200, 1e-9);
  EXPECT_NEAR(image.initial[1].value(), 3200, 1e-9);
  EXPECT_EQ(image.initial[2], 480);
  EXPECT_EQ(image.initial[3], 430);
  EXPECT_FALSE(image.initial[4]);
  camera.initial[2].reset();
  EXPECT_FALSE(VirtualCamera(camera).initial[0]);
}

// A bundle whose markers are seen so often, at these places.
Bundle SeenTimes(const std::vector<std::pair<int, Eigen::Vector3d>>& markers) {
  Bundle bundle;
  bundle.T_rig_target.resize(100);
  for (const auto& [times, position] : markers) {
    for (int k = 0; k < times; ++k) {
      bundle.observations.push_back(
          {.frame = k, .marker = static_cast<int>(bundle.markers.size()), .seen = {}});
    }
    bundle.markers.push_back({.number = 0, .position = position, .nominal = position});
  }
  return bundle;
}

std::vector<int> HeldBy(Bundle bundle) {
  HoldScale(&bundle);
  if (!bundle.scale_distance) return {};
  const MarkerDistance& held = *bundle.scale_distance;
  EXPECT_NEAR(held.length,
              (bundle.markers[static_cast<size_t>(held.markers_a[0])].position -
               bundle.markers[static_cast<size_t>(held.markers_b[0])].position)
                  .norm(),
              1e-12);
  EXPECT_NEAR(held.sigma, 1e-6 * held.length, 1e-18);
  return {held.markers_a[0], held.markers_b[0]};
}

TEST(SceneScaleHeld, IsThatOfTwoWellSeenPointsFarApart) {
  const Eigen::Vector3d first(0, 0, 2);
  // Seen less than half as often; as often but near; 5 x 1.5 and 8 x 0.9.
  EXPECT_THAT(
      HeldBy(SeenTimes(
          {{4, {9, 0, 2}}, {10, first}, {10, {0.1, 0, 2}}, {5, {1.5, 0, 2}}, {8, {0.9, 0, 2}}})),
      ElementsAre(1, 3));
  EXPECT_THAT(HeldBy(SeenTimes({{10, first}, {5, {1.5, 0, 2}}, {8, {0.95, 0, 2}}})),
              ElementsAre(0, 2));
  // Distances beyond that of the first point, 2 m, count no more: 6 x 2 and 5 x 2.
  EXPECT_THAT(HeldBy(SeenTimes({{10, first}, {6, {3, 0, 2}}, {5, {8, 0, 2}}})), ElementsAre(0, 1));
  EXPECT_THAT(HeldBy(SeenTimes({{10, first}, {4, {3, 0, 2}}})), IsEmpty());
  EXPECT_THAT(HeldBy({}), IsEmpty());
}

TEST(SceneScaleHeld, CountsUsedObservationsAlone) {
  Bundle bundle = SeenTimes({{10, {0, 0, 2}}, {6, {1, 0, 2}}, {9, {0, 1.5, 2}}});
  for (BundleObservation& seen : bundle.observations) seen.used = seen.marker != 2;
  EXPECT_THAT(HeldBy(bundle), ElementsAre(0, 1));
}

}  // namespace TEST_FILE
}  // namespace plenocal::testing
