// SPDX-License-Identifier: Apache-2.0
//
// Points lie on the scene's surfaces, and tracks are their projections where nothing hides them.
#include "apps/simulate/scene/scene_points.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <numbers>
#include <set>

#include "apps/simulate/spec/random.h"
#include "calib/base/error.h"
#include "tests/apps/simulate/small_scene.h"
#include "tests/refusal.h"

namespace plenocal::simulate {
namespace TEST_FILE {

using Eigen::Vector3d;

constexpr size_t kPoints = 60;

// A scene with its points; `change` of the specification.
struct Staged {
  SimulationSpec spec = SmallScene();
  RigPath path;
  std::unique_ptr<Observer> observer;
  std::unique_ptr<SimulatedScene> scene;
  std::vector<ScenePoint> points;

  template <typename Change>
  explicit Staged(const Change& change) {
    SceneSpec& limits = spec.scenery->scene;
    TrajectorySpec& trajectory = spec.scenery->trajectory;
    limits.points = kPoints;
    limits.boxes = 8;
    trajectory.length = 12;
    trajectory.rate = 2;
    trajectory.segment = 4;
    change(&limits, &trajectory);
    path = MakeRigPath(trajectory, limits.nearest, limits.farthest, spec.seed);
    observer = std::make_unique<Observer>(spec);
    scene = std::make_unique<SimulatedScene>(spec, *observer, path);
    points = DrawPoints(spec, *observer, path, *scene);
  }
  [[nodiscard]] CameraTracks Track(size_t camera) const {
    return TrackPoints(spec, *observer, path, *scene, points, camera, 2);
  }
  [[nodiscard]] RigidTransform WorldOf(const ScenePoint& point, double time) const {
    return point.box ? scene->Moving()[*point.box].At(time).T_world_box : RigidTransform{};
  }
  // The image of a point, if the camera sees it: by the nearest surface along its ray.
  [[nodiscard]] std::vector<Observation> See(size_t c,
                                             const RigInstant& instant,
                                             const ScenePoint& point) const {
    const RigidTransform T = spec.cameras[c].T_camera_rig * instant.T_world_rig.Inverse();
    const Vector3d viewer = T.Inverse().t, p = WorldOf(point, instant.time) * point.position;
    const SceneSpec& limits = spec.scenery->scene;
    const double depth = (T * p).z();
    if (depth < limits.nearest || depth > limits.farthest) return {};
    const auto hit = scene->At(instant.time, viewer, 1e9).Cast(viewer, p - viewer);
    if (!hit || std::abs(hit->distance - 1) > 1e-6) return {};
    return observer->ObservePoint(c, *point.number_at_end, T * p);
  }
};

TEST(ScenePoints, LieOnSurfacesThatAreSeenWithinTheDepths) {
  const Staged staged([](SceneSpec*, TrajectorySpec*) {});
  ASSERT_EQ(staged.points.size(), kPoints);
  Digest digest;
  std::vector<double> inverse_depths;
  for (size_t i = 0; i < kPoints; ++i) {
    const ScenePoint& point = staged.points[i];
    EXPECT_EQ(point.number, static_cast<int>(i));
    EXPECT_EQ(point.number_at_end, point.number);
    EXPECT_FALSE(point.box);
    EXPECT_NEAR(point.normal.norm(), 1, 1e-12);
    const auto hit =
        staged.scene->Still().Cast(point.position + 1e-3 * point.normal, -point.normal);
    ASSERT_TRUE(hit);
    EXPECT_NEAR(hit->distance, 1e-3, 1e-9);
    EXPECT_LT((hit->normal - point.normal).norm(), 1e-9);
    int seen = 0;
    for (const RigInstant* instant : staged.path.Used()) {
      for (size_t c = 0; c < 2; ++c) seen += staged.See(c, *instant, point).empty() ? 0 : 1;
    }
    EXPECT_GT(seen, 0) << i;
    digest.AddAll(point.position);
  }
  EXPECT_NEAR(digest.Sum(), -21.716451872, 1e-5);
}

TEST(ScenePoints, KeepTheirNumbersAtTheEndWhereTheyMerge) {
  const Staged staged([](SceneSpec* scene, TrajectorySpec*) { scene->merged = 0.4; });
  size_t merged = 0;
  for (size_t i = 0; i < kPoints; ++i) {
    const bool merges = Random(5, "merged", {i}).Uniform(0, 1) < 0.4;
    merged += merges ? 1 : 0;
    EXPECT_EQ(staged.points[i].number_at_end, static_cast<int>(merges ? i : i + kPoints));
  }
  EXPECT_TRUE(merged > 10 && merged < 50);
}

TEST(ScenePoints, LieOnFacesOfMovingBoxesThatTheRigSees) {
  const Staged staged([](SceneSpec* scene, TrajectorySpec*) { scene->moving = 0.71; });
  const std::vector<MovingBox>& boxes = staged.scene->Moving();
  ASSERT_EQ(boxes.size(), 2u);
  std::set<int> faces;
  Digest digest;
  for (size_t i = 0; i < kPoints; ++i) {
    const ScenePoint& point = staged.points[i];
    ASSERT_EQ(point.box.has_value(), i >= kPoints - 43) << i;  // 42.6 of 60
    if (!point.box) continue;
    EXPECT_EQ(*point.box, i % 2);
    const MovingBox& moving = boxes[*point.box];
    const Vector3d share = point.position.cwiseQuotient(moving.box.half);
    int axis = 0;
    EXPECT_DOUBLE_EQ(share.cwiseAbs().maxCoeff(&axis), 1);
    EXPECT_EQ(point.normal, Vector3d(share[axis] * Vector3d::Unit(axis)));
    EXPECT_GT(point.normal.dot(moving.box.T_world_box.Inverse() * moving.viewer - point.position),
              0);
    faces.insert(2 * axis + (share[axis] > 0 ? 1 : 0));
    digest.AddAll(point.position);
  }
  EXPECT_GE(faces.size(), 4u);
  EXPECT_NEAR(digest.Sum(), -1.2997068552, 1e-5);
}

TEST(ScenePoints, OfARepeatedSceneHaveCopiesThatTheEndMistakes) {
  const Staged staged([](SceneSpec* scene, TrajectorySpec* path) {
    path->repeated = true;
    path->segment = 5;
    scene->moving = 0.1;
    scene->merged = 0.5;
  });
  const size_t still = kPoints - 6;
  ASSERT_EQ(staged.points.size(), kPoints + still);
  const Eigen::Matrix3d back = ExpRotation({0, 0, -staged.scene->Period()});
  for (size_t i = 0; i < still; ++i) {
    const ScenePoint &point = staged.points[i], &copy = staged.points[kPoints + i];
    EXPECT_LT((copy.position - back * point.position).norm(), 1e-12);
    EXPECT_LT((copy.normal - back * point.normal).norm(), 1e-12);
    EXPECT_EQ(copy.number, static_cast<int>(2 * kPoints + i));
    if (Random(5, "mistaken", {i}).Uniform(0, 1) < 0.45) {
      EXPECT_EQ(point.number_at_end, copy.number);
      EXPECT_FALSE(copy.number_at_end);
    } else {
      EXPECT_EQ(copy.number_at_end, copy.number);
      EXPECT_NE(point.number_at_end, copy.number);
    }
  }
}

TEST(ScenePoints, AreTrackedWhereverNothingHidesThem) {
  const Staged staged([](SceneSpec* scene, TrajectorySpec* path) {
    scene->moving = 0.4;
    scene->merged = 0.5;
    path->frames = 5;
  });
  const std::vector<const RigInstant*> used = staged.path.Used();
  ASSERT_EQ(used.size(), 10u);
  for (size_t c = 0; c < 2; ++c) {
    const CameraTracks tracks = staged.Track(c);
    ASSERT_EQ(tracks.views.size(), used.size());
    EXPECT_TRUE(tracks.wrong.empty());
    std::vector<int> observed(kPoints);
    for (size_t f = 0; f < used.size(); ++f) {
      EXPECT_EQ(tracks.views[f].frame, used[f]->name);
      std::vector<Observation> expected;
      for (size_t i = 0; i < kPoints; ++i) {
        auto seen = staged.See(c, *used[f], staged.points[i]);
        if (seen.empty()) continue;
        ++observed[i];
        if (used[f]->part == Part::kStart) seen[0].marker = staged.points[i].number;
        expected.push_back(seen[0]);
      }
      const std::vector<Observation>& found = tracks.views[f].observations;
      ASSERT_EQ(found.size(), expected.size()) << f;
      for (size_t k = 0; k < found.size(); ++k) {
        EXPECT_EQ(found[k].marker, expected[k].marker);
        for (size_t i = 0; i < 2; ++i) {
          EXPECT_NEAR(found[k].values[i], expected[k].values[i], 1e-9);
        }
      }
    }
    EXPECT_EQ(tracks.observed, observed);
    EXPECT_GT(std::accumulate(observed.begin(), observed.end(), 0), 50);
  }
}

TEST(ScenePoints, AreNotTrackedAtTheEndWithoutANumber) {
  Staged staged([](SceneSpec*, TrajectorySpec* path) { path->frames = 5; });
  const CameraTracks all = staged.Track(0);
  staged.points[3].number_at_end.reset();
  const CameraTracks tracks = staged.Track(0);
  for (size_t f = 0; f < tracks.views.size(); ++f) {
    const bool end = staged.path.Used()[f]->part == Part::kEnd;
    const auto has = [](const View& view) {
      return std::ranges::any_of(view.observations,
                                 [](const Observation& o) { return o.marker == 3; });
    };
    EXPECT_EQ(has(tracks.views[f]), has(all.views[f]) && !end) << f;
  }
}

TEST(ScenePoints, AreLostAndTakenForOthersAsOftenAsStated) {
  Staged staged([](SceneSpec*, TrajectorySpec* path) { path->whole = true; });
  const CameraTracks all = staged.Track(1);
  const auto count = [](const CameraTracks& tracks) {
    size_t sum = 0;
    for (const View& view : tracks.views) sum += view.observations.size();
    return static_cast<double>(sum);
  };
  staged.spec.scenery->scene.track_length = 3;
  const CameraTracks lost = staged.Track(1);
  EXPECT_NEAR(count(lost) / count(all), 0.5, 0.1);
  // Changes per frame between two frames that could both show a point: 1 / mean.
  std::vector<std::set<int>> before, after;
  for (size_t f = 0; f < all.views.size(); ++f) {
    before.emplace_back(), after.emplace_back();
    for (const Observation& o : all.views[f].observations) before.back().insert(o.marker);
    for (const Observation& o : lost.views[f].observations) after.back().insert(o.marker);
    EXPECT_TRUE(std::ranges::includes(before.back(), after.back()));
  }
  double both = 0, changes = 0;
  for (size_t f = 1; f < before.size(); ++f) {
    for (const int marker : before[f]) {
      if (!before[f - 1].contains(marker)) continue;
      both += 1;
      changes += after[f].contains(marker) != after[f - 1].contains(marker) ? 1 : 0;
    }
  }
  // Odd numbers of changes of a Poisson process: (1 - exp(-2 / 3)) / 2.
  EXPECT_NEAR(changes / both, 0.243, 0.05);
  Digest digest;
  for (const std::set<int>& each : after) digest.AddAll(each);
  EXPECT_NEAR(digest.Sum(), 39.085029928, 1e-5);

  staged.spec.scenery->scene.track_length = 0;
  staged.spec.scenery->scene.wrong_matches = 0.3;
  const CameraTracks wrong = staged.Track(1);
  EXPECT_EQ(count(wrong), count(all));
  EXPECT_NEAR(static_cast<double>(wrong.wrong.size()) / count(all), 0.3, 0.06);
  std::set<std::pair<std::string, int>> named(wrong.wrong.begin(), wrong.wrong.end());
  for (size_t f = 0; f < all.views.size(); ++f) {
    const View &view = wrong.views[f], &exact = all.views[f];
    for (size_t k = 0; k < exact.observations.size(); ++k) {
      EXPECT_EQ(view.observations[k].marker, exact.observations[k].marker);
      const bool own = view.observations[k].values == exact.observations[k].values;
      const bool another = std::ranges::any_of(exact.observations, [&](const Observation& o) {
        return o.marker != view.observations[k].marker && o.values == view.observations[k].values;
      });
      EXPECT_NE(own, another);
      EXPECT_EQ(another, named.contains({view.frame, view.observations[k].marker}));
      digest.Add(view.observations[k].values[0]);
    }
  }
  EXPECT_NEAR(digest.Sum(), -154.80661991, 1e-5);
  EXPECT_EQ(wrong.observed, all.observed);
}

TEST(ScenePoints, HaveTheNoiseOfTheirCamera) {
  Staged staged([](SceneSpec*, TrajectorySpec*) {});
  const CameraTracks exact = staged.Track(1);
  staged.spec.cameras[1].detection_sigma = 0.25;
  const CameraTracks noisy = staged.Track(1);
  for (size_t f = 0; f < exact.views.size(); ++f) {
    Random random(5, "tracks", {1, f});
    for (size_t k = 0; k < exact.views[f].observations.size(); ++k) {
      const Observation &a = exact.views[f].observations[k], &b = noisy.views[f].observations[k];
      random.Uniform(0, 1);  // whether it is taken for another
      EXPECT_DOUBLE_EQ(b.values[0], a.values[0] + random.Gaussian(0.25));
      EXPECT_DOUBLE_EQ(b.values[1], a.values[1] + random.Gaussian(0.25));
      EXPECT_EQ(b.detector_sigma, 0.25);
    }
  }
}

TEST(ScenePoints, AreRefusedWhereNothingIsWithinTheDepths) {
  Staged staged([](SceneSpec*, TrajectorySpec*) {});
  staged.spec.scenery->scene.nearest = 300;
  staged.spec.scenery->scene.farthest = 400.5;
  EXPECT_EQ(testing::RefusalOf(
                [&] { DrawPoints(staged.spec, *staged.observer, staged.path, *staged.scene); },
                ErrorKind::kJob),
            "spec.yaml: scene: the cameras see no surface at depths from 300 to 400.5 m; correct "
            "'near', 'far' or the trajectory");
}

}  // namespace TEST_FILE
}  // namespace plenocal::simulate
