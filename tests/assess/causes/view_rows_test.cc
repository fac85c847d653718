// SPDX-License-Identifier: Apache-2.0
#include "assess/causes/view_rows.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <cmath>

#include "assess/causes/residual_tests.h"
#include "calib/base/statistics.h"
#include "tests/calib/random.h"
#include "tests/calib/synthetic.h"

namespace plenocal::testing {
namespace TEST_FILE {

using ::testing::ElementsAre;

constexpr double kNoise = 0.2;  // px

Bundle Stereo() {
  Bundle bundle = TrueBundle(MakeProblem(31, {.cameras = 2, .frames = 5, .noise = kNoise}));
  bundle.cameras[1].noise.detector_scale = 1.5;
  bundle.cameras[1].noise.additive_sigma = 0.1;
  return bundle;
}

std::vector<BundleObservation> SeenBy(const Bundle& bundle, int camera, int frame) {
  std::vector<BundleObservation> seen;
  for (const BundleObservation& each : bundle.observations) {
    if (each.camera == camera && each.frame == frame && each.used) seen.push_back(each);
  }
  return seen;
}

TEST(RowsOfViews, AreResidualsInSigmasWithTheirPlaces) {
  const Bundle bundle = Stereo();
  const std::vector<ViewRows> views = RowsOfViews(bundle, 1);
  ASSERT_EQ(views.size(), 5U);
  const double sigma = std::hypot(1.5 * kNoise, 0.1);
  for (int f = 0; f < 5; ++f) {
    const ViewRows& view = views[static_cast<size_t>(f)];
    EXPECT_EQ(view.frame, f);
    const std::vector<BundleObservation> seen = SeenBy(bundle, 1, f);
    ASSERT_EQ(view.noise.size(), std::ssize(seen));
    ASSERT_EQ(view.residual.size(), 2 * std::ssize(seen));
    ASSERT_EQ(view.pose.rows(), view.residual.size());
    ASSERT_EQ(view.marker.rows(), view.residual.size());
    ASSERT_EQ(view.position.rows(), view.noise.size());
    for (Eigen::Index i = 0; i < view.noise.size(); ++i) {
      const BundleObservation& each = seen[static_cast<size_t>(i)];
      double residual[kMaxObservationSize];
      ASSERT_TRUE(Residual(bundle, each, residual));
      EXPECT_EQ(view.markers[static_cast<size_t>(i)], each.marker);
      EXPECT_NEAR(view.noise[i], sigma, 1e-12);
      for (Eigen::Index axis = 0; axis < 2; ++axis) {
        EXPECT_NEAR(view.residual[2 * i + axis], residual[axis] / sigma, 1e-9);
        EXPECT_NEAR(view.position(i, axis),
                    each.seen.values[static_cast<size_t>(axis)] - residual[axis],
                    1e-9);
      }
    }
  }
}

TEST(RowsOfViews, HaveTheDerivativesByPoseAndMarker) {
  const Bundle bundle = Stereo();
  constexpr double kStep = 1e-6;
  const ViewRows view = RowsOfViews(bundle, 1)[2];
  for (Eigen::Index k = 0; k < 9; ++k) {
    const auto moved = [&](double step) {
      Bundle other = bundle;
      if (k < 6) {
        other.T_rig_target[2] = Retract(other.T_rig_target[2], step * Vector6d::Unit(k));
      } else {
        for (BundleMarker& marker : other.markers) marker.position[k - 6] += step;
      }
      return RowsOfViews(other, 1)[2].residual;
    };
    const Eigen::VectorXd numeric = (moved(kStep) - moved(-kStep)) / (2 * kStep);
    const Eigen::VectorXd stated = k < 6 ? view.pose.col(k) : view.marker.col(k - 6);
    EXPECT_LT((numeric - stated).norm(), 1e-6 * stated.norm()) << k;
  }
}

TEST(RowsOfViews, AreOfUsedObservationsEnoughForAPose) {
  Bundle bundle = Stereo();
  int kept = 0;
  for (BundleObservation& each : bundle.observations) {
    if (each.camera == 0 && each.frame == 1) each.used = kept++ < 6;
  }
  const ViewRows six = RowsOfViews(bundle, 0)[1];
  EXPECT_EQ(six.noise.size(), 6);
  EXPECT_EQ(six.position.rows(), 6);
  EXPECT_EQ(six.markers.size(), 6U);
  for (const Eigen::Index rows : {six.residual.size(), six.pose.rows(), six.marker.rows()}) {
    EXPECT_EQ(rows, 12);
  }
  for (BundleObservation& each : bundle.observations) {
    if (each.camera == 0 && each.frame == 1 && each.used) {
      each.used = false;
      break;
    }
  }
  std::vector<int> frames;
  for (const ViewRows& view : RowsOfViews(bundle, 0)) frames.push_back(view.frame);
  EXPECT_THAT(frames, ElementsAre(0, 2, 3, 4));
  EXPECT_EQ(RowsOfViews(bundle, 1).size(), 5U);
}

// One view: 30,000 observations are thinned out to every second one.
TEST(RowsOfViews, TakeEverySecondOfManyObservations) {
  Bundle bundle = TrueBundle(MakeProblem(31, {.frames = 1, .noise = kNoise}));
  const std::vector<BundleObservation> seen = bundle.observations;
  bundle.observations.clear();
  while (bundle.observations.size() < 29'999) {
    for (BundleObservation each : seen) {
      if (bundle.observations.size() < 29'999) bundle.observations.push_back(each);
    }
  }
  EXPECT_EQ(RowsOfViews(bundle, 0)[0].noise.size(), 29'999);
  bundle.observations.push_back(seen.back());
  const ViewRows view = RowsOfViews(bundle, 0)[0];
  ASSERT_EQ(view.noise.size(), 15'000);
  for (const size_t i : {0, 1, 7}) EXPECT_EQ(view.markers[i], bundle.observations[2 * i].marker);
  bundle.observations.push_back(seen.back());
  bundle.observations.front().used = false;
  EXPECT_EQ(RowsOfViews(bundle, 0)[0].markers[0], bundle.observations[1].marker);
}

// Twelve rows with random derivatives.
ViewRows DrawnView(unsigned seed, Eigen::Index points = 6) {
  Random random(seed);
  ViewRows view;
  view.residual = Eigen::VectorXd::NullaryExpr(2 * points, [&] { return random.Gaussian(1); });
  view.pose = Eigen::MatrixXd::NullaryExpr(2 * points, 6, [&] { return random.Gaussian(1); });
  view.noise = Eigen::VectorXd::Ones(points);
  return view;
}

TEST(Regression, IsTheFitBesideThePose) {
  const ViewRows view = DrawnView(1, 10);
  Random random(2);
  const Eigen::MatrixXd X = Eigen::MatrixXd::NullaryExpr(20, 3, [&] { return random.Gaussian(2); });
  const Regression found = Regress(view, X);
  // All unknowns at once.
  Eigen::MatrixXd A(20, 9);
  A << X, view.pose;
  const Eigen::MatrixXd N = A.transpose() * A;
  const Eigen::VectorXd all = N.ldlt().solve(A.transpose() * view.residual);
  EXPECT_LT((found.estimate - all.head(3)).norm(), 1e-10);
  const Eigen::MatrixXd covariance = N.inverse().topLeftCorner(3, 3);
  EXPECT_LT((found.information - covariance.inverse()).norm(), 1e-9 * found.information.norm());
  EXPECT_NEAR(found.rest, (view.residual - A * all).squaredNorm(), 1e-10);
  const Eigen::VectorXd pose =
      (view.pose.transpose() * view.pose).ldlt().solve(view.pose.transpose() * view.residual);
  EXPECT_NEAR(found.gain, (view.residual - view.pose * pose).squaredNorm() - found.rest, 1e-10);
  EXPECT_EQ(found.degrees, 20 - 6 - 3);
}

TEST(Regression, LeavesOutWhatThePoseReplaces) {
  const ViewRows view = DrawnView(3, 10);
  Eigen::MatrixXd X(20, 2);
  X << view.pose.col(1) - 2 * view.pose.col(4), Eigen::VectorXd::LinSpaced(20, -1, 1);
  const Regression both = Regress(view, X), one = Regress(view, X.col(1));
  EXPECT_NEAR(both.estimate[0], 0, 1e-9);
  EXPECT_NEAR(both.estimate[1], one.estimate[0], 1e-9);
  EXPECT_NEAR(both.gain, one.gain, 1e-9);
  EXPECT_NEAR(both.rest, one.rest, 1e-9);
  EXPECT_EQ(both.degrees, 20 - 6 - 1);
  EXPECT_EQ(one.degrees, 20 - 6 - 1);
  // Exactly explained residuals leave nothing.
  ViewRows exact = view;
  exact.residual = 3 * X.col(1) + view.pose * Vector6d::LinSpaced(6, 1, 2);
  const Regression whole = Regress(exact, X.col(1));
  EXPECT_NEAR(whole.estimate[0], 3, 1e-10);
  EXPECT_NEAR(whole.rest, 0, 1e-10);
}

// Views of four markers in cells of their own, in an image of twelve cells of 10 px.
std::vector<ViewRows> ViewsOfCells(int count) {
  std::vector<ViewRows> views;
  for (int v = 0; v < count; ++v) {
    ViewRows view = DrawnView(10 + static_cast<unsigned>(v), 4);
    view.frame = v;
    view.markers = {4, 7, 1, 9};
    view.position.resize(4, 2);
    view.position << 5, 5, 25, 5, 115, 45, 65, 25;
    // A displacement along x and one along y of the image, both seen by each marker.
    view.marker.setZero(8, 3);
    for (Eigen::Index i = 0; i < 4; ++i) {
      view.marker(2 * i, 0) = 1 + 0.1 * v;
      view.marker(2 * i + 1, 2) = 2 - 0.2 * v;
    }
    views.push_back(view);
  }
  return views;
}

TEST(WithoutCommonPart, TakesOffDisplacementsAndTheMeanOfEachCell) {
  const std::vector<ViewRows> views = ViewsOfCells(5);
  const std::vector<ViewRows> rest = WithoutCommonPart(views, {120, 50});
  ASSERT_EQ(rest.size(), views.size());
  for (Eigen::Index row = 0; row < 8; ++row) {
    // One marker by itself: least squares along its axis, then the mean of what is left.
    double square = 0, right = 0, mean = 0;
    const Eigen::Index axis = row % 2 == 0 ? 0 : 2;
    for (const ViewRows& view : views) {
      square += std::pow(view.marker(row, axis), 2);
      right += view.marker(row, axis) * view.residual[row];
    }
    for (const ViewRows& view : views) {
      mean += (view.residual[row] - view.marker(row, axis) * right / square) / 5;
    }
    for (size_t v = 0; v < views.size(); ++v) {
      EXPECT_NEAR(rest[v].residual[row],
                  views[v].residual[row] - views[v].marker(row, axis) * right / square - mean,
                  1e-5)
          << row;
      EXPECT_EQ(rest[v].frame, static_cast<int>(v));
    }
  }
}

TEST(WithoutCommonPart, AveragesMarkersOfOneCell) {
  std::vector<ViewRows> views = ViewsOfCells(2);
  for (ViewRows& view : views) {
    view.marker.setZero();             // no displacement explains anything
    view.position.row(0) << 9.4, 9.4;  // the cell from -0.5 to 9.5
    view.position.row(1) << -0.4, -0.4;
    view.position.row(2) << 9.6, 0;  // the next one
  }
  const std::vector<ViewRows> rest = WithoutCommonPart(views, {120, 50});
  for (Eigen::Index axis = 0; axis < 2; ++axis) {
    double sum = 0;
    for (const ViewRows& view : views) sum += view.residual[axis] + view.residual[2 + axis];
    EXPECT_NEAR(rest[1].residual[axis], views[1].residual[axis] - sum / 4, 1e-9);
    EXPECT_NEAR(rest[0].residual[2 + axis], views[0].residual[2 + axis] - sum / 4, 1e-9);
    const double other = views[0].residual[4 + axis] + views[1].residual[4 + axis];
    EXPECT_NEAR(rest[0].residual[4 + axis], views[0].residual[4 + axis] - other / 2, 1e-9);
  }
}

TEST(ForEachResidual, VisitsAllPointsOfACameraThatProject) {
  Bundle bundle = Stereo();
  bundle.observations[0].used = false;
  ASSERT_EQ(bundle.observations[0].camera, 0);
  // Behind the camera.
  const int marker = bundle.observations[1].marker;
  const RigidTransform T = bundle.T_rig_target[0];
  bundle.markers[static_cast<size_t>(marker)].position = T.Inverse() * Eigen::Vector3d(0, 0, -1);
  size_t count = 0, unused = 0, expected = 0;
  for (const BundleObservation& each : bundle.observations) {
    double residual[kMaxObservationSize];
    if (each.camera == 0 && Residual(bundle, each, residual)) ++expected;
  }
  ForEachResidual(bundle, 0, [&](const BundleObservation& each, const double* found) {
    double residual[kMaxObservationSize];
    EXPECT_EQ(each.camera, 0);
    ASSERT_TRUE(Residual(bundle, each, residual));
    EXPECT_NEAR(found[0], residual[0], 1e-9);
    EXPECT_NEAR(found[1], residual[1], 1e-9);
    ++count;
    if (!each.used) ++unused;
  });
  EXPECT_EQ(count, expected);
  EXPECT_EQ(unused, 1U);
}

// Against all divisions in turn, with means and sums of squares as they are defined.
TEST(LargestSplit, IsTheBestOfAllDivisions) {
  Random random(5);
  const Eigen::MatrixXd values =
      Eigen::MatrixXd::NullaryExpr(11, 2, [&] { return random.Gaussian(1); });
  const Eigen::VectorXd weights =
      Eigen::VectorXd::NullaryExpr(11, [&] { return random.Uniform(0.5, 3); });
  for (const Eigen::Index least : {1, 2, 3, 5}) {
    const auto mean = [&](Eigen::Index from, Eigen::Index count) -> Eigen::RowVector2d {
      const Eigen::VectorXd w = weights.segment(from, count);
      return w.transpose() * values.middleRows(from, count) / w.sum();
    };
    const auto squares = [&](Eigen::Index from, Eigen::Index count) {
      double sum = 0;
      for (Eigen::Index i = from; i < from + count; ++i) {
        sum += weights[i] * (values.row(i) - mean(from, count)).squaredNorm();
      }
      return sum;
    };
    Eigen::Index best = 0;
    double within = squares(0, 11);
    for (Eigen::Index k = least; k + least <= 11; ++k) {
      const double rest = squares(0, k) + squares(k, 11 - k);
      if (rest < within) within = rest, best = k;
    }
    const SequenceSplit split = LargestSplit(values, weights, least);
    EXPECT_EQ(split.first, best);
    EXPECT_NEAR(split.within, within, 1e-12);
    EXPECT_NEAR(split.between, squares(0, 11) - within, 1e-12);
    EXPECT_LT((split.step - (mean(best, 11 - best) - mean(0, best))).norm(), 1e-12);
    EXPECT_EQ(split.all, 11);
    EXPECT_EQ(split.least, least);
    const double divisions = static_cast<double>(11 - 2 * least + 1);
    for (const double variance : {0.0, 0.9 * within / 9, 1.1 * within / 9}) {
      EXPECT_NEAR(split.Probability(variance),
                  divisions * FTail(split.between / std::max(variance, within / 9), 1, 9),
                  1e-12);
    }
  }
}

TEST(LargestSplit, DividesOnlyWhereItIsAccepted) {
  Eigen::VectorXd values(8);
  values << 0, 0, 0, 0, 0, 1, 1, 1;
  const Eigen::VectorXd ones = Eigen::VectorXd::Ones(8);
  std::vector<Eigen::Index> asked;
  const SequenceSplit split = LargestSplit(values, ones, 2, [&](Eigen::Index k, const auto& step) {
    asked.push_back(k);
    EXPECT_GT(step[0], 0);
    return k != 5;
  });
  EXPECT_THAT(asked, ElementsAre(2, 3, 4, 5));  // those larger than the best so far
  EXPECT_EQ(split.first, 4);
  EXPECT_EQ(LargestSplit(values, ones, 4).first, 4);
  EXPECT_EQ(LargestSplit(values, ones, 5).first, 0);
  EXPECT_EQ(LargestSplit(values, ones, 2).Probability(), 0);
}

TEST(FirstNames, ListsFiveOfFiveAndOfMore) {
  EXPECT_EQ(FirstNames({}), "");
  EXPECT_EQ(FirstNames({"a", "b", "c", "d", "e"}), "a, b, c, d, e");
  EXPECT_EQ(FirstNames({"a", "b", "c", "d", "e", "f", "g"}), "a, b, c, d, e, ...");
}

}  // namespace TEST_FILE
}  // namespace plenocal::testing
