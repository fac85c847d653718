// SPDX-License-Identifier: Apache-2.0
#include "assess/views/rig_estimate.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <cmath>

#include "assess/views/information_state.h"
#include "assess/views/projection_sigma.h"
#include "models/registry.h"
#include "tests/calib/random.h"
#include "tests/refusal.h"

namespace plenocal::testing {
namespace TEST_FILE {

using ::testing::ElementsAre;

constexpr double kInfinity = std::numeric_limits<double>::infinity();

// Two cameras, of which the first has a fixed f_y and the second sees one frame.
CalibrationRecord TwoCameras() {
  CalibrationRecord record;
  record.path = "some/calibration.yaml";
  for (const char* name : {"left", "right"}) {
    CalibratedCamera camera{.name = name,
                            .model = FindModel(CameraModels(), "pinhole"),
                            .image_size = {320, 240},
                            .config = {},
                            .params = {300, 310, 160, 118},
                            .covariance = 0.04 * Eigen::Matrix4d::Identity(),
                            .T_camera_rig = {}};
    camera.fit.noise_sigma = 0.5;
    record.cameras.push_back(camera);
  }
  record.cameras[0].covariance(1, 1) = 0;
  record.cameras[1].T_camera_rig = {ExpRotation({0, 0.1, 0}), {-0.2, 0, 0}};
  record.frames = {{"a", RigidTransform{ExpRotation({0.1, 0, 0}), {0, 0.1, -1}}},
                   {"b", RigidTransform{ExpRotation({0, 0.2, 0}), {0.2, 0, -2}}}};
  record.markers = {{7, {.position = {0.1, 0.2, 0}, .sigma = Eigen::Vector3d(1e-3, 2e-3, 3e-3)}},
                    {9, {.position = {0.3, 0, 0}, .nominal = Eigen::Vector3d(0.31, 0, 0)}}};
  const auto row = [](int frame, int marker, double sigma, bool used = true) {
    return ResidualRow{.frame = frame,
                       .marker = marker,
                       .values = {10.0 + frame, 20.0 + marker},
                       .residual = {},
                       .noise_sigma = sigma,
                       .used = used};
  };
  record.cameras[0].residuals = {
      row(1, 9, 0.2), row(1, 7, 0.3), row(0, 9, 0.4), row(0, 7, 9, false)};
  record.cameras[1].residuals = {row(0, 7, 0)};
  return record;
}

TEST(RigEstimate, HasTheStateOfTheRecord) {
  const CalibrationRecord record = TwoCameras();
  const RigEstimate rig = MakeRigEstimate(record);
  const Bundle& bundle = rig.bundle;
  ASSERT_EQ(bundle.cameras.size(), 2U);
  EXPECT_TRUE(bundle.cameras[0].is_master);
  EXPECT_FALSE(bundle.cameras[1].is_master);
  EXPECT_THAT(bundle.cameras[0].fixed, ElementsAre(false, true, false, false));
  EXPECT_THAT(bundle.cameras[1].fixed, ElementsAre(false, false, false, false));
  EXPECT_EQ(bundle.cameras[1].params, record.cameras[1].params);
  EXPECT_EQ(bundle.cameras[1].T_camera_rig.t, record.cameras[1].T_camera_rig.t);
  EXPECT_EQ(bundle.cameras[1].name, "right");
  ASSERT_EQ(bundle.T_rig_target.size(), 2U);
  for (size_t f = 0; f < 2; ++f) {
    const RigidTransform same = bundle.T_rig_target[f] * record.frames[f].T_target_rig;
    EXPECT_LT(same.t.norm() + LogRotation(same.R).norm(), 1e-12);
  }
  ASSERT_EQ(bundle.markers.size(), 2U);
  EXPECT_EQ(bundle.markers[0].number, 7);
  EXPECT_EQ(bundle.markers[0].nominal, Eigen::Vector3d(0.1, 0.2, 0));
  EXPECT_EQ(bundle.markers[1].position, Eigen::Vector3d(0.3, 0, 0));
  EXPECT_EQ(bundle.markers[1].nominal, Eigen::Vector3d(0.31, 0, 0));
  // By frame, camera and marker.
  std::vector<std::array<int, 3>> order;
  for (const BundleObservation& each : bundle.observations) {
    order.push_back({each.frame, each.camera, each.marker});
  }
  EXPECT_THAT(order,
              ElementsAre(std::array{0, 0, 0},
                          std::array{0, 0, 1},
                          std::array{0, 1, 0},
                          std::array{1, 0, 0},
                          std::array{1, 0, 1}));
  EXPECT_FALSE(bundle.observations[0].used);
  EXPECT_EQ(bundle.observations[4].seen.values[0], 11);
  EXPECT_EQ(bundle.observations[4].seen.values[1], 29);
  EXPECT_EQ(bundle.observations[4].assumed_sigma, 0.2);
  EXPECT_EQ(bundle.observations[2].assumed_sigma, 0.5);  // of the camera
  EXPECT_THAT(rig.sigma_px, ElementsAre(0.3, 0.5));      // medians of used ones
  EXPECT_THAT(rig.factors, ElementsAre(1, 1));
  EXPECT_EQ(rig.lenses.size(), 2U);
  EXPECT_TRUE(rig.marker_sigmas.empty());  // of a rigid target
  EXPECT_TRUE(bundle.jitter.delta.empty());
}

TEST(RigEstimate, SplitsTheNoiseThatPointsShare) {
  CalibrationRecord record = TwoCameras();
  record.cameras[0].fit.common_noise = 0.24;
  record.cameras[1].fit.common_noise = 0.6;  // more than all: no own noise is known
  const RigEstimate rig = MakeRigEstimate(record);
  EXPECT_EQ(rig.bundle.cameras[0].noise.common_sigma, 0.24);
  EXPECT_NEAR(rig.bundle.observations[3].assumed_sigma, 0.18, 1e-12);  // of 0.3
  EXPECT_EQ(rig.bundle.observations[2].assumed_sigma, 0.1);
  record.cameras[1].residuals.clear();
  EXPECT_EQ(MakeRigEstimate(record).sigma_px[1], 0.1);
}

TEST(RigEstimate, TakesMarkersJitterAndMisplacedViews) {
  CalibrationRecord record = TwoCameras();
  record.adjustment = AdjustmentRecord{.marker_freedom = MarkerFreedom::FromSigma(0.0015)};
  record.jitter = JitterRecord{.translation_sigma = 0.001, .rotation_sigma = 0.002};
  record.cameras[1].view_poses = {{0, {{}, true}}, {1, {{}, false}}};
  RigEstimate rig = MakeRigEstimate(record);
  EXPECT_EQ(rig.bundle.marker_freedom.Sigma(), 0.0015);
  ASSERT_EQ(rig.marker_sigmas.size(), 1U);
  EXPECT_EQ(rig.marker_sigmas.at(7), Eigen::Vector3d(1e-3, 2e-3, 3e-3));
  EXPECT_EQ(rig.bundle.jitter.translation_sigma, 0.001);
  EXPECT_EQ(rig.bundle.jitter.rotation_sigma, 0.002);
  EXPECT_EQ(rig.bundle.jitter.delta, std::vector<Vector6d>(4, Vector6d::Zero()));
  EXPECT_THAT(rig.bundle.jitter.misplaced, ElementsAre(false, true, false, false));
  // A size that is estimated is no error of single markers.
  record.target_scales = {{"target.scale", {0.01, 0.001}}};
  rig = MakeRigEstimate(record);
  EXPECT_EQ(rig.marker_sigmas.at(7), Eigen::Vector3d(1e-3, 1.5e-3, 1.5e-3));
  record.markers[7].sigma->z() = kInfinity;
  EXPECT_TRUE(MakeRigEstimate(record).marker_sigmas.empty());
}

std::string Refused(const CalibrationRecord& record) {
  return RefusalOf([&] { MakeRigEstimate(record); });
}

TEST(RigEstimate, RefusesScenesLocalModelsAndRecordsWithoutPoints) {
  CalibrationRecord record = TwoCameras();
  record.cameras[0].residuals.clear();
  EXPECT_EQ(Refused(record), "no refusal");
  record.cameras[1].residuals.clear();
  EXPECT_EQ(Refused(record),
            "some/calibration.yaml: the calibration has no points (residuals.csv)");
  CameraModel local = *record.cameras[1].model;
  local.support_size = 16;
  record.cameras[1].model = &local;
  EXPECT_EQ(Refused(record),
            "some/calibration.yaml: camera right has the model pinhole, whose many parameters are "
            "local; calibrate with a model of few parameters and follow the suggestions for it: "
            "they serve both");
  record.adjustment = AdjustmentRecord{.marker_freedom = MarkerFreedom::Landmarks()};
  EXPECT_EQ(Refused(record),
            "some/calibration.yaml: calibrated from scene points; next views are for a target");
}

TEST(RigEstimate, RefusesOneCameraWithoutStandardErrors) {
  CalibrationRecord record = TwoCameras();
  for (CalibratedCamera& camera : record.cameras) camera.covariance.setZero();
  EXPECT_EQ(Refused(record), "no refusal");
  record.cameras.resize(1);
  EXPECT_EQ(Refused(record),
            "some/calibration.yaml: states no standard error, so that views have nothing to "
            "determine");
}

TEST(RigUnknowns, AreFreeParametersAndExtrinsicsInTheirUnits) {
  RigEstimate rig = MakeRigEstimate(TwoCameras());
  rig.bundle.cameras[1].params[2] = -0.25;
  rig.bundle.cameras[1].params[3] = 0;
  const RigUnknowns unknowns = MakeRigUnknowns(rig.bundle, 1.5);
  EXPECT_THAT(unknowns.params[0], ElementsAre(0, -1, 1, 2));
  EXPECT_THAT(unknowns.params[1], ElementsAre(3, 4, 5, 6));
  EXPECT_THAT(unknowns.extrinsics, ElementsAre(-1, 7));
  EXPECT_EQ(unknowns.head, 13);
  Eigen::VectorXd unit(13);
  const auto of = [&](double value, size_t k) {
    return std::max(value, rig.bundle.cameras[0].model->params[k].scale);
  };
  unit << of(300, 0), of(160, 2), of(118, 3), of(300, 0), of(310, 1), of(0.25, 2), of(1e-12, 3),
      1.5, 1.5, 1.5, 1, 1, 1;
  EXPECT_EQ(unknowns.unit, unit);
  EXPECT_THAT(unknowns.names,
              ElementsAre("left.f_x",
                          "left.c_x",
                          "left.c_y",
                          "right.f_x",
                          "right.f_y",
                          "right.c_x",
                          "right.c_y",
                          "right.T_camera_rig.x",
                          "right.T_camera_rig.y",
                          "right.T_camera_rig.z",
                          "right.T_camera_rig.w_x",
                          "right.T_camera_rig.w_y",
                          "right.T_camera_rig.w_z"));
  EXPECT_TRUE(unknowns.deformations.empty());
  rig.factors = {4, 9};
  Eigen::VectorXd factors(13);
  factors << 2, 2, 2, 3, 3, 3, 3, 3, 3, 3, 3, 3, 3;
  EXPECT_LT((UnknownScales(rig, unknowns) - unit.cwiseProduct(factors)).norm(), 1e-12);
  for (BundleCamera& camera : rig.bundle.cameras) camera.fixed.assign(4, true);
  const RigUnknowns extrinsics = MakeRigUnknowns(rig.bundle, 1.5);
  EXPECT_EQ(UnknownScales(rig, extrinsics), 3 * extrinsics.unit);
  EXPECT_EQ(extrinsics.unit, unit.tail<6>());
}

constexpr double kTolerance = 0.002;

Bundle WithMarkers(const std::vector<Eigen::Vector3d>& places) {
  Bundle bundle;
  bundle.marker_freedom = MarkerFreedom::FromSigma(kTolerance);
  for (const Eigen::Vector3d& p : places) {
    const int number = 5 * static_cast<int>(bundle.markers.size());
    bundle.markers.push_back({.number = number, .position = p, .nominal = p});
  }
  return bundle;
}

// A deformation by independent errors of the markers: no field moves the target as a whole, and
// each has the size of one sigma. The linear ones are symmetric, so that they do not rotate it.
TEST(RigUnknowns, AreDeformationsOfATargetWithATolerance) {
  for (const double depth : {0.0, 0.008, 0.012, 0.3}) {
    std::vector<Eigen::Vector3d> places;
    Random random(3);
    for (int i = 0; i < 12; ++i) {
      const Eigen::Vector3d p(
          random.Uniform(-1, 1), random.Uniform(-0.6, 0.6), random.Uniform(-depth, depth));
      places.emplace_back(0.1 * p);
    }
    const RigUnknowns unknowns = MakeRigUnknowns(WithMarkers(places), 1);
    EXPECT_EQ(unknowns.head, 0);
    // A plane has three linear ones and three bends, a solid six linear ones.
    ASSERT_EQ(unknowns.unit.size(), 6) << depth;
    EXPECT_EQ(unknowns.unit, Eigen::VectorXd::Ones(6));
    ASSERT_EQ(unknowns.deformations.size(), 12U);
    Eigen::MatrixXd P(12, 3), fields(12, 3);
    for (Eigen::Index m = 0; m < 12; ++m) P.row(m) = places[static_cast<size_t>(m)];
    P.rowwise() -= P.colwise().mean().eval();
    const Eigen::JacobiSVD<Eigen::MatrixXd> axes(P, Eigen::ComputeThinU | Eigen::ComputeThinV);
    const Eigen::VectorXd extents = axes.singularValues();
    const bool flat = extents[2] < 0.02 * extents[1];
    EXPECT_EQ(flat, depth < 0.012) << extents.transpose();
    int bends = 0;
    for (Eigen::Index k = 0; k < 6; ++k) {
      for (int m = 0; m < 12; ++m) fields.row(m) = unknowns.deformations.at(5 * m).col(k);
      EXPECT_NEAR(fields.norm(), kTolerance, 1e-12);
      EXPECT_LT(fields.colwise().sum().norm(), 1e-12);
      // In the axes of the target; a plane has linear ones in it and bends normal to it.
      const Eigen::MatrixXd d = fields * axes.matrixV(), p = P * axes.matrixV();
      if (flat && d.rightCols<1>().norm() > 0.5 * kTolerance) {
        EXPECT_LT(d.leftCols<2>().norm(), 1e-12);
        ++bends;
        continue;
      }
      const Eigen::Index dimensions = flat ? 2 : 3;
      const Eigen::MatrixXd A = p.leftCols(dimensions).householderQr().solve(d);
      EXPECT_LT((p.leftCols(dimensions) * A - d).norm(), 1e-12);
      const Eigen::MatrixXd square = A.leftCols(dimensions);
      EXPECT_LT((square - square.transpose()).norm(), 1e-9 * square.norm());
    }
    EXPECT_EQ(bends, flat ? 3 : 0);
  }
}

TEST(RigUnknowns, HaveNoDeformationsThatMoveNothing) {
  EXPECT_TRUE(MakeRigUnknowns(WithMarkers({{1, 2, 3}}), 1).deformations.empty());
  // A line along an axis has a stretch and two bends of its direction.
  EXPECT_EQ(MakeRigUnknowns(WithMarkers({{0, 0, 0}, {1, 0, 0}}), 1).unit.size(), 3);
  const RigUnknowns line = MakeRigUnknowns(WithMarkers({{0, 0, 0}, {1, 0, 0}, {3, 0, 0}}), 1);
  EXPECT_EQ(line.unit.size(), 3);
  for (const auto& [number, fields] : line.deformations) {
    EXPECT_EQ(fields.cols(), 3);
    EXPECT_TRUE(fields.allFinite());
  }
}

TEST(PointDistances, AreOfUsedPointsInTheirCamera) {
  RigEstimate rig = MakeRigEstimate(TwoCameras());
  const Bundle& bundle = rig.bundle;
  std::vector<double> expected;
  for (const auto& [frame, marker] : {std::pair{0, 1}, {1, 0}, {1, 1}}) {
    expected.push_back((bundle.T_rig_target[static_cast<size_t>(frame)] *
                        bundle.markers[static_cast<size_t>(marker)].position)
                           .norm());
  }
  std::ranges::sort(expected);
  EXPECT_THAT(PointDistances(bundle, 0),
              ::testing::Pointwise(::testing::DoubleNear(1e-12), expected));
  const double other =
      (bundle.cameras[1].T_camera_rig * (bundle.T_rig_target[0] * bundle.markers[0].position))
          .norm();
  ASSERT_EQ(PointDistances(bundle, 1).size(), 1U);
  EXPECT_NEAR(PointDistances(bundle, 1)[0], other, 1e-12);
  const double nearest = std::min(other, expected.front()),
               farthest = std::max(other, expected.back());
  const std::vector<double> distances = ProjectionDistances(bundle);
  ASSERT_EQ(distances.size(), 3U);
  EXPECT_NEAR(distances[0], nearest, 1e-12);
  EXPECT_NEAR(distances[1], farthest, 1e-12);
  EXPECT_NEAR(distances[2], 10 * farthest, 1e-11);
  // A target before the first camera alone, less than a metre away.
  std::erase_if(rig.bundle.observations,
                [](const BundleObservation& each) { return each.frame == 1 || each.camera == 1; });
  rig.bundle.T_rig_target[0].t *= 0.5;
  const double alone = PointDistances(bundle, 0).at(0);
  EXPECT_LT(alone, 1);
  EXPECT_THAT(ProjectionDistances(bundle), ElementsAre(alone, alone, 10 * alone));
  CameraModel plenoptic = *bundle.cameras[0].model;
  plenoptic.plenoptic = true;
  rig.bundle.cameras[1].model = &plenoptic;
  EXPECT_EQ(ProjectionDistances(rig.bundle).size(), 2U);
}

TEST(InformationState, GainsSigmaOrEntropy) {
  const ProjectionSigma projection({{0, 0, Eigen::RowVector2d(1, 1)}}, 1, {.determined = 5});
  const Eigen::Matrix2d information = Eigen::Vector2d(1, 4).asDiagonal();
  // A variance of 1 of the first unknown is the prior's.
  InformationState state(information, 2, projection);
  EXPECT_NEAR(state.Sigma(), std::sqrt(1.25), 1e-12);
  EXPECT_FALSE(state.IsDetermined());
  EXPECT_EQ(state.SigmaOfImages(), kInfinity);
  EXPECT_EQ(state.Criterion(), ViewCriterion::kEntropy);
  const Eigen::Matrix2d more = Eigen::Vector2d(3, 1).asDiagonal();
  EXPECT_NEAR(state.Gain(more), std::log(4.0 * 5 / 4), 1e-12);
  state.Add(more);
  EXPECT_EQ(state.Information(), Eigen::Matrix2d(Eigen::Vector2d(4, 5).asDiagonal()));
  EXPECT_TRUE(state.IsDetermined());
  EXPECT_EQ(state.Criterion(), ViewCriterion::kSigma);
  EXPECT_NEAR(state.Covariance()(1, 1), 0.2, 1e-12);
  EXPECT_NEAR(state.SigmaOfImages(), std::sqrt(0.25 + 0.2), 1e-12);
  EXPECT_NEAR(state.Gain(more), std::sqrt(0.45) - std::sqrt(1.0 / 7 + 1.0 / 6), 1e-12);
  EXPECT_EQ(state.Gain(-2 * state.Information()), -kInfinity);
  // The first alone has to be determined.
  EXPECT_TRUE(InformationState(Eigen::Vector2d(4, 1).asDiagonal(), 1, projection).IsDetermined());
  EXPECT_FALSE(InformationState(Eigen::Vector2d(4, 1).asDiagonal(), 2, projection).IsDetermined());
  EXPECT_FALSE(
      InformationState(Eigen::Vector2d(1.99, 9).asDiagonal(), 2, projection).IsDetermined());
  EXPECT_TRUE(InformationState(Eigen::Vector2d(2.1, 9).asDiagonal(), 2, projection).IsDetermined());
  EXPECT_FALSE(
      InformationState(Eigen::Vector2d(4, 1.0 / 25).asDiagonal(), 1, projection).IsDetermined());
}

}  // namespace TEST_FILE
}  // namespace plenocal::testing
