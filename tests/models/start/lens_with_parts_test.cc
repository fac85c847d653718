// SPDX-License-Identifier: Apache-2.0
//
// Points where rays meet the axis, and the tables of models made of a lens and parts.
#include "models/start/lens_with_parts.h"

#include <gmock/gmock.h>

#include <algorithm>
#include <cmath>
#include <numbers>

#include "models/registry.h"
#include "models/start/axis_point.h"

namespace plenocal::testing {
namespace TEST_FILE {

const CameraModel& Model(std::string_view name) { return *FindModel(CameraModels(), name); }

// ---- points on the axis

// z_p = a_0 (1 - cos(theta)) + a_1 theta^2, up to 2 rad.
constexpr std::array<Param, 2> kTwo{};
double Offset(const double* a, double theta, double* by_theta, double* by_a) {
  const double s = std::sin(theta), c = std::cos(theta);
  const double z_p = a[0] * (1 - c) + a[1] * theta * theta;
  *by_theta = z_p * c + (a[0] * s + 2 * a[1] * theta) * s;
  by_a[0] = (1 - c) * s;
  by_a[1] = theta * theta * s;
  return z_p * s;
}
LensPart PartOfTwo() {
  LensPart part;
  part.params = kTwo;
  part.ray_offset = &Offset;
  part.largest_angle = 2;
  return part;
}
constexpr std::array<double, 2> kA{0.03, -0.01};
double AxisPointAt(double theta) { return kA[0] * (1 - std::cos(theta)) + kA[1] * theta * theta; }
Eigen::Vector3d Direction(double theta) {
  return {0.6 * std::sin(theta), -0.8 * std::sin(theta), std::cos(theta)};
}

TEST(AxisPoints, AreThoseOfTheRay) {
  const LensPart part = PartOfTwo();
  for (const double theta : {0.0, 1e-6, 0.4, 1.2, 1.9, 1.9999}) {
    const auto z_p = AxisPointOf(part, kA.data(), Direction(theta));
    ASSERT_TRUE(z_p) << theta;
    EXPECT_NEAR(*z_p, AxisPointAt(theta), 1e-15) << theta;
  }
  EXPECT_FALSE(AxisPointOf(part, kA.data(), Direction(2.0001)));
  EXPECT_FALSE(AxisPointOf(part, kA.data(), Direction(std::numbers::pi)));
}

TEST(AxisPoints, ShiftThePointsThatTheirRaysHit) {
  const LensPart part = PartOfTwo();
  for (const double theta : {0.0, 0.2, 1.0, 1.7, 1.95}) {
    for (const double distance : {0.1, 1.0, 50.0}) {
      for (const double h : {1.0, 0.5, 0.0}) {
        const Eigen::Vector3d at_lens = distance * Direction(theta);
        const Eigen::Vector3d p = at_lens + h * Eigen::Vector3d(0, 0, AxisPointAt(theta));
        const auto shifted = ShiftToLens(part, kA.data(), p, h);
        ASSERT_TRUE(shifted) << theta << " " << distance << " " << h;
        EXPECT_NEAR((shifted->p - at_lens).norm(), 0, 1e-12 * std::max(1.0, distance));
      }
    }
  }
}

TEST(AxisPoints, HaveDerivativesByPointAndParameters) {
  const LensPart part = PartOfTwo();
  constexpr double kStep = 1e-6;
  for (const Eigen::Vector3d& p : {Eigen::Vector3d(0.1, -0.07, 0.2),
                                   Eigen::Vector3d(-0.1, 0.02, -0.02),
                                   Eigen::Vector3d(0, 0.3, 0.1)}) {
    for (const double h : {1.0, 0.7}) {
      const auto z = [&](const Eigen::Vector3d& at, double by_h, std::array<double, 2> a) {
        return ShiftToLens(part, a.data(), at, by_h)->p.z();
      };
      const auto shifted = ShiftToLens(part, kA.data(), p, h);
      ASSERT_TRUE(shifted);
      for (int i = 0; i < 3; ++i) {
        const Eigen::Vector3d d = kStep * Eigen::Vector3d::Unit(i);
        EXPECT_NEAR(shifted->z_by_p[i], (z(p + d, h, kA) - z(p - d, h, kA)) / (2 * kStep), 1e-7);
      }
      EXPECT_NEAR(shifted->z_by_h, (z(p, h + kStep, kA) - z(p, h - kStep, kA)) / (2 * kStep), 1e-7);
      for (size_t i = 0; i < 2; ++i) {
        std::array<double, 2> more = kA, less = kA;
        more[i] += kStep;
        less[i] -= kStep;
        EXPECT_NEAR(shifted->z_by_a[i], (z(p, h, more) - z(p, h, less)) / (2 * kStep), 1e-7);
      }
    }
  }
  const auto axis = ShiftToLens(part, kA.data(), {0, 0, 0.3}, 1);
  EXPECT_EQ(axis->z_by_p, Eigen::RowVector3d(0, 0, 1));
  EXPECT_EQ(axis->z_by_h, 0);
}

TEST(AxisPoints, AreNoneWhereNoRayOrSeveralHitThePoint) {
  const LensPart part = PartOfTwo();
  const auto hits = [&](const Eigen::Vector3d& p, std::array<double, 2> a = kA) {
    return ShiftToLens(part, a.data(), p, 1).has_value();
  };
  EXPECT_TRUE(hits(Direction(1.99)));
  EXPECT_FALSE(hits(Direction(2.01)));
  EXPECT_FALSE(hits({0, 0, -1}));
  EXPECT_FALSE(hits({0, 0, 0}));
  EXPECT_FALSE(hits({INFINITY, 0, 1}));
  EXPECT_FALSE(hits({0, NAN, 1}));
  // With a_0 alone the slope at theta is -r sin - Z cos + a_0 (sin^2 + cos (1 - cos)): at a right
  // angle -r + a_0. A point as near as a_0 is where neighbouring rays cross.
  EXPECT_TRUE(hits({1.01, 0, 0.5}, {0.5, 0}));
  EXPECT_TRUE(hits({0.6, 0, 0.5}, {0.5, 0}));
  EXPECT_FALSE(hits({0.5, 0, 0}, {0.5, 0}));
  EXPECT_FALSE(hits({0.5004, 0, 0}, {0.5, 0}));
  EXPECT_FALSE(hits({0.3, 0, 0}, {0.5, 0}));
}

// ---- tables of models

TEST(LensTables, TellWhichLensesTakeParts) {
  for (const char* name : {"pinhole", "ucm", "equidistant", "splined", "pinhole-radtan"}) {
    EXPECT_TRUE(TakesParts(Model(name))) << name;
  }
  for (const char* name : {"focused-plenoptic", "pinhole+skew", "pinhole+pupil"}) {
    EXPECT_FALSE(TakesParts(Model(name))) << name;
  }
  CameraModel lens = Model("pinhole");
  lens.params = lens.params.first(3);
  EXPECT_FALSE(TakesParts(lens));
  lens = Model("pinhole");
  const std::array<Param, 1> config{};
  lens.config = config;
  EXPECT_FALSE(TakesParts(lens));
  for (size_t i = 0; i < 4; ++i) {
    lens = Model("pinhole");
    std::vector<Param> params(lens.params.begin(), lens.params.end());
    params[i].name = "other";
    lens.params = params;
    EXPECT_FALSE(TakesParts(lens)) << i;
  }
}

TEST(LensTables, ArePutTogetherInOrder) {
  const CameraModel &lens = Model("ucm"), &model = Model("ucm+pupil+radial2+skew");
  std::string source(lens.source);
  std::vector<std::string_view> names;
  std::vector<double> example(lens.example.begin(), lens.example.end());
  for (const Param& param : lens.params) names.push_back(param.name);
  for (const char* name : {"pupil", "radial2", "skew"}) {
    const LensPart& part = *std::ranges::find(LensParts(), name, &LensPart::name);
    source += "; " + std::string(name) + ": " + std::string(part.source);
    for (const Param& param : part.params) names.push_back(param.name);
    example.insert(example.end(), part.example.begin(), part.example.end());
  }
  EXPECT_EQ(model.name, "ucm+pupil+radial2+skew");
  EXPECT_EQ(model.source, source);
  ASSERT_EQ(model.params.size(), names.size());
  for (size_t i = 0; i < names.size(); ++i) EXPECT_EQ(model.params[i].name, names[i]);
  EXPECT_TRUE(std::ranges::equal(model.example, example));
  EXPECT_EQ(model.usage, Usage::kRare);
  EXPECT_TRUE(model.homogeneous);
  EXPECT_EQ(model.centre, Centre::kAxis);
  EXPECT_NE(Model("ucm+skew").centre, Centre::kAxis);
  EXPECT_EQ(model.support_size, 0U);
  EXPECT_EQ(Model("splined+pupil+skew").support_size, Model("splined").support_size + 4);
  EXPECT_EQ(WithParts(lens, "ucm+pupil+radial2+skew"), &model);
  EXPECT_EQ(model.functions.prior_unit, nullptr);
  const CameraModel &spline = Model("splined"), &spline_skew = Model("splined+skew");
  EXPECT_EQ(spline_skew.functions.prior_unit(spline_skew, spline_skew.example.data()),
            spline.functions.prior_unit(spline, spline.example.data()));
}

TEST(LensTables, HaveRemediesForTheAxisAlone) {
  const CameraModel& model = Model("ucm+pupil+skew");  // the pupil's are 5 to 7
  const DepthRange seen{.nearest = 0.5, .farthest = 2};
  for (const size_t i : {0U, 4U, 8U}) EXPECT_EQ(model.Remedy(std::array{i}, seen), "") << i;
  for (const size_t i : {5U, 7U}) {
    EXPECT_EQ(
        model.Remedy(std::array<size_t, 2>{0, i}, seen),
        "Only points at different distances tell these parameters apart, and the target was "
        "seen at 0.5 to 2 m: add frames that are nearer, and frames that are farther; or keep "
        "all but one of them at 0 with 'fixed'.");
  }
}

TEST(LensTables, StartAsTheLensWithPartsWithoutEffect) {
  const CameraModel &lens = Model("pinhole"), &model = Model("pinhole+radtan+skew");
  std::map<int, Eigen::Vector3d> markers;
  for (int i = 0; i < 30; ++i) markers[i] = {0.04 * (i % 6), 0.04 * (i / 6), 0};
  const std::array<double, 4> truth{600, 600, 320, 240};
  std::vector<View> views;
  for (int v = 0; v < 5; ++v) {
    const Eigen::Matrix3d R =
        ExpRotation({0.4 * std::cos(1.1 * v), 0.4 * std::sin(1.1 * v), 0.1 * v});
    View& view = views.emplace_back();
    view.frame = std::to_string(v);
    for (const auto& [number, place] : markers) {
      Observation seen{.marker = number};
      lens.Project(truth.data(),
                   nullptr,
                   nullptr,
                   R * (place - Eigen::Vector3d(0.1, 0.08, 0)) + Eigen::Vector3d(0, 0, 0.5),
                   seen.values.data());
      view.observations.push_back(seen);
    }
  }
  std::vector<std::optional<double>> given(model.params.size());
  std::vector<bool> fixed(model.params.size(), false);
  const StartProblem problem{.views = views,
                             .markers = &markers,
                             .image_size = {641, 481},
                             .config = {},
                             .given = given,
                             .fixed = &fixed};
  const auto start = [&](const CameraModel& each, size_t count) {
    StartProblem own = problem;
    own.given = problem.given.first(std::min(count, given.size()));
    std::vector<bool> own_fixed(fixed.begin(),
                                fixed.begin() + static_cast<std::ptrdiff_t>(own.given.size()));
    own.fixed = &own_fixed;
    return each.Start(own);
  };
  const auto expect = [&](const std::vector<double>& more, size_t count) {
    const std::vector<StartCandidate> of_lens = start(lens, 4), made = start(model, count);
    ASSERT_FALSE(of_lens.empty());
    ASSERT_EQ(made.size(), of_lens.size());
    for (size_t k = 0; k < made.size(); ++k) {
      std::vector<double> params = of_lens[k].params;
      params.insert(params.end(), more.begin(), more.end());
      EXPECT_EQ(made[k].params, params);
    }
  };
  expect({0, 0, 0, 0, 0}, 9);
  given[1] = 610;
  given[5] = 0.25;
  given[8] = -0.5;
  expect({0, 0.25, 0, 0, -0.5}, 9);
  expect({0, 0.25, 0, 0, 0}, 6);
  fixed[1] = fixed[6] = true;
  expect({0, 0.25, 0, 0, -0.5}, 9);
}

// The point that the lens has to image, its image at focal length 1, the parts one after the other,
// and the focal lengths again.
TEST(LensTables, ProjectThroughAxisLensAndParts) {
  struct Case {
    const char* lens;
    const char* axial;
    std::vector<const char*> parts;
  };
  const std::array<double, kMaxObservationSize> values{};
  for (const Case& each : {Case{"ucm", "pupil", {"radtan", "tilt", "skew"}},
                           Case{"splined", "pupil", {"skew"}},
                           Case{"equidistant", "", {"radial2", "prism"}}}) {
    const CameraModel& lens = Model(each.lens);
    std::string name = each.lens;
    if (*each.axial != 0) name += std::string("+") + each.axial;
    for (const char* part : each.parts) name += std::string("+") + part;
    SCOPED_TRACE(name);
    const CameraModel& model = Model(name);
    const auto part_of = [](const char* part) {
      return *std::ranges::find(LensParts(), part, &LensPart::name);
    };
    const Eigen::Vector3d p(0.06, -0.04, 0.3);
    const double h = 0.8;
    const auto image =
        [&](const std::vector<double>& params, const Eigen::Vector3d& at, double by_h) {
          const double* a = params.data() + lens.params.size();
          Eigen::Vector3d seen = at;
          if (*each.axial != 0) {
            const LensPart axial = part_of(each.axial);
            seen = ShiftToLens(axial, a, at, by_h)->p;
            a += axial.params.size();
          }
          Eigen::Vector2d u, mapped;
          EXPECT_TRUE(lens.Project(params.data(), nullptr, values.data(), seen, u.data()));
          Eigen::Vector2d m((u.x() - params[2]) / params[0], (u.y() - params[3]) / params[1]);
          for (const char* each_part : each.parts) {
            const LensPart part = part_of(each_part);
            EXPECT_TRUE(part.map(a, m.data(), mapped.data()));
            m = mapped;
            a += part.params.size();
          }
          return Eigen::Vector2d(params[0] * m.x() + params[2], params[1] * m.y() + params[3]);
        };
    std::vector<double> params(model.example.begin(), model.example.end());
    params[1] *= 1.1;
    Eigen::Vector2d u, predicted, by_h;
    ASSERT_TRUE(model.Project(params.data(), nullptr, values.data(), p, u.data(), h));
    EXPECT_NEAR((u - image(params, p, h)).norm(), 0, 1e-10);
    const auto width = static_cast<Eigen::Index>(params.size());
    Eigen::Matrix<double, 2, Eigen::Dynamic, Eigen::RowMajor> by_params(2, width);
    Eigen::Matrix<double, 2, 3, Eigen::RowMajor> by_point;
    ProjectionOutput out{.predicted = predicted.data(),
                         .J_params = by_params.data(),
                         .J_point = by_point.data(),
                         .support = nullptr,
                         .J_h = by_h.data()};
    ASSERT_TRUE(model.ProjectWithJacobian(params.data(), nullptr, values.data(), p, out, h));
    EXPECT_NEAR((predicted - u).norm(), 0, 1e-10);
    const auto expect = [](const Eigen::Vector2d& derivative,
                           const Eigen::Vector2d& more,
                           const Eigen::Vector2d& less,
                           double step) {
      const Eigen::Vector2d expected = (more - less) / (2 * step);
      EXPECT_NEAR((derivative - expected).norm(), 0, 1e-6 * (1 + expected.norm()));
    };
    for (Eigen::Index i = 0; i < width; ++i) {
      SCOPED_TRACE(model.params[static_cast<size_t>(i)].name);
      const double step = i < 4 ? 1e-3 : 1e-5;
      std::vector<double> more = params, less = params;
      more[static_cast<size_t>(i)] += step;
      less[static_cast<size_t>(i)] -= step;
      expect(by_params.col(i), image(more, p, h), image(less, p, h), step);
    }
    for (int i = 0; i < 3; ++i) {
      const Eigen::Vector3d d = 1e-6 * Eigen::Vector3d::Unit(i);
      expect(by_point.col(i), image(params, p + d, h), image(params, p - d, h), 1e-6);
    }
    expect(by_h, image(params, p, h + 1e-5), image(params, p, h - 1e-5), 1e-5);
    // Without derivatives by the parameters.
    const Eigen::Matrix<double, 2, 3, Eigen::RowMajor> both = by_point;
    by_point.setZero();
    out.J_params = nullptr;
    out.J_h = nullptr;
    ASSERT_TRUE(model.ProjectWithJacobian(params.data(), nullptr, values.data(), p, out, h));
    EXPECT_EQ(by_point, both);
    // The ray back.
    std::array<double, kMaxObservationSize> seen{u.x(), u.y()};
    const auto ray = model.Unproject(params.data(), nullptr, seen.data());
    ASSERT_TRUE(ray);
    EXPECT_NEAR((p / h - ray->origin).cross(ray->direction).norm(), 0, 1e-9);
  }
}

// Derivatives by all parameters are those of the support, each in its column.
TEST(LensTables, GiveDerivativesByAllOrBySupport) {
  const CameraModel& model = Model("splined+pupil+skew");
  const size_t width = model.params.size(), columns = model.support_size;
  std::vector<double> whole(2 * width, 7), part(2 * columns, 7);
  std::vector<size_t> support(columns);
  std::array<double, 2> predicted{};
  std::array<double, 6> by_point{};
  std::array<double, 2> by_h{};
  ProjectionOutput out{.predicted = predicted.data(),
                       .J_params = whole.data(),
                       .J_point = by_point.data(),
                       .support = nullptr,
                       .J_h = by_h.data()};
  const Eigen::Vector3d p(0.05, 0.03, 0.4);
  const double* const params = model.example.data();
  const std::array<double, kMaxObservationSize> values{};
  ASSERT_TRUE(model.ProjectWithJacobian(params, nullptr, values.data(), p, out));
  out.J_params = part.data();
  out.support = support.data();
  ASSERT_TRUE(model.ProjectWithJacobian(params, nullptr, values.data(), p, out));
  std::vector<double> spread(2 * width, 0);
  for (size_t r = 0; r < 2; ++r) {
    for (size_t k = 0; k < columns; ++k) spread[r * width + support[k]] = part[r * columns + k];
  }
  EXPECT_EQ(whole, spread);
  for (size_t k = 0; k < 4; ++k) EXPECT_EQ(support[columns - 1 - k], width - 1 - k);
}

}  // namespace TEST_FILE
}  // namespace plenocal::testing
