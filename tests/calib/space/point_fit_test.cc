// SPDX-License-Identifier: Apache-2.0
//
// Points in space over draws of the calibration and of noise: errors are as large as stated, alone
// and together, near and far.
#include "calib/space/point_fit.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <cmath>
#include <functional>
#include <string>
#include <vector>

#include "calib/base/statistics.h"
#include "calib/camera/rays.h"
#include "calib/space/common_errors.h"
#include "calib/space/measures.h"
#include "models/registry.h"
#include "tests/calib/space/uncertain_rig.h"

namespace plenocal {
namespace TEST_FILE {

using namespace testing;  // NOLINT

SpacePoint ExactPoint(const SpaceRig& rig, const Eigen::Vector3d& X, double h) {
  Random none(0);
  std::vector<SpaceObservation> seen;
  for (size_t c = 0; c < rig.cameras.size(); ++c) {
    SpaceObservation each{.camera = c, .sigma = kNoise};
    EXPECT_TRUE(ImageOf(rig.cameras[c], X, h, each.values.data()));
    seen.push_back(each);
  }
  return FitPoint(rig, seen);
}

TEST(PointFit, ExactRaysMeetInTheirPointAtInfinityAndBeyond) {
  for (const std::string model : {"pinhole-radial3", "kannala-brandt4", "spherical"}) {
    SCOPED_TRACE(model);
    const SpaceRig rig = MakeSpaceRig(UncertainRig({.models = {model, model}}), {});
    const Eigen::Vector3d direction = Eigen::Vector3d(0.1, -0.05, 1).normalized();
    for (const double rho : {2.0, 0.1, 1e-3, 0.0, -0.01}) {
      const SpacePoint point = ExactPoint(rig, direction, rho);
      ASSERT_TRUE(point.IsFound()) << point.reason;
      // The point is stated about the middle of the two centres.
      const Eigen::Vector3d middle = rig.cameras[1].T_camera_rig.Inverse().t / 2;
      EXPECT_LT((point.o - middle).norm(), 1e-12);
      const Eigen::Vector4d expected(direction.x(), direction.y(), direction.z(), rho);
      Eigen::Vector4d found;
      found << point.rho * point.o + point.m, point.rho;
      EXPECT_LT((found.normalized() - expected.normalized()).norm(), 1e-7) << rho;
      EXPECT_NEAR(point.chi_square, 0, 1e-9);
    }
  }
}

// Noise of a camera counts by its variance, a distance from a ray does not.
TEST(PointFit, IsTheMostLikelyPoint) {
  const SpaceRig rig = MakeSpaceRig(
      UncertainRig({.models = {"pinhole-radial3", "kannala-brandt4", "pinhole-radial3"}}), {});
  const Eigen::Vector3d X(0.1, -0.05, 0.8);
  Random random(17);
  std::vector<SpaceObservation> seen = Seen(rig.cameras, X, 1, 0, &random);
  ASSERT_EQ(seen.size(), 3U);
  for (size_t i = 0; i < seen.size(); ++i) {
    seen[i].values[1] += 3 * kNoise;
    seen[i].sigma = kNoise * std::pow(4, static_cast<double>(i));
  }
  const auto cost = [&](const Eigen::Vector3d& at) {
    double sum = 0;
    for (const SpaceObservation& each : seen) {
      std::array<double, kMaxObservationSize> u{};
      EXPECT_TRUE(ImageOf(rig.cameras[each.camera], at, 1, u.data()));
      for (size_t k = 0; k < 2; ++k) sum += std::pow((each.values[k] - u[k]) / each.sigma, 2);
    }
    return sum;
  };
  const SpacePoint point = FitPoint(rig, seen);
  ASSERT_TRUE(point.IsFound()) << point.reason;
  for (int axis = 0; axis < 3; ++axis) {
    for (const double side : {-1.0, 1.0}) {
      // Where a standard error adds 1 to the sum, a twentieth of it adds 1/400.
      const Eigen::Vector3d step =
          side / 20 * std::sqrt(point.noise(axis, axis)) * Eigen::Vector3d::Unit(axis);
      EXPECT_GT(cost(point.position + step), cost(point.position)) << axis;
    }
  }
}

/// Means over draws of calibration and noise of the rig's points at some distances.
struct Draws {
  double points = 0, length = 0, rays = 0, rho_held = 0;  // mean squares by their expectation
  int count = 0;
};

Draws DrawMany(const RigOptions& options, const std::vector<double>& distances, int draws) {
  SpaceRig rig = MakeSpaceRig(UncertainRig(options), {});
  rig.correlation = options.correlation;
  Random random(7);
  Draws sums;
  for (int i = 0; i < draws; ++i) {
    Eigen::VectorXd drawn(rig.root.cols());
    for (Eigen::Index k = 0; k < drawn.size(); ++k) drawn[k] = random.Gaussian(1);
    std::vector<BundleCamera> truth = Moved(rig, rig.root * drawn);
    std::vector<SpacePoint> points;
    std::vector<Eigen::Vector3d> at;
    rig.centre.setZero();
    for (const double distance : distances) {
      at.push_back(distance * Eigen::Vector3d(0.05, 0.08 - 0.03 * distance / 10, 1));
      rig.centre += at.back() / static_cast<double>(distances.size());
    }
    for (size_t c = 0; c < truth.size() && rig.frame_columns > 0; ++c) {
      const auto first = rig.Size() - rig.frame_columns + 6 * static_cast<Eigen::Index>(c);
      const Vector6d delta = (rig.root * drawn).segment<6>(first);
      const Eigen::Matrix3d R = ExpRotation(delta.tail<3>());
      truth[c].T_camera_rig =
          truth[c].T_camera_rig *
          RigidTransform{R, rig.centre - R * rig.centre + Eigen::Vector3d(delta.head<3>())};
    }
    for (const Eigen::Vector3d& X : at) {
      std::vector<SpaceObservation> seen = Seen(truth, X, 1, options.common_noise, &random);
      if (options.correlation > 0) {
        // From independent noise to that with a common part.
        const Eigen::Vector2d common = random.Gaussians<2>(kNoise * std::sqrt(options.correlation));
        for (SpaceObservation& each : seen) {
          std::array<double, kMaxObservationSize> exact{};
          if (!ImageOf(truth[each.camera], X, 1, exact.data())) return sums;
          for (size_t k = 0; k < 2; ++k) {
            each.values[k] = exact[k] +
                             std::sqrt(1 - options.correlation) * (each.values[k] - exact[k]) +
                             common[static_cast<Eigen::Index>(k)];
          }
        }
      }
      points.push_back(FitPoint(rig, seen));
      if (!points.back().IsFound()) return sums;
    }
    // All points together, with the covariance that they share.
    const auto n = static_cast<Eigen::Index>(3 * points.size());
    Eigen::VectorXd error(n);
    Eigen::MatrixXd root(n, rig.root.cols()), covariance = Eigen::MatrixXd::Zero(n, n);
    double held = 0;
    for (size_t k = 0; k < points.size(); ++k) {
      const auto row = static_cast<Eigen::Index>(3 * k);
      error.segment<3>(row) = points[k].position - at[k];
      root.middleRows(row, 3) = points[k].shared;
      covariance.block<3, 3>(row, row) = points[k].noise;
      const double rho = 1 / (at[k] - points[k].o).norm();
      held += std::pow((points[k].rho - rho) / points[k].sigma_rho, 2);
    }
    covariance += root * root.transpose();
    sums.points += error.dot(covariance.inverse() * error) / static_cast<double>(n);
    sums.rho_held += held / static_cast<double>(points.size());
    const Measured length = LengthOf(points[0], points[1]);
    sums.length += std::pow((length.value - (at[0] - at[1]).norm()) / length.Sigma(), 2);
    const RaysTest test = CommonErrors(points).Test();
    sums.rays += test.chi_square / test.degrees;
    ++sums.count;
  }
  for (double* sum : {&sums.points, &sums.length, &sums.rays, &sums.rho_held}) {
    *sum /= sums.count;
  }
  return sums;
}

void ExpectTrue(const RigOptions& options, const std::vector<double>& distances) {
  constexpr int kDraws = 300;
  const Draws means = DrawMany(options, distances, kDraws);
  ASSERT_EQ(means.count, kDraws);
  ExpectOne(means.points, kDraws, 3 * static_cast<int>(distances.size()), "points");
  ExpectOne(means.length, kDraws, 1, "length");
  // Those of one calibration are alike: counted once a draw.
  ExpectOne(means.rho_held, kDraws, 1, "inverse distance");
  ExpectOne(means.rays, kDraws, 1, "rays");
}

TEST(PointFit, StandardErrorsHoldForAPair) { ExpectTrue({}, {1, 1.3, 2}); }

TEST(PointFit, StandardErrorsHoldWhereTheCalibrationDecides) {
  ExpectTrue({.calibration = 5}, {0.8, 1.5, 2});
}

TEST(PointFit, StandardErrorsHoldForFisheyes) {
  ExpectTrue({.models = {"kannala-brandt4", "pinhole-radial3", "kannala-brandt4"}}, {0.7, 1, 2});
}

TEST(PointFit, StandardErrorsHoldForAPlenopticCamera) {
  ExpectTrue({.models = {"focused-plenoptic"}, .calibration = 0.1, .common_noise = 0.04},
             {0.8, 1, 1.2});
}

TEST(PointFit, StandardErrorsHoldWithDisplacementsThatTheCalibrationStates) {
  ExpectTrue({.models = {"focused-plenoptic"}, .calibration = 0.1, .nuisances = true},
             {0.8, 1, 1.2});
}

TEST(PointFit, StandardErrorsHoldForAPlenopticCameraOnARig) {
  ExpectTrue({.models = {"pinhole-radial3", "focused-plenoptic"}, .common_noise = 0.04},
             {0.8, 1, 1.2});
}

TEST(PointFit, StandardErrorsHoldForNoiseThatIsCommonToCameras) {
  const std::string model = "pinhole-radial3";
  ExpectTrue({.models = {model, model, model}, .calibration = 0.1, .correlation = 0.7},
             {1, 1.3, 2});
}

TEST(PointFit, StandardErrorsHoldWithTheJitterOfAFrame) {
  ExpectTrue({.calibration = 0.1, .jitter = {.translation_sigma = 3e-4, .rotation_sigma = 2e-3}},
             {1, 1.3, 2});
}

TEST(PointFit, IntervalsOfFarPointsHoldInInverseDistance) {
  const SpaceRig rig = MakeSpaceRig(UncertainRig({.calibration = 0.1}), {});
  Random random(11);
  const Eigen::Vector3d X(12, 6, 400);
  int held = 0, open = 0;
  constexpr int kDraws = 400;
  for (int i = 0; i < kDraws; ++i) {
    Eigen::VectorXd drawn(rig.root.cols());
    for (Eigen::Index k = 0; k < drawn.size(); ++k) drawn[k] = random.Gaussian(1);
    const SpacePoint point = FitPoint(rig, Seen(Moved(rig, rig.root * drawn), X, 1, 0, &random));
    ASSERT_TRUE(point.IsFound()) << point.reason;
    const DistanceInterval interval = DistanceOf(point, 1.96);
    const double distance = (X - point.o).norm();
    held += interval.nearest <= distance && distance <= interval.farthest ? 1 : 0;
    open += std::isinf(interval.farthest) ? 1 : 0;
  }
  // 380 of 400 by chance, within 3.5 standard deviations of a binomial number.
  EXPECT_NEAR(held, 0.95 * kDraws, 3.5 * std::sqrt(kDraws * 0.95 * 0.05));
  EXPECT_GT(open, 0);
  EXPECT_LT(open, kDraws);
}

// The motion of the calibration's points for an error of theta, from their images alone.
Vector6d FollowedBy(const SpaceRig& rig,
                    const CalibrationRecord& record,
                    const std::vector<BundleCamera>& moved) {
  const auto image = [](const BundleCamera& camera, const Eigen::Vector3d& X) {
    std::array<double, kMaxObservationSize> values{};
    EXPECT_TRUE(ImageOf(camera, X, 1, values.data()));
    return Eigen::Vector2d(values[0], values[1]);
  };
  std::vector<double> change;
  std::vector<Vector6d> by_motion;
  for (size_t c = 0; c < moved.size(); ++c) {
    for (const auto& [number, marker] : record.markers) {
      const Eigen::Vector3d& X = marker.position;
      const Eigen::Vector2d d = image(moved[c], X) - image(rig.cameras[c], X);
      Eigen::Matrix<double, 2, 6> A;
      for (int i = 0; i < 6; ++i) {
        constexpr double kStep = 1e-6;
        const RigidTransform T = Exp(Vector6d(kStep * Vector6d::Unit(i)));
        A.col(i) = (image(rig.cameras[c], T * X) - image(rig.cameras[c], X)) / kStep;
      }
      for (int k = 0; k < 2; ++k) {
        change.push_back(d[k]);
        by_motion.emplace_back(A.row(k));
      }
    }
  }
  Eigen::MatrixXd A(change.size(), 6);
  for (size_t i = 0; i < change.size(); ++i) A.row(static_cast<Eigen::Index>(i)) = by_motion[i];
  const Eigen::Map<Eigen::VectorXd> d(change.data(), A.rows());
  return A.colPivHouseholderQr().solve(-d);
}

TEST(PointFit, InTheHousingsFrameTheCalibrationsPointsHold) {
  CalibrationRecord record = UncertainRig({});
  record.frames.push_back({"0", {}});
  for (int i = 0; i < 40; ++i) {
    record.markers[i].position = {0.05 * (i % 8) - 0.2, 0.05 * (i / 8) - 0.1, 0.7 + 0.02 * (i % 7)};
    for (CalibratedCamera& camera : record.cameras) {
      camera.residuals.push_back({.frame = 0, .marker = i, .noise_sigma = kNoise});
    }
  }
  const SpaceRig rig = MakeSpaceRig(record, {});
  Random random(2);
  Eigen::VectorXd drawn(rig.root.cols());
  for (Eigen::Index k = 0; k < drawn.size(); ++k) drawn[k] = random.Gaussian(0.1);
  const Eigen::VectorXd theta = rig.root * drawn;
  const std::vector<BundleCamera> moved = Moved(rig, theta);
  const Vector6d followed = FollowedBy(rig, record, moved);
  EXPECT_LT((rig.follow * theta - followed).norm(), 1e-2 * followed.norm());

  // The calibration is `rig`, the truth is `moved`: a point's error less that of its neighbours.
  const Eigen::Vector3d X(0.02, -0.03, 1.2);
  std::vector<SpaceObservation> seen(2);
  for (size_t c = 0; c < 2; ++c) {
    seen[c] = {.camera = c, .sigma = kNoise};
    ASSERT_TRUE(ImageOf(moved[c], X, 1, seen[c].values.data()));
  }
  const SpacePoint in_rig = FitPoint(rig, seen), held = FitPoint(rig, seen, SpaceFrame::kHousing);
  const Eigen::Vector3d error = in_rig.position - X;
  const Eigen::Vector3d motion = followed.head<3>() + Eigen::Vector3d(followed.tail<3>()).cross(X);
  // The truth is at theta, the calibration at zero: errors are those of -theta.
  EXPECT_LT((in_rig.shared * drawn + error).norm(), 2e-2 * error.norm());
  EXPECT_LT((held.shared * drawn + error + motion).norm(), 2e-2 * error.norm());
}

TEST(PointFit, StatesWhyThereIsNoPoint) {
  const SpaceRig rig = MakeSpaceRig(UncertainRig({}), {});
  SpaceObservation left{.camera = 0, .values = {300, 200}, .sigma = kNoise};
  EXPECT_THAT(FitPoint(rig, {&left, 1}).reason, ::testing::HasSubstr("one ray"));
  const std::vector<SpaceObservation> twice{left, left};
  EXPECT_THAT(FitPoint(rig, twice).reason, ::testing::HasSubstr("no parallax"));
}

// Other factors with the old correlations would invent vergence (`ScaleAlike`).
TEST(SpaceRig, ScalesTheStandardErrorsOfAllCamerasAlike) {
  CalibrationRecord record = UncertainRig({});
  const SpaceRig plain = MakeSpaceRig(record, {});
  record.findings.push_back({.code = "points_share_errors", .cameras = {"camera0"}, .value = 2.0});
  const SpaceRig scaled = MakeSpaceRig(record, {});
  ASSERT_EQ(plain.unknowns.size(), scaled.unknowns.size());
  for (size_t i = 0; i < plain.unknowns.size(); ++i) {
    const auto row = static_cast<Eigen::Index>(i);
    const double factor = plain.unknowns[i].camera == 0 ? 1 : 2;
    EXPECT_NEAR(scaled.root.row(row).norm(), factor * plain.root.row(row).norm(), 1e-9) << i;
  }
}

TEST(SpaceRig, HasTheCalibrationsCovarianceBetweenCameras) {
  CalibrationRecord record = UncertainRig({});
  for (const CalibratedCamera& camera : record.cameras) {
    for (const Param& param : camera.model->params) {
      record.correlations.names.push_back(camera.name + "." + std::string(param.name));
    }
  }
  const auto n = static_cast<Eigen::Index>(record.correlations.names.size());
  record.correlations.matrix =
      0.5 * Eigen::MatrixXd::Identity(n, n) + 0.5 * Eigen::MatrixXd::Ones(n, n);
  const SpaceRig rig = MakeSpaceRig(record, {});
  const Eigen::MatrixXd C = rig.root * rig.root.transpose();
  int between = 0;
  for (size_t i = 0; i < rig.unknowns.size(); ++i) {
    for (size_t j = 0; j < rig.unknowns.size(); ++j) {
      const auto &a = rig.unknowns[i], &b = rig.unknowns[j];
      if (!a.param || !b.param || i == j) continue;
      const double sigmas =
          record.cameras[a.camera].Sigma(*a.param) * record.cameras[b.camera].Sigma(*b.param);
      EXPECT_NEAR(C(static_cast<Eigen::Index>(i), static_cast<Eigen::Index>(j)),
                  0.5 * sigmas,
                  1e-6 * sigmas)
          << i << " " << j;
      between += a.camera != b.camera ? 1 : 0;
    }
  }
  EXPECT_GT(between, 0);
}

// A bent board displaces points alike in all cameras; their rays meet all the same.
TEST(SpaceRig, HasTheNoiseThatCamerasDoNotShare) {
  const auto factor = [](double bent, double noise) {
    CalibrationRecord record = UncertainRig({});
    Random random(12);
    record.frames.resize(1);
    for (int i = 0; i < 300; ++i) {
      const Eigen::Vector3d X(random.Uniform(-0.2, 0.2), random.Uniform(-0.1, 0.1), 0.8);
      record.markers[i].position = X;
      const Eigen::Vector3d displaced = X + random.Gaussians<3>(bent);
      for (CalibratedCamera& camera : record.cameras) {
        ResidualRow row{.frame = 0, .marker = i, .noise_sigma = kNoise};
        double expected[2];
        EXPECT_TRUE(Project(camera, row.values.data(), camera.T_camera_rig * X, expected));
        EXPECT_TRUE(
            Project(camera, row.values.data(), camera.T_camera_rig * displaced, row.values.data()));
        for (size_t k = 0; k < 2; ++k) {
          row.values[k] += random.Gaussian(noise);
          row.residual[k] = row.values[k] - expected[k];
        }
        camera.residuals.push_back(row);
        camera.fit.noise_sigma = kNoise;
      }
    }
    const SpaceRig rig = MakeSpaceRig(record, {});
    EXPECT_DOUBLE_EQ(rig.NoiseOf(0, 0), rig.noise_factor * kNoise);
    return rig.noise_factor;
  };
  EXPECT_EQ(factor(0, kNoise), 1);
  EXPECT_NEAR(factor(1e-4, kNoise / 3), 1.0 / 3, 0.05);
  EXPECT_NEAR(factor(0, 2 * kNoise), 2, 0.25);
}

TEST(SpaceRig, HasTheCalibrationsNoiseForTheDetectorsSigma) {
  CalibrationRecord record = UncertainRig({});
  CameraFit& fit = record.cameras[0].fit;
  fit.noise_sigma = 0.05;
  fit.common_noise = 0.03;  // 0.04 of its own
  fit.detector_sigma = 0;
  EXPECT_NEAR(MakeSpaceRig(record, {}).NoiseOf(0, 0.02), 0.04, 1e-12);
  fit.detector_sigma = 0.08;  // stated twice too large
  EXPECT_NEAR(MakeSpaceRig(record, {}).NoiseOf(0, 0.1), 0.05, 1e-12);
  fit.detector_sigma = 0.024;  // too small by 0.032
  EXPECT_NEAR(MakeSpaceRig(record, {}).NoiseOf(0, 0.06), std::hypot(0.06, 0.032), 1e-12);
  EXPECT_NEAR(MakeSpaceRig(record, {}).NoiseOf(0, 0), 0.04, 1e-12);
  const CalibrationRecord plenoptic = UncertainRig({.models = {"focused-plenoptic"}});
  EXPECT_NEAR(MakeSpaceRig(plenoptic, {}).NoiseOf(0, 0), kNoise, 1e-12);
}

TEST(Measures, AngleAndPlaneHaveTheStandardErrorsOfTheirDerivatives) {
  const SpaceRig rig = MakeSpaceRig(UncertainRig({.calibration = 3}), {});
  Random random(5);
  double angles = 0, planes = 0;
  constexpr int kDraws = 300;
  const std::vector<Eigen::Vector3d> at{
      {-0.2, -0.1, 1}, {0.2, -0.1, 1.1}, {0.2, 0.15, 1.2}, {-0.2, 0.15, 1.1}, {0, 0.025, 1.1}};
  const double angle = std::acos((at[0] - at[1]).normalized().dot((at[2] - at[1]).normalized()));
  for (int i = 0; i < kDraws; ++i) {
    Eigen::VectorXd drawn(rig.root.cols());
    for (Eigen::Index k = 0; k < drawn.size(); ++k) drawn[k] = random.Gaussian(1);
    const std::vector<BundleCamera> truth = Moved(rig, rig.root * drawn);
    std::vector<SpacePoint> points;
    for (const Eigen::Vector3d& X : at)
      points.push_back(FitPoint(rig, Seen(truth, X, 1, 0, &random)));
    const Measured found = AngleOf(points[0], points[1], points[2]);
    angles += std::pow((found.value - angle) / found.Sigma(), 2) / kDraws;
    std::vector<const SpacePoint*> of_plane;
    for (const SpacePoint& point : points) of_plane.push_back(&point);
    const MeasuredPlane plane = PlaneOf(of_plane);
    ASSERT_EQ(plane.degrees, 2);
    planes += plane.chi_square / 2 / kDraws;
  }
  ExpectOne(angles, kDraws, 1, "angle");
  ExpectOne(planes, kDraws, 2, "plane");
}

}  // namespace TEST_FILE
}  // namespace plenocal
