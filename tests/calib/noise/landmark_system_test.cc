// SPDX-License-Identifier: Apache-2.0
#include "calib/noise/landmark_system.h"

#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <algorithm>
#include <numeric>
#include <vector>

#include "calib/adjust/priors.h"
#include "calib/noise/camera_noise.h"
#include "tests/calib/random.h"
#include "tests/calib/synthetic.h"

namespace plenocal {
namespace TEST_FILE {

using testing::Random;
using internal::UnknownLayout;

// A pair's four frames with every seventh point of the target as landmark, noise of half a pixel,
// f_y of the left camera tied to its f_x.
Bundle LandmarkBundle() {
  Random random(3);
  Bundle bundle = testing::TrueBundle(testing::MakeProblem(
      11, {.shape = testing::TargetShape::kCorner, .cameras = 2, .frames = 4}));
  std::vector<BundleMarker> kept;
  std::vector<int> index(bundle.markers.size(), -1);
  for (size_t m = 0; m < bundle.markers.size(); m += 7) {
    index[m] = static_cast<int>(kept.size());
    kept.push_back(bundle.markers[m]);
  }
  bundle.markers = kept;
  std::erase_if(bundle.observations, [&](const BundleObservation& each) {
    return index[static_cast<size_t>(each.marker)] < 0;
  });
  for (BundleObservation& each : bundle.observations) {
    each.marker = index[static_cast<size_t>(each.marker)];
    each.assumed_sigma = random.Uniform(0.3, 0.8);
    for (size_t i = 0; i < 2; ++i) each.seen.values[i] += random.Gaussian(0.5);
  }
  bundle.observations[5].used = false;
  bundle.marker_freedom = MarkerFreedom::Landmarks();
  bundle.fixed_frame = 1;
  bundle.cameras[0].rules.resize(bundle.cameras[0].params.size());
  bundle.cameras[0].rules[1].tied_to = ParamIndex{0, 0};
  bundle.cameras[0].params[1] = bundle.cameras[0].params[0];
  bundle.cameras[1].fixed[4] = true;
  return bundle;
}

// The bundle after a step of the system's unknowns, then three of each landmark.
Bundle Moved(Bundle bundle,
             const UnknownLayout& layout,
             const PoseSystem& system,
             const Eigen::VectorXd& step) {
  Eigen::VectorXd by_layout = Eigen::VectorXd::Zero(layout.total);
  by_layout.head(layout.head) = step.head(layout.head);
  Move(layout, by_layout, &bundle);
  for (size_t f = 0; f < system.pose.size(); ++f) {
    if (system.pose[f] < 0) continue;
    bundle.T_rig_target[f] = Retract(bundle.T_rig_target[f], step.segment<6>(system.pose[f]));
  }
  for (size_t m = 0; m < bundle.markers.size(); ++m) {
    bundle.markers[m].position += step.segment<3>(system.Size() + 3 * static_cast<Eigen::Index>(m));
  }
  return bundle;
}

// All residuals in their standard deviations; of the observations of one landmark, if it is given.
Eigen::VectorXd ResidualsOf(const Bundle& bundle, int landmark = -1) {
  std::vector<double> all;
  const auto residuals = Residuals(bundle);
  for (size_t i = 0; i < residuals.size(); ++i) {
    const BundleObservation& each = bundle.observations[i];
    if (!each.used || (landmark >= 0 && each.marker != landmark)) continue;
    for (size_t r = 0; r < 2; ++r) all.push_back(residuals[i][r] / each.assumed_sigma);
  }
  return Eigen::Map<Eigen::VectorXd>(all.data(), std::ssize(all));
}

// Derivatives of `ResidualsOf` by the system's unknowns and all landmarks.
Eigen::MatrixXd Differentiate(const Bundle& bundle,
                              const UnknownLayout& layout,
                              const PoseSystem& system) {
  const Eigen::Index size = system.Size() + 3 * std::ssize(bundle.markers);
  Eigen::MatrixXd J(ResidualsOf(bundle).size(), size);
  for (Eigen::Index k = 0; k < size; ++k) {
    const double step = k < layout.head && system.information(k, k) < 1 ? 1e-3 : 1e-6;
    const Eigen::VectorXd forward = step * Eigen::VectorXd::Unit(size, k);
    J.col(k) = (ResidualsOf(Moved(bundle, layout, system, forward)) -
                ResidualsOf(Moved(bundle, layout, system, -forward))) /
               (2 * step);
  }
  return J;
}

// N without its unknowns from `head` on (Schur complement).
Eigen::MatrixXd Reduced(const Eigen::MatrixXd& N, Eigen::Index head) {
  const Eigen::Index tail = N.rows() - head;
  return N.topLeftCorner(head, head) -
         N.topRightCorner(head, tail) *
             N.bottomRightCorner(tail, tail).ldlt().solve(N.bottomLeftCorner(tail, head));
}

// Largest difference of two informations, relative to the square root of both diagonals.
double Difference(const Eigen::MatrixXd& lower, const Eigen::MatrixXd& expected) {
  const Eigen::MatrixXd full = lower.selfadjointView<Eigen::Lower>();
  const Eigen::VectorXd scale = expected.diagonal().cwiseSqrt().cwiseInverse();
  return (scale.asDiagonal() * (full - expected) * scale.asDiagonal()).cwiseAbs().maxCoeff();
}

TEST(LandmarkSystem, IsTheSchurComplementOfAllNormalEquations) {
  const Bundle bundle = LandmarkBundle();
  const UnknownLayout layout = internal::MakeLayout(bundle);
  const PoseSystem system = EliminateLandmarks(bundle, layout);
  EXPECT_EQ(system.head, 6 + 6 + 6);  // seven parameters each but one, extrinsics
  EXPECT_EQ(system.pose, (std::vector<int>{18, -1, 24, 30}));
  EXPECT_EQ(system.Size(), 36);
  const Eigen::MatrixXd J = Differentiate(bundle, layout, system);
  EXPECT_LT(Difference(system.information, Reduced(J.transpose() * J, system.Size())), 1e-5);
}

TEST(LandmarkSystem, KeepsLandmarksThatADistanceTies) {
  Bundle bundle = LandmarkBundle();
  constexpr double kSigma = 1e-4;
  const double length = (bundle.markers[2].position - bundle.markers[6].position).norm();
  bundle.distances.push_back(
      {.markers_a = {2}, .markers_b = {6}, .length = length, .sigma = kSigma});
  const UnknownLayout layout = internal::MakeLayout(bundle);
  const PoseSystem system = EliminateLandmarks(bundle, layout);
  ASSERT_EQ(system.Size(), 42);
  for (size_t m = 0; m < bundle.markers.size(); ++m) {
    const bool kept = m == 2 || m == 6;
    EXPECT_EQ(system.landmark[m] >= 36, kept) << m;
    EXPECT_EQ(system.landmark[m] == -1, !kept) << m;
  }
  // In the order of the other system: landmarks 2 and 6 behind the poses, then the others.
  const PoseSystem without = EliminateLandmarks(LandmarkBundle(), layout);
  const Eigen::MatrixXd J = Differentiate(bundle, layout, without);
  Eigen::MatrixXd N = J.transpose() * J;
  const Eigen::Vector3d u =
      (bundle.markers[2].position - bundle.markers[6].position) / (length * kSigma);
  Eigen::VectorXd row = Eigen::VectorXd::Zero(N.rows());
  row.segment<3>(36 + 3 * 2) = u;
  row.segment<3>(36 + 3 * 6) = -u;
  N += row * row.transpose();
  std::vector<Eigen::Index> order(static_cast<size_t>(N.rows()));
  std::iota(order.begin(), order.end(), 0);
  std::ranges::stable_sort(order, {}, [&](Eigen::Index i) {
    if (i < 36) return Eigen::Index{i};
    const int at = system.landmark[static_cast<size_t>((i - 36) / 3)];
    return at < 0 ? 1000 + i : at + (i - 36) % 3;
  });
  const Eigen::MatrixXd sorted = N(order, order);
  EXPECT_LT(Difference(system.information, Reduced(sorted, system.Size())), 1e-5);
}

TEST(LandmarkScores, AreGradientsAndInformationWithEachLandmarkAtItsOptimum) {
  const Bundle bundle = LandmarkBundle();
  const UnknownLayout layout = internal::MakeLayout(bundle);
  const PoseSystem system = EliminateLandmarks(bundle, layout);
  Random random(5);
  const Eigen::VectorXd unit = system.information.diagonal().cwiseSqrt().cwiseInverse();
  Eigen::MatrixXd directions(system.Size(), 3);
  for (double& value : directions.reshaped()) value = random.Gaussian(1);
  directions = unit.asDiagonal() * directions;
  std::vector<int> group;
  for (size_t m = 0; m < bundle.markers.size(); ++m) group.push_back(m % 3 == 1 ? 1 : 0);
  const LandmarkScores scores = ScoreLandmarks(bundle, layout, directions, group);

  // The groups' information together is that of the system.
  ASSERT_EQ(scores.information.size(), 2U);
  const Eigen::MatrixXd all = system.information.selfadjointView<Eigen::Lower>();
  EXPECT_LT(Difference(scores.information[0] + scores.information[1],
                       directions.transpose() * all * directions),
            1e-9);

  // Each landmark's by its own rows, the landmark eliminated.
  const Eigen::MatrixXd J = Differentiate(bundle, layout, system);
  const Eigen::VectorXd r = ResidualsOf(bundle);
  Eigen::MatrixXd of_group_1 = Eigen::MatrixXd::Zero(3, 3);
  for (Eigen::Index m = 0; m < std::ssize(bundle.markers); ++m) {
    const Eigen::MatrixXd L = J.middleCols<3>(system.Size() + 3 * m);
    const Eigen::VectorXd own = (L.rowwise().squaredNorm().array() > 0).cast<double>();
    const Eigen::MatrixXd A = own.asDiagonal() * J.leftCols(system.Size()) * directions;
    const Eigen::VectorXd of_landmark = own.cwiseProduct(r);
    const Eigen::MatrixXd projector = Eigen::MatrixXd::Identity(L.rows(), L.rows()) -
                                      L * (L.transpose() * L).inverse() * L.transpose();
    const Eigen::VectorXd gradient = A.transpose() * projector * of_landmark;
    EXPECT_LT((scores.gradients.col(m) - gradient).norm(), 1e-4 * (1 + gradient.norm())) << m;
    if (m % 3 == 1) of_group_1 += A.transpose() * projector * A;
  }
  EXPECT_LT(Difference(scores.information[1], of_group_1), 1e-5);
}

TEST(DegreesWithLandmarks, AreAllUnknownsLessWhatDistancesFix) {
  Bundle bundle = LandmarkBundle();
  const auto total = [&] {
    const std::vector<double> degrees = DegreesWithLandmarks(bundle);
    return std::reduce(degrees.begin(), degrees.end());
  };
  const double landmarks = 3 * static_cast<double>(bundle.markers.size());
  EXPECT_NEAR(total(), 18 + 6 * 3 + landmarks, 1e-9);
  bundle.distances.push_back({.markers_a = {2}, .markers_b = {6}, .length = 1, .sigma = 1});
  bundle.scale_distance = bundle.distances[0];
  EXPECT_NEAR(total(), 18 + 6 * 3 + landmarks - 2, 1e-9);
  bundle.fixed_frame.reset();
  EXPECT_NEAR(total(), 18 + 6 * 4 + landmarks - 2, 1e-9);
  // Shared by the coordinates, the cameras' own unknowns apart.
  const std::vector<double> coordinates = UsedCoordinates(bundle);
  const std::vector<double> degrees = DegreesWithLandmarks(bundle);
  EXPECT_NEAR((degrees[0] - 6) / coordinates[0], (degrees[1] - 12) / coordinates[1], 1e-9);
  // A prior determines the cameras' own.
  bundle.prior.emplace();
  bundle.prior->unknowns.push_back({.camera = 0, .param = 0, .component = 0, .value = 1});
  bundle.prior->weight = Eigen::MatrixXd::Identity(1, 1);
  EXPECT_NEAR(DegreesWithLandmarks(bundle)[0], degrees[0] - 6, 1e-9);
}

}  // namespace TEST_FILE
}  // namespace plenocal
