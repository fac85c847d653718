// SPDX-License-Identifier: Apache-2.0
//
// What a bundle states without an adjustment: nuisances, priors, residuals, names, jitter's weight.
#include <gmock/gmock.h>

#include <cmath>
#include <limits>
#include <utility>

#include "calib/adjust/bundle.h"
#include "calib/adjust/priors.h"
#include "models/registry.h"
#include "tests/calib/synthetic.h"

namespace plenocal {
namespace TEST_FILE {

using ::testing::ElementsAre;
using ::testing::IsEmpty;
using testing::MakeProblem;
using testing::TrueBundle;

BundleCamera Pinhole() {
  BundleCamera camera;
  camera.name = "left";
  camera.model = FindModel(CameraModels(), "pinhole");
  camera.params = {500, 400, 320, 240};
  camera.fixed.assign(4, true);
  return camera;
}

TEST(Nuisances, FollowTheModelsParametersWithTheirPriors) {
  BundleCamera camera = Pinhole();
  camera.at_bound.assign(4, true);
  std::vector<View> views(3);
  views[0].by_nuisance = {{1, 2, 3, 4}};
  views[2].by_nuisance = {{1, 2, 3, 4, 5, 6}};
  AddSharedErrors({&views[1], 1}, &camera);
  EXPECT_THAT(camera.nuisances, IsEmpty());
  AddSharedErrors(views, &camera);
  EXPECT_EQ(camera.nuisances.size(), 3U);
  EXPECT_THAT(camera.at_bound, IsEmpty());
  camera.params[5] = 0.25;
  AddSharedErrors(views, &camera);  // all are there already
  AddNuisance(nuisances::kTimeShift, 0.01, &camera);
  EXPECT_THAT(camera.params, ElementsAre(500, 400, 320, 240, 0, 0.25, 0, 0));
  EXPECT_THAT(camera.fixed, ElementsAre(true, true, true, true, false, false, false, false));
  ASSERT_EQ(camera.rules.size(), 8U);
  for (size_t k = 0; k < 8; ++k) {
    ASSERT_EQ(camera.rules[k].prior.has_value(), k > 3) << k;
    if (k < 4) continue;
    EXPECT_EQ(camera.rules[k].prior->value, 0);
    EXPECT_EQ(camera.rules[k].prior->sigma, k == 7 ? 0.01 : 1);
  }
  EXPECT_EQ(camera.ModelParams(), 4U);
  EXPECT_EQ(camera.IndexInKind(2), 2U);
  EXPECT_EQ(camera.IndexInKind(3), 0U);
  EXPECT_EQ(camera.Find(nuisances::kTimeShift), 7U);
  EXPECT_EQ(NuisanceName(camera, 4), "left.shared_1");
  EXPECT_EQ(NuisanceName(camera, 6), "left.shared_3");
  EXPECT_EQ(NuisanceName(camera, 7), "left.time_shift");
}

TEST(Nuisances, DisplaceMeasuredCoordinatesByTheirValues) {
  BundleCamera camera = Pinhole();
  AddNuisance(nuisances::kSharedError, 1, &camera);
  AddNuisance(nuisances::kTimeShift, 1, &camera);
  AddNuisance(nuisances::kSharedError, 1, &camera);
  camera.params = {500, 400, 320, 240, 1, 100, -3};
  BundleObservation seen{.seen = {.values = {100, 200, 7}}, .by_nuisance = {0.5, 0.1, 0.2, -0.4}};
  Observation without = WithoutDisplacement(seen, camera);
  EXPECT_NEAR(without.values[0], 100 - (0.5 - 3 * 0.1), 1e-12);
  EXPECT_NEAR(without.values[1], 200 - (0.2 + 3 * 0.4), 1e-12);
  EXPECT_EQ(without.values[2], 7);
  seen.by_nuisance = {0.5, 0.2};  // states one
  without = WithoutDisplacement(seen, camera);
  EXPECT_NEAR(without.values[0], 99.5, 1e-12);
  EXPECT_NEAR(without.values[1], 199.8, 1e-12);
  seen.by_nuisance.clear();
  EXPECT_EQ(WithoutDisplacement(seen, camera).values, seen.seen.values);
}

constexpr size_t kIndices[] = {0, 2};
constexpr double kWeights[] = {2, -1};
const PriorRow kRow{.indices = kIndices, .weights = kWeights, .sigma = 0.5};

double UnitByCy(const CameraModel& /*model*/, const double* params) { return params[3] / 80; }

// Priors of single parameters, and the model's of a sum of two; the second camera's are tied.
TEST(ParamPriors, AreThoseOfRulesAndOfModels) {
  CameraModel model = *FindModel(CameraModels(), "pinhole");
  model.prior_rows = {&kRow, 1};
  BundleState bundle;
  bundle.cameras = {Pinhole(), Pinhole()};
  for (BundleCamera& camera : bundle.cameras) {
    camera.model = &model;
    camera.rules.resize(4);
  }
  bundle.cameras[0].rules[0].prior = {.value = 450, .sigma = 20};
  bundle.cameras[1].rules[1] = {.prior = ParamRule::Prior{.value = 7, .sigma = 3},
                                .tied_to = ParamIndex{0, 1}};
  bundle.cameras[1].rules[2].tied_to = ParamIndex{0, 2};
  std::vector<ParamPrior> priors = ParamPriors(bundle);
  ASSERT_EQ(priors.size(), 4U);
  EXPECT_EQ(priors[0].terms[0].param, (ParamIndex{0, 0}));
  EXPECT_EQ(priors[0].terms[0].weight, 1);
  EXPECT_EQ(priors[0].value, 450);
  EXPECT_EQ(priors[0].sigma, 20);
  for (const size_t k : {1U, 3U}) {
    ASSERT_EQ(priors[k].terms.size(), 2U);
    EXPECT_EQ(priors[k].terms[0].param, (ParamIndex{k / 2, 0}));
    EXPECT_EQ(priors[k].terms[0].weight, 2);
    EXPECT_EQ(priors[k].terms[1].param, (ParamIndex{0, 2}));
    EXPECT_EQ(priors[k].terms[1].weight, -1);
    EXPECT_EQ(priors[k].value, 0);
    EXPECT_EQ(priors[k].sigma, 0.5);
  }
  EXPECT_EQ(priors[2].terms[0].param, (ParamIndex{0, 1}));
  EXPECT_EQ(priors[2].value, 7);
  // Where all of them are another camera's the prior counts once.
  bundle.cameras[1].rules[0].tied_to = ParamIndex{0, 0};
  model.functions.prior_unit = UnitByCy;
  priors = ParamPriors(bundle);
  ASSERT_EQ(priors.size(), 3U);
  EXPECT_EQ(priors[1].sigma, 1.5);
  // Their rows, where the first parameter has index 0 and the third none.
  internal::UnknownLayout layout;
  layout.params = {{0, 1, -1, -1}, {0, 1, -1, -1}};
  const std::vector<internal::SparseRow> rows = internal::RowsOfParamPriors(bundle, layout);
  ASSERT_EQ(rows.size(), 3U);
  EXPECT_EQ(rows[0].J, (std::map<int, double>{{0, 1.0 / 20}}));
  EXPECT_NEAR(rows[0].residual, 2.5, 1e-12);
  EXPECT_EQ(rows[1].J, (std::map<int, double>{{0, 2 / 1.5}}));
  EXPECT_NEAR(rows[1].residual, (2 * 500 - 320) / 1.5, 1e-9);
  EXPECT_EQ(rows[2].J, (std::map<int, double>{{1, 1.0 / 3}}));
}

// Of each of two cameras in two frames; two points are behind a camera.
TEST(Residuals, AreMeasuredLessPredictedWhereTheModelProjects) {
  Bundle bundle = TrueBundle(MakeProblem(3, {.cameras = 2, .frames = 2}));
  for (size_t i = 0; i < bundle.observations.size(); ++i) {
    Observation& seen = bundle.observations[i].seen;
    seen.values[0] += 0.01 * static_cast<double>(i);
    seen.values[1] -= 0.02 * static_cast<double>(i);
  }
  BundleCamera& right = bundle.cameras[1];
  right.noise = {.detector_scale = 2, .additive_sigma = 0.3, .common_sigma = 0.4};
  const auto mid =
      static_cast<size_t>(std::ranges::find(bundle.observations, 1, &BundleObservation::camera) -
                          bundle.observations.begin());
  BundleMarker behind = bundle.markers[0];
  behind.position =
      (right.T_camera_rig * bundle.T_rig_target[0]).Inverse() * Eigen::Vector3d(0.01, 0.02, -0.5);
  bundle.markers.push_back(behind);
  bundle.observations[mid].marker = static_cast<int>(bundle.markers.size()) - 1;
  const auto all = Residuals(bundle), of_right = Residuals(bundle, 1);
  const std::vector<double> lengths = WeightedLengths(bundle);
  ASSERT_EQ(all.size(), bundle.observations.size());
  ASSERT_EQ(of_right.size(), all.size());
  size_t outside = 0;
  for (size_t i = 0; i < all.size(); ++i) {
    const BundleObservation& observation = bundle.observations[i];
    const auto expect = [&](const auto& found, bool inside) {
      for (size_t r = 0; r < 2; ++r) {
        if (inside) {
          EXPECT_NEAR(found[r], (r == 0 ? 0.01 : -0.02) * static_cast<double>(i), 1e-8) << i;
        } else {
          EXPECT_TRUE(std::isnan(found[r])) << i;
        }
      }
    };
    expect(all[i], i != mid);
    expect(of_right[i], i != mid && observation.camera == 1);
    double residual[kMaxObservationSize] = {0, 0, 7};
    ASSERT_EQ(Residual(bundle, observation, residual), i != mid);
    EXPECT_EQ(residual[2], 7);
    const double own = observation.assumed_sigma;
    const double sigma =
        observation.camera == 0 ? own : std::sqrt(4 * own * own + 0.3 * 0.3 + 0.4 * 0.4);
    if (i == mid) {
      EXPECT_EQ(lengths[i], std::numeric_limits<double>::infinity());
      ++outside;
    } else {
      expect(residual, true);
      EXPECT_NEAR(lengths[i], static_cast<double>(i) * std::hypot(0.01, 0.02) / sigma, 1e-6);
    }
  }
  EXPECT_EQ(outside, 1U);
}

TEST(Targets, MoveWithTheirMarkersAlone) {
  BundleState bundle;
  bundle.targets = {{"wall", {}, true}, {"board", {ExpRotation({0.1, 0, 0}), {1, 2, 3}}, false}};
  for (int k = 0; k < 4; ++k) {
    const Eigen::Vector3d nominal(k, 0.5 * k, -k);
    bundle.markers.push_back({k, nominal + Eigen::Vector3d(0, 0, 0.1), nominal, k % 2});
  }
  const BundleState before = bundle;
  const RigidTransform pose{ExpRotation({0.3, -0.4, 0.5}), {-1, 0.5, 2}};
  MoveTarget(1, pose, &bundle);
  EXPECT_EQ(bundle.targets[1].T_target_own.t, pose.t);
  EXPECT_EQ(bundle.targets[0].T_target_own.t.norm(), 0);
  // In its own frame each marker stays where it was.
  for (size_t m = 0; m < 4; ++m) {
    const auto own = [&](const BundleState& of, const Eigen::Vector3d& p) {
      return of.targets[m % 2].T_target_own.Inverse() * p;
    };
    const BundleMarker &now = bundle.markers[m], &then = before.markers[m];
    EXPECT_LT((own(bundle, now.position) - own(before, then.position)).norm(), 1e-12);
    EXPECT_LT((own(bundle, now.nominal) - own(before, then.nominal)).norm(), 1e-12);
  }
}

TEST(Scales, StretchNominalPlacesInTheFrameOfTheirTarget) {
  BundleState bundle;
  bundle.markers = {{0, {9, 9, 9}, {1, 2, 3}, 0}, {1, {9, 9, 9}, {4, 5, 6}, 1}};
  bundle.scales = {{.target = 1, .axes = Eigen::Vector3d::UnitX(), .value = 0.1},
                   {.target = 1, .axes = Eigen::Vector3d::UnitY(), .value = -0.2}};
  EXPECT_EQ(bundle.Expected(0), Eigen::Vector3d(1, 2, 3));
  EXPECT_LT((bundle.Expected(1) - Eigen::Vector3d(4.4, 4, 6)).norm(), 1e-12);
  EXPECT_EQ(NameOfScale(bundle, bundle.scales[0]), "target.scale_x");
  EXPECT_EQ(NameOfScale(bundle, bundle.scales[1]), "target.scale_y");
  const RigidTransform pose{ExpRotation({0, 0, 0.5}), {1, -1, 0}};
  bundle.targets = {{"floor", {}, true}, {"wall", pose, false}};
  const Eigen::Vector3d own = pose.Inverse() * Eigen::Vector3d(4, 5, 6);
  EXPECT_LT((bundle.Expected(1) - pose * Eigen::Vector3d(1.1, 0.8, 1).cwiseProduct(own)).norm(),
            1e-12);
  EXPECT_EQ(NameOfScale(bundle, bundle.scales[0]), "wall.scale_x");
  EXPECT_EQ(NameOfScale(bundle, {.target = 0}), "floor.scale");
}

TEST(PriorUnknowns, AreNamedByParameterOrExtrinsics) {
  Bundle bundle;
  bundle.cameras = {Pinhole(), Pinhole()};
  bundle.cameras[1].name = "right";
  CalibrationPrior prior;
  prior.T_camera_rig = {{}, {ExpRotation({0.1, 0.2, 0.3}), {0.1, 0, 0}}};
  prior.unknowns = {{.camera = 0, .param = 1, .value = 390}, {.camera = 1, .component = 4}};
  bundle.prior = prior;
  bundle.cameras[1].T_camera_rig =
      Retract(prior.T_camera_rig[1], 0.01 * Vector6d::LinSpaced(6, 1, 6));
  EXPECT_EQ(NameOfPriorUnknown(bundle, 0), "left.f_y");
  EXPECT_EQ(NameOfPriorUnknown(bundle, 1), "right.T_camera_rig.w_y");
  const Eigen::VectorXd deviation = DeviationFromPrior(bundle);
  EXPECT_NEAR(deviation[0], 10, 1e-12);
  EXPECT_NEAR(deviation[1], 0.05, 1e-9);
}

// Deviations of the target's centre and of its rotation in their sigmas.
TEST(JitterWeight, IsOfTheMotionOfTheTargetsCentre) {
  BundleState bundle;
  bundle.cameras.resize(2);
  bundle.markers = {{0, {9, 9, 9}, {0.1, 0.2, 0}, 0}, {1, {9, 9, 9}, {0.5, 0.4, 0.2}, 0}};
  const RigidTransform pose{ExpRotation({0.4, -0.3, 0.2}), {1, 2, 3}};
  bundle.T_rig_target = {{}, pose};
  bundle.jitter.translation_sigma = 0.002;
  bundle.jitter.rotation_sigma = 0.01;
  bundle.jitter.misplaced = {false, false, true, false};
  Vector6d delta;
  delta << 1e-6, -2e-6, 3e-6, 2e-6, 1e-6, -3e-6;
  const Eigen::Vector3d centre(0.3, 0.3, 0.1);
  Vector6d expected;
  expected << (Retract(pose, delta) * centre - pose * centre) / 0.002, delta.tail<3>() / 0.01;
  EXPECT_LT((JitterWeight(bundle, 1) * delta - expected).norm(), 1e-5 * expected.norm());
  EXPECT_EQ(JitterWeight(bundle, 1, 1), JitterWeight(bundle, 1));
  EXPECT_EQ(JitterWeight(bundle, 1, 0), 1e-3 * JitterWeight(bundle, 1));
  bundle.markers.clear();
  EXPECT_EQ(JitterWeight(bundle, 1)(0, 4), 0);
}

TEST(Observations, OfOneMarkerViewOrFrameFollowEachOther) {
  std::vector<BundleObservation> all;
  for (const auto& [frame, camera, marker] : std::vector<std::array<int, 3>>{
           {0, 0, 0}, {0, 0, 0}, {0, 0, 1}, {0, 1, 1}, {1, 1, 1}, {1, 1, 1}}) {
    all.push_back({.camera = camera, .frame = frame, .marker = marker, .seen = {}});
  }
  EXPECT_EQ(EndOfMarker(all, 0), 2U);
  EXPECT_EQ(EndOfMarker(all, 2), 3U);
  EXPECT_EQ(EndOfMarker(all, 3), 4U);
  EXPECT_EQ(EndOfMarker(all, 4), 6U);
  EXPECT_EQ(EndOfView(all, 0), 3U);
  EXPECT_EQ(EndOfView(all, 3), 4U);
  EXPECT_EQ(EndOfFrame(all, 1), 4U);
  EXPECT_EQ(EndOfFrame(all, 4), 6U);
}

}  // namespace TEST_FILE
}  // namespace plenocal
