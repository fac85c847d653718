// SPDX-License-Identifier: Apache-2.0
#include "calib/adjust/priors.h"

#include <gtest/gtest.h>

#include <cmath>
#include <map>

#include "calib/adjust/layout.h"
#include "tests/calib/random.h"
#include "tests/calib/synthetic.h"

namespace plenocal::internal {
namespace TEST_FILE {

// Landmarks 0 to 7, of which 3 and 6 have no unknowns.
BundleState Landmarks() {
  testing::Random random(3);
  BundleState bundle;
  for (int i = 0; i < 8; ++i) {
    bundle.markers.push_back(
        {.number = i, .position = random.Direction(), .nominal = Eigen::Vector3d::Zero()});
  }
  bundle.distances = {
      {.markers_a = {2}, .markers_b = {4}, .length = 0.2, .sigma = 0.003, .common_sigma = 0.004},
      {.markers_a = {2, 4, 7}, .markers_b = {5}, .length = 0.7, .sigma = 0.01},
      {.markers_a = {4, 6}, .markers_b = {7}, .length = 0.1, .sigma = 0.001},
      {.markers_a = {4}, .markers_b = {7}, .length = 0.4, .sigma = 0.006, .common_sigma = 0.008}};
  return bundle;
}

int First(int marker) { return marker == 3 || marker == 6 ? -1 : 10 + 3 * marker; }

TEST(RowsOfDistances, AreTheDistancesOfMeansInStandardErrors) {
  const BundleState bundle = Landmarks();
  const std::vector<SparseRow> rows = RowsOfDistances(bundle, {}, First, bundle);
  ASSERT_EQ(rows.size(), 3U);
  const auto p = [&](size_t marker) { return bundle.markers[marker].position; };
  EXPECT_NEAR(rows[1].residual, (((p(2) + p(4) + p(7)) / 3 - p(5)).norm() - 0.7) / 0.01, 1e-9);
  // chi-square of two that share an error, by the inverse of their covariance.
  const Eigen::Vector2d d((p(2) - p(4)).norm() - 0.2, (p(4) - p(7)).norm() - 0.4);
  Eigen::Matrix2d C;
  C << 0.003 * 0.003 + 0.004 * 0.004, 0.004 * 0.008, 0.004 * 0.008, 0.006 * 0.006 + 0.008 * 0.008;
  const Eigen::Vector2d of_two(rows[0].residual, rows[2].residual);
  EXPECT_NEAR(of_two.squaredNorm() / d.dot(C.inverse() * d), 1, 1e-9);
}

TEST(RowsOfDistances, HaveTheDerivativesOfTheirResiduals) {
  BundleState bundle = Landmarks();
  const std::vector<SparseRow> rows = RowsOfDistances(bundle, {}, First, bundle);
  constexpr double kStep = 1e-6;
  for (int i = 0; i < 24; ++i) {
    const auto marker = static_cast<size_t>(i / 3);
    double& value = bundle.markers[marker].position[i % 3];
    value += kStep;
    const std::vector<SparseRow> above = RowsOfDistances(bundle, {}, First, bundle);
    value -= 2 * kStep;
    const std::vector<SparseRow> below = RowsOfDistances(bundle, {}, First, bundle);
    value += kStep;
    for (size_t r = 0; r < rows.size(); ++r) {
      double expected = 0;
      for (const auto& [unknown, J] : rows[r].J) expected += unknown == 10 + i ? J : 0;
      EXPECT_NEAR((above[r].residual - below[r].residual) / (2 * kStep),
                  expected,
                  1e-5 * (1 + std::abs(expected)))
          << r << " " << i;
    }
  }
}

TEST(RowsOfDistances, RefuseEndsAtOnePlace) {
  BundleState bundle = Landmarks();
  bundle.markers[7].position = bundle.markers[4].position;
  const std::vector<SparseRow> rows = RowsOfDistances(bundle, {}, First, bundle);
  ASSERT_EQ(rows.size(), 3U);
  EXPECT_FALSE(std::isfinite(rows[2].residual));
}

// The first marker's unknowns may come first of all.
TEST(RowsOfDistances, LeadToUnknownsFromTheFirstOn) {
  BundleState bundle = Landmarks();
  bundle.distances = {{.markers_a = {0}, .markers_b = {1}, .length = 0.7, .sigma = 0.5}};
  const std::vector<SparseRow> rows = RowsOfDistances(
      bundle, {}, [](int marker) { return 3 * marker; }, bundle);
  ASSERT_EQ(rows.size(), 1u);
  const Eigen::Vector3d along =
      (bundle.markers[0].position - bundle.markers[1].position).normalized() / 0.5;
  for (int i = 0; i < 3; ++i) {
    EXPECT_NEAR(rows[0].J.at(i), along[i], 1e-12);
    EXPECT_NEAR(rows[0].J.at(3 + i), -along[i], 1e-12);
  }
}

// Two cameras with priors of parameters, of an earlier calibration and of scales.
Bundle WithPriors() {
  Bundle bundle = testing::TrueBundle(testing::MakeProblem(3, {.cameras = 2, .frames = 2}));
  for (BundleCamera& camera : bundle.cameras) camera.rules.resize(camera.params.size());
  bundle.cameras[0].rules[2].prior = {.value = bundle.cameras[0].params[2] - 0.6, .sigma = 0.3};
  bundle.cameras[1].rules[3].prior = {.value = bundle.cameras[1].params[3] + 5, .sigma = 0.5};
  bundle.cameras[1].fixed[3] = true;
  bundle.marker_freedom = MarkerFreedom::Held();
  bundle.scales = {{.axes = Eigen::Vector3d::UnitX(), .sigma = 0.004, .value = 0.001},
                   {.axes = Eigen::Vector3d::UnitY(), .sigma = 0.002, .value = -0.003}};
  CalibrationPrior prior;
  Vector6d off;
  off << 0.01, -0.02, 0.03, 0.2, -0.3, 0.1;
  for (const BundleCamera& camera : bundle.cameras)
    prior.T_camera_rig.push_back(Retract(camera.T_camera_rig, off));
  prior.unknowns = {{.camera = 1, .param = 0, .value = bundle.cameras[1].params[0] + 2},
                    {.camera = 1, .param = 3, .value = bundle.cameras[1].params[3] - 1}};
  for (Eigen::Index i = 0; i < 6; ++i) prior.unknowns.push_back({.camera = 1, .component = i});
  prior.weight = Eigen::MatrixXd::Identity(8, 8);
  for (int i = 0; i < 8; ++i) prior.weight(i, (3 * i + 1) % 8) += 0.3 * i + 0.2;
  bundle.prior = prior;
  return bundle;
}

TEST(RowsOfPriors, AreDeviationsInStandardErrorsWithTheirDerivatives) {
  const Bundle bundle = WithPriors();
  const UnknownLayout layout = MakeLayout(bundle, true);
  const std::vector<SparseRow> rows = RowsOfPriors(bundle, layout);
  // The prior of a fixed parameter has no row.
  ASSERT_EQ(rows.size(), 1u + 8 + 2);
  EXPECT_NEAR(rows[0].residual, 2, 1e-9);
  EXPECT_EQ(rows[0].J, (std::map<int, double>{{layout.params[0][2], 1 / 0.3}}));
  Eigen::VectorXd deviation(8);
  deviation << -2, 1,
      LocalCoordinates(bundle.prior->T_camera_rig[1], bundle.cameras[1].T_camera_rig);
  const Eigen::VectorXd weighted = bundle.prior->weight * deviation;
  for (int i = 0; i < 8; ++i)
    EXPECT_NEAR(rows[static_cast<size_t>(i) + 1].residual, weighted[i], 1e-9);
  EXPECT_NEAR(rows[9].residual, 0.25, 1e-12);
  EXPECT_NEAR(rows[10].residual, -1.5, 1e-12);
  constexpr double kStep = 1e-6;
  for (int k = 0; k < layout.head; ++k) {
    const auto moved = [&](double step) {
      Bundle other = bundle;
      Move(layout, step * Eigen::VectorXd::Unit(layout.total, k), &other);
      return RowsOfPriors(other, layout);
    };
    const std::vector<SparseRow> above = moved(kStep), below = moved(-kStep);
    for (size_t r = 0; r < rows.size(); ++r) {
      const auto found = rows[r].J.find(k);
      const double expected = found == rows[r].J.end() ? 0 : found->second;
      EXPECT_NEAR((above[r].residual - below[r].residual) / (2 * kStep),
                  expected,
                  1e-5 * (1 + std::abs(expected)))
          << r << ' ' << k;
    }
  }
  Bundle none = bundle;
  none.prior.reset();
  EXPECT_TRUE(RowsOfCalibrationPrior(none, layout).empty());
  EXPECT_EQ(RowsOfPriors(none, layout).size(), 3u);
}

// Scales, or a parameter of an earlier calibration, that are the first unknown.
TEST(RowsOfPriors, LeadToUnknownsFromTheFirstOn) {
  Bundle bundle = WithPriors();
  bundle.prior->unknowns = {{.camera = 0, .param = 0, .value = bundle.cameras[0].params[0] - 3}};
  bundle.prior->weight = Eigen::MatrixXd::Constant(1, 1, 2);
  const std::vector<SparseRow> rows = RowsOfCalibrationPrior(bundle, MakeLayout(bundle, true));
  ASSERT_EQ(rows.size(), 1u);
  EXPECT_EQ(rows[0].J, (std::map<int, double>{{0, 2}}));
  EXPECT_NEAR(rows[0].residual, 6, 1e-9);
  bundle.prior.reset();
  for (BundleCamera& camera : bundle.cameras) {
    camera.fixed.assign(camera.params.size(), true);
    camera.is_master = true;
  }
  const std::vector<SparseRow> scales = RowsOfPriors(bundle, MakeLayout(bundle));
  ASSERT_EQ(scales.size(), 2u);
  EXPECT_EQ(scales[0].J, (std::map<int, double>{{0, 1 / 0.004}}));
  EXPECT_EQ(scales[1].J, (std::map<int, double>{{1, 1 / 0.002}}));
  bundle.distances = {{.markers_a = {3}, .markers_b = {40}, .length = 0.2, .sigma = 0.003}};
  const UnknownLayout layout = MakeLayout(bundle);
  const std::vector<SparseRow> distances = RowsOfDistances(bundle, layout);
  const Eigen::Vector3d apart = bundle.markers[3].position - bundle.markers[40].position;
  for (int axis = 0; axis < 2; ++axis) {
    const double by = (bundle.markers[3].nominal - bundle.markers[40].nominal)[axis];
    EXPECT_NEAR(distances.at(0).J.at(axis), apart.normalized()[axis] * by / 0.003, 1e-9);
  }
}

TEST(AddInformation, IsOfTheLowerTriangleBeforeWhatIsLeftOut) {
  const std::vector<SparseRow> rows{{.J = {{0, 2}, {2, -3}, {3, 5}}, .residual = 7},
                                    {.J = {{2, 1}}, .residual = 1}};
  Eigen::MatrixXd all = Eigen::MatrixXd::Ones(4, 4), some = all, expected = all;
  AddInformation(rows, &all);
  AddInformation(rows, &some, 2);
  expected(0, 0) += 4, expected(2, 0) -= 6, expected(3, 0) += 10;
  EXPECT_EQ(some, expected);
  expected(2, 2) += 9 + 1, expected(3, 2) -= 15, expected(3, 3) += 25;
  EXPECT_EQ(all, expected);
}

// Distances between markers of one target and of another, which is turned and printed too large.
TEST(RowsOfDistances, FollowTargetsAndScales) {
  Bundle bundle = testing::TrueBundle(
      testing::MakeProblem(3, {.cameras = 1, .frames = 2, .marker_tolerance = 0.001}));
  RigidTransform pose;
  pose.t = {0.1, 0.2, 0.05};
  bundle.targets = {{"first", {}, true}, {"second", pose, false}};
  for (size_t m = 0; m < 20; ++m) bundle.markers[m].target = 1;
  bundle.scales = {{.target = 1, .axes = Eigen::Vector3d::Ones(), .sigma = 0.01}};
  bundle.distances = {{.markers_a = {3, 4}, .markers_b = {40}, .length = 0.2, .sigma = 0.003},
                      {.markers_a = {30}, .markers_b = {55}, .length = 0.1, .sigma = 0.002}};
  bundle.scale_distance =
      MarkerDistance{.markers_a = {5}, .markers_b = {25}, .length = 0.3, .sigma = 0.001};
  pose.R = ExpRotation({0.3, -0.2, 0.4});
  MoveTarget(1, pose, &bundle);
  const UnknownLayout layout = MakeLayout(bundle);
  const std::vector<SparseRow> rows = RowsOfDistances(bundle, layout);
  ASSERT_EQ(rows.size(), 3u);
  const auto p = [&](size_t marker) { return bundle.markers[marker].position; };
  EXPECT_NEAR(rows[0].residual, (((p(3) + p(4)) / 2 - p(40)).norm() - 0.2) / 0.003, 1e-9);
  EXPECT_NEAR(rows[2].residual, ((p(5) - p(25)).norm() - 0.3) / 0.001, 1e-9);
  constexpr double kStep = 1e-7;
  for (int k = layout.targets[1]; k < layout.total; ++k) {
    const auto moved = [&](double step) {
      Bundle other = bundle;
      Move(layout, step * Eigen::VectorXd::Unit(layout.total, k), &other);
      return RowsOfDistances(other, layout);
    };
    const std::vector<SparseRow> above = moved(kStep), below = moved(-kStep);
    for (size_t r = 0; r < rows.size(); ++r) {
      const auto found = rows[r].J.find(k);
      const double expected = found == rows[r].J.end() ? 0 : found->second;
      ASSERT_NEAR((above[r].residual - below[r].residual) / (2 * kStep),
                  expected,
                  1e-4 * (1 + std::abs(expected)))
          << r << ' ' << k - layout.head;
    }
  }
  bundle.marker_freedom = {};
  EXPECT_TRUE(RowsOfDistances(bundle, MakeLayout(bundle)).empty());
}

}  // namespace TEST_FILE
}  // namespace plenocal::internal
