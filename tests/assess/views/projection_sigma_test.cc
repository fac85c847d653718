// SPDX-License-Identifier: Apache-2.0
#include "assess/views/projection_sigma.h"

#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <algorithm>
#include <array>
#include <cmath>

#include "calib/base/error.h"
#include "models/registry.h"
#include "tests/assess/views/virtual_lenses.h"
#include "tests/calib/random.h"

namespace plenocal::testing {
namespace TEST_FILE {

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
  EXPECT_TRUE(std::isnan(sigma.Of(std::nan("") * C)));
  EXPECT_EQ(sigma.Words().unit, "mm");
}

// One error of all unknowns, projected at the points of a grid before and after it; the motion of
// the rig that compensates most of it is found by least squares over numeric derivatives.
void ExpectDisplacements(const RigEstimate& rig) {
  const RigUnknowns unknowns = MakeRigUnknowns(rig.bundle, 1.5);
  const std::vector<double> distances{0.8, 3};
  const ProjectionSigma sigma(rig, unknowns, distances);
  Random random(9);
  const Eigen::VectorXd x =
      Eigen::VectorXd::NullaryExpr(unknowns.head, [&] { return random.Gaussian(1); });
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
}

TEST(ProjectionSigma, IsWhatAnErrorOfTheUnknownsDisplaces) {
  RigEstimate rig;
  for (const bool is_master : {true, false}) {
    rig.bundle.cameras.push_back({.name = is_master ? "left" : "right",
                                  .image_size = {320, 240},
                                  .model = FindModel(CameraModels(), "pinhole"),
                                  .config = {},
                                  .params = {300, 310, 160, 118},
                                  .fixed = {false, is_master, false, false},
                                  .T_camera_rig = {},
                                  .is_master = is_master});
  }
  rig.bundle.cameras[1].T_camera_rig = {ExpRotation({0, 0.1, 0}), {-0.2, 0, 0}};
  rig.factors = {1, 2.25};
  rig.lenses.resize(2);
  ExpectDisplacements(rig);
  EXPECT_THROW(ProjectionSigma(rig, MakeRigUnknowns(rig.bundle, 1.5), {}), Error);
  for (BundleCamera& camera : rig.bundle.cameras) camera.fixed.assign(4, true);
  ExpectDisplacements(rig);  // the extrinsics come first
}

// A projection that no motion changes, and whose derivatives by the parameters are the values that
// it is for: of a place a quarter of the pitch beside the lens nearest to each place of the grid.
TEST(ProjectionSigma, OfAPlenopticCameraIsBesideTheMiddlesOfMicroImages) {
  VirtualLenses made;
  made.model.functions.project_with_jacobian = [](const CameraModel&,
                                                  const double*,
                                                  const double*,
                                                  const double* values,
                                                  const Eigen::Vector3d&,
                                                  double,
                                                  const ProjectionOutput& out) {
    std::fill_n(out.predicted, 2, 0.0);
    std::fill_n(out.J_point, 6, 0.0);
    std::copy_n(values, 4, out.J_params);
    std::fill_n(out.J_params + 4, 4, 0.0);
    return true;
  };
  RigEstimate rig;
  rig.bundle.cameras = {made.camera};
  rig.bundle.cameras[0].fixed.assign(4, false);
  rig.factors = {1};
  rig.lenses.resize(1);
  const RigUnknowns unknowns = MakeRigUnknowns(rig.bundle, 1);
  EXPECT_THROW(ProjectionSigma(rig, unknowns, {1}), Error) << "without lenses";
  rig.lenses[0] = made.array;
  const ProjectionSigma sigma(rig, unknowns, {1});
  std::array<Eigen::Vector4d, kRegions> squares{};
  squares.fill(Eigen::Vector4d::Zero());
  for (int row = 0; row < 12; ++row) {
    for (int column = 0; column < 16; ++column) {
      const Eigen::Vector2d u((column + 0.5) * 285 / 16 - 0.5, (row + 0.5) * 185 / 12 - 0.5);
      Eigen::Vector2d nearest = made.centres[0];
      for (const Eigen::Vector2d& each : made.centres) {
        if ((each - u).norm() < (nearest - u).norm()) nearest = each;
      }
      const double side = (row + column) % 2 == 0 ? 2.5 : -2.5;
      const Eigen::Vector4d values(nearest.x() + side, nearest.y(), nearest.x(), nearest.y());
      squares[RegionOf(u, {285, 185})] += values.cwiseAbs2();
    }
  }
  for (size_t r = 0; r < kRegions; ++r) {
    for (Eigen::Index k = 0; k < 4; ++k) {
      const double count = 4 * (r % 3 == 1 ? 6 : 5);
      const Eigen::Vector4d unit = Eigen::Vector4d::Unit(k) / unknowns.unit[k];
      EXPECT_NEAR(
          sigma.InRegion(0, r, unit * unit.transpose()), std::sqrt(squares[r][k] / count), 1e-9);
    }
  }
}

}  // namespace TEST_FILE
}  // namespace plenocal::testing
