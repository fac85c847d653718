// SPDX-License-Identifier: Apache-2.0
//
// Initial guesses of central cameras from exact points. The calls of `near_axis` show the focal
// lengths that alignment and profile give.
#include "models/start/central_start.h"

#include <gmock/gmock.h>

#include <cmath>
#include <functional>
#include <numbers>

#include "models/registry.h"
#include "tests/calib/random.h"

namespace plenocal::testing {
namespace TEST_FILE {

using ::testing::ElementsAre;

constexpr ImageSize kSize{641, 481};
const Eigen::Vector2d kMiddle(320, 240);
const double kHalfDiagonal = 400;  // px: of 320 and 240
constexpr double kDegree = std::numbers::pi / 180;

enum class Shape { kPlane, kCorner };

struct Problem {
  explicit Problem(const char* name, Shape shape = Shape::kPlane)
      : model(FindModel(CameraModels(), name)), given(model->params.size()) {
    for (int row = 0; row < 6; ++row) {
      for (int column = 0; column < 7; ++column) {
        const double x = 0.04 * column, y = 0.04 * row;
        const bool up = shape == Shape::kCorner && column > 3;
        markers[10 * row + column] =
            up ? Eigen::Vector3d(0.12, y, 0.12 - x) : Eigen::Vector3d(x, y, 0);
      }
    }
  }

  /// Adds a view by the pose's rotation vector and the place of the target's middle.
  void See(const std::vector<double>& params, const Eigen::Vector3d& w, const Eigen::Vector3d& t) {
    const Eigen::Matrix3d R = ExpRotation(w);
    const RigidTransform pose{R, t - R * Eigen::Vector3d(0.12, 0.1, 0)};
    View view{"f" + std::to_string(views.size()), {}};
    for (const auto& [number, position] : markers) {
      Observation seen{.marker = number};
      if (!model->Project(params.data(), nullptr, nullptr, pose * position, seen.values.data())) {
        continue;
      }
      const Eigen::Vector2d off = Eigen::Vector2d(seen.values[0], seen.values[1]) - kMiddle;
      if (std::abs(off.x()) > 330 || std::abs(off.y()) > 250) continue;
      view.observations.push_back(seen);
    }
    views.push_back(view);
  }
  void SeeTilted(const std::vector<double>& params, double distance, int count = 6) {
    for (int i = 0; i < count; ++i) {
      const double azimuth = 1.1 * i;
      See(params,
          Eigen::Vector3d(0.5 * std::cos(azimuth), 0.5 * std::sin(azimuth), 0.2 * i),
          {0.02 * std::cos(2.0 * i), 0.02 * std::sin(3.0 * i), distance * (1 + 0.05 * i)});
    }
  }

  [[nodiscard]] StartProblem Start() const {
    return {.views = views,
            .markers = &markers,
            .image_size = kSize,
            .config = {},
            .given = given,
            .fixed = &fixed};
  }

  /// The focal lengths, px, that a start tries.
  [[nodiscard]] std::vector<double> Focals() const {
    std::vector<double> focals;
    StartCentral(*model, Start(), [&](double f, double c_x, double c_y) {
      EXPECT_DOUBLE_EQ(c_x, kMiddle.x());
      EXPECT_DOUBLE_EQ(c_y, kMiddle.y());
      focals.push_back(f);
      return std::vector<std::vector<double>>();
    });
    return focals;
  }

  const CameraModel* model;
  std::vector<std::optional<double>> given;
  std::vector<bool> fixed = {};
  std::map<int, Eigen::Vector3d> markers = {};
  std::vector<View> views = {};
};

double PlainFocal(double half_fov_deg) { return kHalfDiagonal / std::tan(half_fov_deg * kDegree); }

/// The nearest of the ladder from 3 degrees by 15 %.
double NearestPlain(double focal) {
  double best = 0;
  for (double half = 3; half <= 75; half *= 1.15) {
    const double plain = PlainFocal(half);
    if (std::abs(std::log(plain / focal)) < std::abs(std::log(best / focal))) best = plain;
  }
  return best;
}

TEST(CentralStart, WithoutPointsIsNone) {
  Problem problem("pinhole");
  EXPECT_TRUE(StartLens(*problem.model, problem.Start(), {{}}).empty());
  problem.views = {View{"a", {Observation{.marker = 99}}}};  // no such marker
  EXPECT_TRUE(StartLens(*problem.model, problem.Start(), {{}}).empty());
}

TEST(CentralStart, OfFewPointsTriesOrdinaryWideAndLongLenses) {
  Problem problem("pinhole");
  problem.views = {View{"a", {Observation{.marker = 0, .values = {300, 200}}}}};
  EXPECT_THAT(problem.Focals(),
              ElementsAre(::testing::DoubleNear(PlainFocal(35), 1e-9),
                          ::testing::DoubleNear(PlainFocal(60), 1e-9),
                          ::testing::DoubleNear(PlainFocal(10), 1e-9)));
}

TEST(CentralStart, NeedsTwoPointsForEachNumberOfAPlanesPose) {
  Problem whole("pinhole");
  whole.See({500, 500, 320, 240}, {0.4, 0.2, 0.1}, {0.01, 0.02, 0.5});
  for (const size_t count : {5U, 6U, 7U}) {
    Problem problem("pinhole");
    View view{"a", {}};
    // Not in one row.
    for (size_t i = 0; i < count; ++i)
      view.observations.push_back(whole.views[0].observations[5 * i]);
    problem.views = {view};
    EXPECT_EQ(problem.Focals().size(), count < 6 ? 3U : 5U) << count;
  }
  Problem row("pinhole");
  View view{"a", {}};
  for (int i = 0; i < 7; ++i) view.observations.push_back(whole.views[0].observations[i]);
  row.views = {view};
  EXPECT_EQ(row.Focals().size(), 3U);
}

TEST(CentralStart, NeedsTwoPointsForEachNumberOfASpacesPose) {
  Problem whole("pinhole", Shape::kCorner);
  whole.See({500, 500, 320, 240}, {0.4, 0.2, 0.1}, {0.01, 0.02, 0.5});
  for (const size_t count : {7U, 8U}) {
    Problem problem("pinhole", Shape::kCorner);
    View view{"a", {}};
    for (size_t i = 0; i < count; ++i) {
      view.observations.push_back(whole.views[0].observations[5 * i]);
    }
    problem.views = {view};
    EXPECT_EQ(problem.Focals().size(), count < 8 ? 3U : 5U) << count;
  }
}

TEST(CentralStart, OfExactPinholesHasTheirFocalLength) {
  for (const Shape shape : {Shape::kPlane, Shape::kCorner}) {
    for (const double focal : {200.0, 450.0, 1500.0}) {
      Problem problem("pinhole", shape);
      problem.SeeTilted({focal, focal, 320, 240}, 0.0012 * focal);
      const std::vector<double> focals = problem.Focals();
      ASSERT_EQ(focals.size(), 5U);
      EXPECT_NEAR(focals[0] / focal, 1, 1e-6) << focal;
      // Of very wide lenses the longest plain one has the least angles, and so the least errors.
      if (focal > 300) {
        EXPECT_NEAR(focals[1] / NearestPlain(focal), 1, 1e-9) << focal;
      }
      // A single view, tilted either way.
      for (const double sign : {-1, 1}) {
        Problem one("pinhole", shape);
        one.See({focal, focal, 320, 240}, {0.5 * sign, 0.3, 0.1}, {0.01, 0.02, 0.0012 * focal});
        EXPECT_NEAR(one.Focals()[0] / focal, 1, 1e-5) << focal;
      }
    }
  }
}

TEST(CentralStart, OfDistortedLensesHasTheFocalLengthNearTheAxis) {
  // F(rho) of these is near its polynomial of fourth degree.
  Problem fisheye("equidistant");
  fisheye.SeeTilted({300, 300, 320, 240}, 0.16);
  EXPECT_NEAR(fisheye.Focals()[0] / 300, 1, 0.01);
  Problem radial("division");
  std::vector<double> params(radial.model->params.size(), 0.0);
  params[0] = params[1] = 400;
  params[2] = 320;
  params[3] = 240;
  radial.SeeTilted(params, 0.3);
  EXPECT_NEAR(radial.Focals()[0] / 400, 1, 0.01);
}

TEST(CentralStart, FitsTheModelToTheDirections) {
  Problem problem("pinhole");
  problem.SeeTilted({450, 450, 320, 240}, 0.5);
  const auto near_axis = [](double, double, double) {
    return std::vector<std::vector<double>>{{300, 700, 310, 250}, {200, 200, 320, 240}};
  };
  const std::vector<StartCandidate> found =
      StartCentral(*problem.model, problem.Start(), near_axis);
  ASSERT_EQ(found.size(), 10U);
  // Of each profile both guesses are fitted.
  for (const size_t k : {0U, 1U}) {
    EXPECT_NEAR(found[k].params[0], 450, 1e-3);
    EXPECT_NEAR(found[k].params[1], 450, 1e-3);
    EXPECT_NEAR(found[k].params[2], 320, 1e-3);
    EXPECT_NEAR(found[k].params[3], 240, 1e-3);
    EXPECT_NEAR(found[8 + k].params[0], PlainFocal(10), 1e-3 * PlainFocal(10));
  }
}

TEST(CentralStart, KeepsValuesOfTheUser) {
  Problem problem("pinhole");
  problem.SeeTilted({450, 450, 320, 240}, 0.5);
  problem.given = {{}, 470.0, 330.0, {}};
  const std::vector<StartCandidate> found = StartLens(*problem.model, problem.Start(), {{}});
  ASSERT_EQ(found.size(), 5U);
  for (const StartCandidate& each : found) {
    EXPECT_EQ(each.params[1], 470);
    EXPECT_EQ(each.params[2], 330);
  }
  EXPECT_NEAR(found[0].params[0], 450, 10);
  EXPECT_NEAR(found[0].params[3], 240, 5);
}

TEST(CentralStart, OfLimitedParametersHoldsThemFirst) {
  // Of `eucm` alpha is between 0 and 1: three candidates for each profile and lens.
  Problem problem("eucm");
  std::vector<double> truth(problem.model->example.begin(), problem.model->example.end());
  truth[0] = truth[1] = 300;
  truth[2] = 320;
  truth[3] = 240;
  problem.SeeTilted(truth, 0.25);
  const std::vector<double> lens(truth.begin() + 4, truth.end());
  const std::vector<StartCandidate> found = StartLens(*problem.model, problem.Start(), {lens});
  ASSERT_EQ(found.size(), 15U);
  for (size_t i = 4; i < truth.size(); ++i) {
    const bool confined = problem.model->params[i].neutral.has_value();
    if (confined) {
      EXPECT_EQ(found[1].params[i], truth[i]);
    }
  }
  double best = 1e9;
  for (size_t k = 0; k < 3; ++k) best = std::min(best, std::abs(found[k].params[0] / 300 - 1));
  EXPECT_LT(best, 0.05);
  for (const StartCandidate& each : found) {
    EXPECT_GT(each.params[4], -1);
    EXPECT_LT(each.params[4], 1);
  }
}

TEST(CentralStart, GivesEachPlainLensTheFocalLengthNearTheAxis) {
  // Fixed by the user but for c_x: the candidates show the parameters before the fit.
  Problem problem("equidistant");
  problem.SeeTilted({300, 300, 320, 240}, 0.16);
  const std::vector<double> focals = problem.Focals();
  const std::vector<StartCandidate> found = StartLens(*problem.model, problem.Start(), {{}, {}});
  ASSERT_EQ(found.size(), 2 * focals.size());
  EXPECT_NEAR(found[0].params[0], 300, 3);
  EXPECT_NEAR(found[1].params[0], 300, 3);
}

}  // namespace TEST_FILE
}  // namespace plenocal::testing
