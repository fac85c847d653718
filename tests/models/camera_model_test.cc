// SPDX-License-Identifier: Apache-2.0
//
// Properties that every camera model must have; run on all of the registry.
#include "calib/camera_model.h"

#include <gtest/gtest.h>
#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <numbers>
#include <set>
#include <sstream>

#include "calib/session.h"
#include "models/registry.h"

namespace plenocal {
namespace {

// Unproject solves to a few roundings of the image coordinates; 1e-10 of the image's width leaves
// room for the model's own conditioning inside the image.
constexpr double kRoundTrip = 1e-10;
// Near the edge of the domain the image stands still while the direction moves: kEdgeMargin inside
// it the derivative is some thousand times smaller, and so much larger is the error.
constexpr double kEdgeMargin = 1e-3;  // rad
constexpr double kRoundTripAtEdge = 1e-7;
// Two central differences extrapolated: h^4 = 1e-16 of truncation, 1e-16 / 1e-4 of rounding, and a
// factor of 100 for higher derivatives near the edge.
constexpr double kStep = 1e-4;
constexpr double kDerivative = 1e-9;
constexpr double kDerivativeAtEdge = 1e-6;
// J_point and p_cam are exact to rounding.
constexpr double kEuler = 1e-12;

using Values = std::array<double, kMaxObservationSize>;

class EveryCameraModel : public ::testing::TestWithParam<CameraModel> {
 protected:
  [[nodiscard]] const CameraModel& Model() const { return GetParam(); }
  [[nodiscard]] const double* Params() const { return Model().example.data(); }
  [[nodiscard]] const double* Config() const { return Model().example_config.data(); }

  bool Project(const Eigen::Vector3d& p_cam, Values* values) const {
    double predicted[kMaxObservationSize];
    if (!Model().project(Params(), Config(), values->data(), p_cam, predicted)) return false;
    std::copy_n(predicted, Model().measured.size(), values->begin());
    return true;
  }
  [[nodiscard]] std::optional<Ray> Unproject(const Values& values) const {
    return Model().unproject(Params(), Config(), values.data());
  }
  [[nodiscard]] bool AllFinite(const Values& values) const {
    return std::all_of(values.begin(), values.begin() + Model().measured.size(), [](double value) {
      return std::isfinite(value);
    });
  }

  // An observation at a place in the example's image; what it is seen through lies close by.
  [[nodiscard]] Values At(double x, double y) const {
    Values values{};
    const double place[2] = {x, y};
    for (size_t i = 0; i < Model().measured.size(); ++i) values[i] = place[i % 2];
    for (size_t i = 0; i < Model().context.size(); ++i) {
      values[Model().measured.size() + i] = place[i % 2] + (i % 2 == 0 ? 3 : -2);
    }
    return values;
  }

  // A grid over the image from corner to corner.
  [[nodiscard]] std::vector<Values> Grid(int steps) const {
    std::vector<Values> grid;
    for (int i = 0; i <= steps; ++i) {
      for (int j = 0; j <= steps; ++j) {
        grid.push_back(At((Model().example_size[0] - 1.0) * i / steps,
                          (Model().example_size[1] - 1.0) * j / steps));
      }
    }
    return grid;
  }
  [[nodiscard]] Values Centre() const {
    return At((Model().example_size[0] - 1) / 2.0, (Model().example_size[1] - 1) / 2.0);
  }
  // Distances along a ray at which points are placed, m.
  [[nodiscard]] static std::vector<double> Depths() { return {0.3, 1, 7.5, 100}; }

  static Eigen::Vector3d Direction(double theta, double phi) {
    return {std::sin(theta) * std::cos(phi), std::sin(theta) * std::sin(phi), std::cos(theta)};
  }
  // The largest angle from the optical axis that is imaged, counted from inside; pi if all are.
  [[nodiscard]] double EdgeOfDomain(double phi) const {
    const auto seen = [&](double theta) {
      Values values = Centre();
      return Project(Direction(theta, phi), &values);
    };
    constexpr double kScan = 0.01;
    double inside = 0;
    while (inside + kScan < std::numbers::pi && seen(inside + kScan)) inside += kScan;
    double outside = std::min(inside + kScan, std::numbers::pi);
    if (seen(outside)) return std::numbers::pi;
    for (int i = 0; i < 60; ++i) {
      const double middle = (inside + outside) / 2;
      (seen(middle) ? inside : outside) = middle;
    }
    return inside;
  }
  [[nodiscard]] static std::vector<double> Azimuths() {
    std::vector<double> azimuths;
    for (int i = 0; i < 16; ++i) azimuths.push_back(i * std::numbers::pi / 8);
    return azimuths;
  }

  // Compares project_with_jacobian with differences of project.
  void CheckJacobian(const Eigen::Vector3d& p_cam, const Values& values, double tolerance) const {
    SCOPED_TRACE(::testing::Message() << "p_cam = " << p_cam.transpose());
    const size_t rows = Model().measured.size(), count = Model().params.size();
    std::vector<double> unknowns(Params(), Params() + count);
    unknowns.insert(unknowns.end(), p_cam.data(), p_cam.data() + 3);
    const auto evaluate = [&](const std::vector<double>& x) {
      Eigen::VectorXd predicted(rows);
      const Eigen::Vector3d p(x[count], x[count + 1], x[count + 2]);
      EXPECT_TRUE(Model().project(x.data(), Config(), values.data(), p, predicted.data()));
      return predicted;
    };

    std::vector<double> J_params(rows * count), J_point(rows * 3);
    Eigen::VectorXd predicted(rows);
    ASSERT_TRUE(Model().project_with_jacobian(Params(),
                                              Config(),
                                              values.data(),
                                              p_cam,
                                              predicted.data(),
                                              J_params.data(),
                                              J_point.data()));
    // Near the edge of some domains the image goes to infinity, and its roundings with it.
    const double farthest = Model().example_size[0] + predicted.cwiseAbs().maxCoeff();
    // Jets divide by multiplying with the inverse: a few roundings.
    EXPECT_LT((predicted - evaluate(unknowns)).cwiseAbs().maxCoeff(), 1e-14 * farthest)
        << "the value must not depend on the scalar type";
    const Eigen::Map<const Eigen::VectorXd> all_J_point(J_point.data(), rows * 3);
    const double image = farthest + all_J_point.cwiseAbs().maxCoeff() * p_cam.norm();
    for (size_t k = 0; k < count + 3; ++k) {
      const bool is_param = k < count;
      // The size of a change that matters: the parameter's own, or the point's distance.
      double size = p_cam.norm();
      if (is_param) {
        size = std::max(std::abs(unknowns[k]), Model().params[k].scale);
        if (size == 0) size = 1;
      }
      const auto difference = [&](double step) -> Eigen::VectorXd {
        std::vector<double> up = unknowns, down = unknowns;
        up[k] += step;
        down[k] -= step;
        return (evaluate(up) - evaluate(down)) / (up[k] - down[k]);
      };
      const double step = kStep * size;
      const Eigen::VectorXd numeric = (4 * difference(step / 2) - difference(step)) / 3;
      for (size_t r = 0; r < rows; ++r) {
        const double analytic = is_param ? J_params[r * count + k] : J_point[r * 3 + (k - count)];
        ASSERT_TRUE(std::isfinite(analytic));
        // In pixels for a change of the unknown by its own size.
        EXPECT_NEAR(analytic * size,
                    numeric[static_cast<Eigen::Index>(r)] * size,
                    tolerance * (image + std::abs(analytic * size)))
            << Model().measured[r] << " by "
            << (is_param ? Model().params[k].name : std::string_view("xyz").substr(k - count, 1));
      }
    }
  }
};

INSTANTIATE_TEST_SUITE_P(Registry,
                         EveryCameraModel,
                         ::testing::ValuesIn(CameraModels().begin(), CameraModels().end()),
                         [](const auto& test) {
                           std::string name(test.param.name);
                           std::replace(name.begin(), name.end(), '-', '_');
                           return name;
                         });

TEST_P(EveryCameraModel, SeesTheWholeExampleImageAndFindsItsPixelsAgain) {
  for (const Values& seen : Grid(20)) {
    SCOPED_TRACE(::testing::Message() << "pixel " << seen[0] << ", " << seen[1]);
    const std::optional<Ray> ray = Unproject(seen);
    ASSERT_TRUE(ray.has_value());
    EXPECT_NEAR(ray->direction.norm(), 1, kEuler);
    for (const double depth : Depths()) {
      Values values = seen;
      ASSERT_TRUE(Project(ray->origin + depth * ray->direction, &values)) << depth;
      for (size_t i = 0; i < Model().measured.size(); ++i) {
        EXPECT_NEAR(values[i], seen[i], kRoundTrip * Model().example_size[0]) << depth;
      }
    }
  }
}

TEST_P(EveryCameraModel, FindsTheDirectionOfAPointAgainUpToTheEdgeOfItsDomain) {
  if (!Model().central) GTEST_SKIP() << "directions alone do not fix an image point";
  for (const double phi : Azimuths()) {
    const double edge = EdgeOfDomain(phi);
    ASSERT_GT(edge, 2 * kEdgeMargin);
    for (const double part : {0.0, 1e-9, 1e-4, 0.1, 0.3, 0.5, 0.7, 0.9, 0.99, 1.0}) {
      const double theta = part * (edge - kEdgeMargin);
      const Eigen::Vector3d direction = Direction(theta, phi);
      for (const double depth : Depths()) {
        Values values{};
        ASSERT_TRUE(Project(depth * direction, &values)) << theta;
        ASSERT_TRUE(AllFinite(values));
        const std::optional<Ray> ray = Unproject(values);
        ASSERT_TRUE(ray.has_value()) << "theta " << theta << " of " << edge << ", phi " << phi;
        const double tolerance = part < 0.95 ? kRoundTrip : kRoundTripAtEdge;
        EXPECT_LT((ray->direction - direction).norm(), tolerance)
            << "theta " << theta << " of " << edge;
      }
    }
  }
}

TEST_P(EveryCameraModel, SaysFalseAndNotNanOutsideItsDomain) {
  for (const double phi : Azimuths()) {
    // The domain has one edge: what lies beyond it is not imaged again (a fold would show here).
    // Without a single centre it depends on the distance, and is sought at 1 m.
    const double edge = EdgeOfDomain(phi);
    for (double theta = edge + 1e-6; theta < std::numbers::pi; theta += 0.003) {
      for (const double depth : Model().central ? Depths() : std::vector<double>{1}) {
        Values values = Centre();
        EXPECT_FALSE(Project(depth * Direction(theta, phi), &values))
            << "theta " << theta << " beyond " << edge << ", phi " << phi;
      }
    }
    for (double theta = 0; theta <= edge; theta += 0.003) {
      Values values = Centre();
      ASSERT_TRUE(Project(Direction(theta, phi), &values)) << theta;
      EXPECT_TRUE(AllFinite(values)) << theta;
    }
  }
  Values values = Centre();
  EXPECT_FALSE(Project(Eigen::Vector3d::Zero(), &values)) << "the camera's origin has no image";
}

TEST_P(EveryCameraModel, GivesNoNanForHugeAndTinyPointsAndPixels) {
  std::vector<double> sizes;
  for (int power = -320; power <= 300; power += 20) sizes.push_back(std::pow(10.0, power));
  sizes.push_back(0);
  std::vector<double> J_params(kMaxObservationSize * Model().params.size());
  double J_point[kMaxObservationSize * 3];
  for (const double lateral : sizes) {
    for (const double axial : sizes) {
      for (const double sign : {-1.0, 1.0}) {
        Values values = Centre();
        const Eigen::Vector3d p_cam(lateral, -0.3 * lateral, sign * axial);
        if (Project(p_cam, &values)) {
          EXPECT_TRUE(AllFinite(values)) << p_cam.transpose();
        }
        double predicted[kMaxObservationSize];
        const Values centre = Centre();
        if (Model().project_with_jacobian(
                Params(), Config(), centre.data(), p_cam, predicted, J_params.data(), J_point)) {
          for (size_t r = 0; r < Model().measured.size(); ++r) {
            EXPECT_TRUE(std::isfinite(predicted[r])) << p_cam.transpose();
          }
        }
      }
    }
    for (const double sign : {-1.0, 1.0}) {
      const std::optional<Ray> ray = Unproject(At(sign * lateral, lateral));
      if (ray) {
        EXPECT_TRUE(ray->direction.allFinite() && ray->origin.allFinite()) << lateral;
      }
    }
  }
  const double nan = std::numeric_limits<double>::quiet_NaN();
  Values values = Centre();
  EXPECT_FALSE(Project(Eigen::Vector3d(nan, 0, 1), &values));
  EXPECT_FALSE(Project(Eigen::Vector3d(0, 0, nan), &values));
}

TEST_P(EveryCameraModel, HasDerivativesThatAgreeWithDifferencesOverTheImage) {
  for (const Values& seen : Grid(6)) {
    const std::optional<Ray> ray = Unproject(seen);
    ASSERT_TRUE(ray.has_value());
    for (const double depth : Depths()) {
      CheckJacobian(ray->origin + depth * ray->direction, seen, kDerivative);
    }
  }
}

TEST_P(EveryCameraModel, HasDerivativesOnTheOpticalAxisAndNearIt) {
  for (const double depth : Depths()) {
    CheckJacobian({0, 0, depth}, Centre(), kDerivative);
    for (const double offset : {1e-300, 1e-160, 1e-15, 1e-9, 1e-5, 1e-3}) {
      CheckJacobian({offset * depth, 0, depth}, Centre(), kDerivative);
      CheckJacobian({0, -offset * depth, depth}, Centre(), kDerivative);
      CheckJacobian({-offset * depth, offset * depth, depth}, Centre(), kDerivative);
    }
  }
}

TEST_P(EveryCameraModel, HasDerivativesAtTheEdgeOfItsDomain) {
  if (!Model().central) GTEST_SKIP() << "directions alone do not fix an image point";
  for (const double phi : Azimuths()) {
    const double theta = std::min(EdgeOfDomain(phi), std::numbers::pi) - 4 * kEdgeMargin;
    for (const double depth : Depths()) {
      CheckJacobian(depth * Direction(theta, phi), Centre(), kDerivativeAtEdge);
    }
  }
}

TEST_P(EveryCameraModel, SeesPointsOfOneRayInOnePixelWhenItIsCentral) {
  if (!Model().central) GTEST_SKIP() << "asked of central models only";
  for (const Values& seen : Grid(10)) {
    const std::optional<Ray> ray = Unproject(seen);
    ASSERT_TRUE(ray.has_value());
    EXPECT_EQ(ray->origin, Eigen::Vector3d::Zero());
    for (const double depth : Depths()) {
      const Eigen::Vector3d p_cam = depth * ray->direction;
      std::vector<double> J_params(kMaxObservationSize * Model().params.size());
      double predicted[kMaxObservationSize], J_point[kMaxObservationSize * 3];
      ASSERT_TRUE(Model().project_with_jacobian(
          Params(), Config(), seen.data(), p_cam, predicted, J_params.data(), J_point));
      for (size_t r = 0; r < Model().measured.size(); ++r) {
        const Eigen::Map<const Eigen::Vector3d> row(J_point + 3 * r);
        EXPECT_NEAR(row.dot(p_cam), 0, kEuler * row.norm() * p_cam.norm());
      }
    }
  }
}

TEST_P(EveryCameraModel, HasAsManyNamesUnitsAndLimitsAsParameters) {
  EXPECT_FALSE(Model().source.empty());
  EXPECT_FALSE(Model().params.empty());
  ASSERT_FALSE(Model().measured.empty());
  EXPECT_LE(Model().measured.size() + Model().context.size(), kMaxObservationSize);
  ASSERT_EQ(Model().params.size(), Model().example.size());
  ASSERT_EQ(Model().config.size(), Model().example_config.size());
  EXPECT_GT(Model().example_size[0], 0);
  EXPECT_GT(Model().example_size[1], 0);
  std::set<std::string_view> names;
  const auto check = [&](std::span<const Param> params, std::span<const double> example) {
    for (size_t i = 0; i < params.size(); ++i) {
      EXPECT_FALSE(params[i].name.empty());
      EXPECT_FALSE(params[i].unit.empty()) << params[i].name;
      EXPECT_TRUE(names.insert(params[i].name).second) << params[i].name << " stands twice";
      EXPECT_GE(params[i].scale, 0) << params[i].name;
      EXPECT_LT(params[i].lower, example[i]) << params[i].name;
      EXPECT_LT(example[i], params[i].upper) << params[i].name;
    }
  };
  check(Model().params, Model().example);
  check(Model().config, Model().example_config);
  std::set<std::string_view> columns{"camera", "frame", "marker", "sigma", "dx", "dy", "used"};
  for (const auto& list : {Model().measured, Model().context}) {
    for (const std::string_view name : list) {
      EXPECT_FALSE(name.empty());
      EXPECT_TRUE(columns.insert(name).second) << name << " stands twice";
    }
  }
}

TEST_P(EveryCameraModel, GetsEqualParametersBackFromASessionFile) {
  const std::filesystem::path path =
      std::filesystem::temp_directory_path() /
      ("plenocal_model_" + std::string(Model().name) + std::to_string(::getpid()) + ".yaml");
  {
    std::ofstream file(path);
    file.precision(std::numeric_limits<double>::max_digits10);
    file << "plenocal: 1\ntarget: t.yaml\ncameras:\n  cam:\n    model: " << Model().name
         << "\n    detections: d.csv\n    image_size: [640, 480]\n";
    for (size_t i = 0; i < Model().config.size(); ++i) {
      file << "    " << Model().config[i].name << ": " << Model().example_config[i] << "\n";
    }
    file << "    initial: {";
    for (size_t i = 0; i < Model().params.size(); ++i) {
      file << (i > 0 ? ", " : "") << Model().params[i].name << ": " << Model().example[i] / 3 * 3;
    }
    file << "}\n    fixed: [" << Model().params.back().name << "]\n";
  }
  const Session session = ReadSession(path, CameraModels());
  std::filesystem::remove(path);
  ASSERT_EQ(session.cameras.size(), 1);
  const SessionCamera& camera = session.cameras[0];
  EXPECT_EQ(camera.model->name, Model().name);
  for (size_t i = 0; i < Model().params.size(); ++i) {
    EXPECT_EQ(camera.initial[i], Model().example[i] / 3 * 3) << Model().params[i].name;
    EXPECT_EQ(camera.fixed[i], i + 1 == Model().params.size());
  }
  for (size_t i = 0; i < Model().config.size(); ++i) {
    EXPECT_EQ(camera.config[i], Model().example_config[i]) << Model().config[i].name;
  }
}

TEST(Registry, HoldsEveryHeaderOfItsFolderUnderTheNameOfItsFile) {
  std::set<std::string> from_files, from_registry;
  for (const auto& entry : std::filesystem::directory_iterator(PLENOCAL_MODELS_FOLDER)) {
    if (entry.path().extension() != ".h" || entry.path().filename() == "registry.h") continue;
    std::string name = entry.path().stem().string();
    std::replace(name.begin(), name.end(), '_', '-');
    from_files.insert(name);
  }
  for (const CameraModel& model : CameraModels()) from_registry.emplace(model.name);
  EXPECT_FALSE(from_files.empty());
  EXPECT_EQ(from_files, from_registry);
  EXPECT_EQ(from_registry.size(), CameraModels().size()) << "two models share a name";
}

TEST(Registry, FindsModelsByTheirExactNameOnly) {
  for (const CameraModel& model : CameraModels()) {
    EXPECT_EQ(FindModel(CameraModels(), model.name), &model);
  }
  EXPECT_EQ(FindModel(CameraModels(), "no-such-model"), nullptr);
  EXPECT_EQ(FindModel(CameraModels(), ""), nullptr);
}

}  // namespace
}  // namespace plenocal
