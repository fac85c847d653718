// SPDX-License-Identifier: Apache-2.0
#include "assess/views/rig_estimate.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <cmath>

#include "assess/views/information_state.h"
#include "assess/views/next_views.h"
#include "assess/views/projection_sigma.h"
#include "calib/base/error.h"
#include "models/registry.h"
#include "tests/calib/random.h"

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
  try {
    MakeRigEstimate(record);
  } catch (const Error& error) {
    return error.what();
  }
  return "";
}

TEST(RigEstimate, RefusesScenesLocalModelsAndRecordsWithoutPoints) {
  CalibrationRecord record = TwoCameras();
  record.cameras[0].residuals.clear();
  EXPECT_EQ(Refused(record), "");
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
}

// A deformation by independent errors of the markers: all fields are orthogonal to rigid motions of
// the target, and each has the size of one sigma.
TEST(RigUnknowns, AreDeformationsOfATargetWithATolerance) {
  constexpr double kTolerance = 0.002;
  for (const double depth : {0.0, 0.01, 0.3}) {
    Bundle bundle;
    bundle.marker_freedom = MarkerFreedom::FromSigma(kTolerance);
    Random random(3);
    for (int i = 0; i < 12; ++i) {
      const Eigen::Vector3d p(
          random.Uniform(-1, 1), random.Uniform(-0.6, 0.6), random.Uniform(-depth, depth));
      bundle.markers.push_back({.number = 5 * i, .position = p, .nominal = p});
    }
    const RigUnknowns unknowns = MakeRigUnknowns(bundle, 1);
    EXPECT_EQ(unknowns.head, 0);
    // A plane has three linear ones and three bends, a solid six linear ones.
    ASSERT_EQ(unknowns.unit.size(), 6) << depth;
    EXPECT_EQ(unknowns.unit, Eigen::VectorXd::Ones(6));
    ASSERT_EQ(unknowns.deformations.size(), 12U);
    Eigen::Vector3d middle(0, 0, 0);
    for (const BundleMarker& marker : bundle.markers) middle += marker.position / 12;
    for (Eigen::Index k = 0; k < 6; ++k) {
      double squares = 0;
      Eigen::Vector3d moved(0, 0, 0);
      Eigen::Matrix3d mixed = Eigen::Matrix3d::Zero();
      for (const BundleMarker& marker : bundle.markers) {
        const Eigen::Vector3d d = unknowns.deformations.at(marker.number).col(k);
        squares += d.squaredNorm();
        moved += d;
        mixed += d * (marker.position - middle).transpose();
      }
      EXPECT_NEAR(std::sqrt(squares), kTolerance, 1e-12);
      EXPECT_LT(moved.norm(), 1e-12);
    }
    // A stretch of a third axis is among them only where there is depth.
    Eigen::Index bends = 0;
    for (Eigen::Index k = 0; k < 6; ++k) {
      double along_z = 0;
      for (const auto& [number, fields] : unknowns.deformations)
        along_z += std::pow(fields(2, k), 2);
      bends += along_z > 0.9 * kTolerance * kTolerance ? 1 : 0;
    }
    if (depth == 0) {
      EXPECT_EQ(bends, 3);
    }
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
  EXPECT_EQ(PointDistances(bundle, 0), expected);
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
  CameraModel plenoptic = *bundle.cameras[0].model;
  plenoptic.plenoptic = true;
  rig.bundle.cameras[1].model = &plenoptic;
  EXPECT_EQ(ProjectionDistances(rig.bundle).size(), 2U);
}

TEST(RegionOf, IsTheNinthOfTheImage) {
  const ImageSize size{300, 150};
  EXPECT_EQ(RegionOf({0, 0}, size), 0U);
  EXPECT_EQ(RegionOf({150, 0}, size), 1U);
  EXPECT_EQ(RegionOf({299, 0}, size), 2U);
  EXPECT_EQ(RegionOf({0, 75}, size), 3U);
  EXPECT_EQ(RegionOf({299, 149}, size), 8U);
  EXPECT_EQ(RegionOf({-50, 400}, size), 6U);
  EXPECT_EQ(RegionOf({400, -50}, size), 2U);
  // Borders of pixels.
  EXPECT_EQ(RegionOf({99.4, 49.4}, size), 0U);
  EXPECT_EQ(RegionOf({99.6, 49.4}, size), 1U);
  EXPECT_EQ(RegionOf({199.6, 49.4}, size), 2U);
  EXPECT_EQ(RegionOf({99.4, 49.6}, size), 3U);
  EXPECT_EQ(RegionOf({99.4, 99.6}, size), 6U);
}

TEST(ProjectionSigma, IsTheMeanOfResults) {
  const auto result = [](size_t camera, size_t region, double a, double b) {
    const Eigen::Matrix2d by{{a, 0}, {b, a}};
    return ProjectionSigma::Result{camera, region, by};
  };
  const ProjectionSigma sigma({result(0, 2, 1, 2), result(0, 2, 3, 0), result(1, 5, 2, 1)},
                              2,
                              {.of = "points", .unit = "mm", .determined = 3});
  Eigen::Matrix2d C;
  C << 4, 1, 1, 2;
  // tr(J C J') of each: C_00 a^2, and of (b, a) C.
  const auto square = [](double a, double b) {
    return 4 * a * a + 4 * b * b + 2 * a * b + 2 * a * a;
  };
  EXPECT_NEAR(sigma.Of(C), std::sqrt((square(1, 2) + square(3, 0) + square(2, 1)) / 3), 1e-12);
  EXPECT_NEAR(sigma.InRegion(0, 2, C), std::sqrt((square(1, 2) + square(3, 0)) / 2), 1e-12);
  EXPECT_NEAR(sigma.InRegion(1, 5, C), std::sqrt(square(2, 1)), 1e-12);
  EXPECT_TRUE(std::isnan(sigma.InRegion(1, 2, C)));
  EXPECT_EQ(sigma.Of(-C), 0);
  EXPECT_EQ(sigma.Words().unit, "mm");
}

// One error of all unknowns, projected at the points of a grid before and after it; the motion of
// the rig that compensates most of it is found by least squares over numeric derivatives.
TEST(ProjectionSigma, IsWhatAnErrorOfTheUnknownsDisplaces) {
  RigEstimate rig = MakeRigEstimate(TwoCameras());
  rig.factors = {1, 2.25};
  const RigUnknowns unknowns = MakeRigUnknowns(rig.bundle, 1.5);
  const std::vector<double> distances{0.8, 3};
  const ProjectionSigma sigma(rig, unknowns, distances);
  Random random(9);
  const Eigen::VectorXd x = Eigen::VectorXd::NullaryExpr(13, [&] { return random.Gaussian(1); });
  const Eigen::VectorXd scale = UnknownScales(rig, unknowns);
  struct Point {
    size_t camera, region;
    Eigen::Vector3d in_rig;
  };
  std::vector<Point> points;
  for (size_t c = 0; c < 2; ++c) {
    const BundleCamera& camera = rig.bundle.cameras[c];
    for (int row = 0; row < 12; ++row) {
      for (int column = 0; column < 16; ++column) {
        const double u = 20 * (column + 0.5) - 0.5, v = 20 * (row + 0.5) - 0.5;
        const Eigen::Vector3d ray =
            Eigen::Vector3d((u - 160) / 300, (v - 118) / 310, 1).normalized();
        for (const double distance : distances) {
          points.push_back({c,
                            static_cast<size_t>(3 * (row / 4) + (column < 5    ? 0
                                                                 : column < 11 ? 1
                                                                               : 2)),
                            camera.T_camera_rig.Inverse() * (distance * ray)});
        }
      }
    }
  }
  const auto project = [&](const Point& point, double error, const Vector6d& motion) {
    BundleCamera camera = rig.bundle.cameras[point.camera];
    for (size_t k = 0; k < 4; ++k) {
      const int i = unknowns.params[point.camera][k];
      if (i >= 0) camera.params[k] += error * scale[i] * x[i];
    }
    if (const int first = unknowns.extrinsics[point.camera]; first >= 0) {
      camera.T_camera_rig = Retract(
          camera.T_camera_rig, error * scale.segment<6>(first).cwiseProduct(x.segment<6>(first)));
    }
    const Eigen::Vector3d p =
        camera.T_camera_rig * (ExpRotation(motion.tail<3>()) * point.in_rig + motion.head<3>());
    return Eigen::Vector2d(camera.params[0] * p.x() / p.z() + camera.params[2],
                           camera.params[1] * p.y() / p.z() + camera.params[3]);
  };
  constexpr double kStep = 1e-6;
  const auto rows = static_cast<Eigen::Index>(2 * points.size());
  Eigen::MatrixXd A(rows, 6);
  Eigen::VectorXd e(rows);
  const Vector6d zero = Vector6d::Zero();
  for (Eigen::Index i = 0; i < rows / 2; ++i) {
    const Point& point = points[static_cast<size_t>(i)];
    e.segment<2>(2 * i) =
        (project(point, kStep, zero) - project(point, -kStep, zero)) / (2 * kStep);
    for (Eigen::Index k = 0; k < 6; ++k) {
      const Vector6d step = kStep * Vector6d::Unit(k);
      A.block<2, 1>(2 * i, k) = (project(point, 0, step) - project(point, 0, -step)) / (2 * kStep);
    }
  }
  const Eigen::VectorXd rest = e - A * A.householderQr().solve(e);
  const Eigen::MatrixXd C = x * x.transpose();
  EXPECT_NEAR(sigma.Of(C) / std::sqrt(2 * rest.squaredNorm() / static_cast<double>(rows)), 1, 1e-5);
  for (size_t c = 0; c < 2; ++c) {
    for (size_t r = 0; r < kRegions; ++r) {
      double sum = 0, count = 0;
      for (Eigen::Index i = 0; i < rows / 2; ++i) {
        const Point& point = points[static_cast<size_t>(i)];
        if (point.camera != c || point.region != r) continue;
        sum += rest.segment<2>(2 * i).squaredNorm();
        count += 1;
      }
      EXPECT_NEAR(sigma.InRegion(c, r, C) / std::sqrt(sum / count), 1, 1e-4) << c << " " << r;
    }
  }
  EXPECT_THROW(ProjectionSigma(rig, unknowns, {}), Error);
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
