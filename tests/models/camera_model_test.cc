// SPDX-License-Identifier: Apache-2.0
//
// Properties that every camera model must have; run on all of the registry.
#include "calib/camera/camera_model.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <limits>
#include <memory>
#include <set>
#include <string>
#include <tuple>

#include "calib/base/error.h"
#include "calib/files/session.h"
#include "models/check/model_properties.h"
#include "models/registry.h"
#include "models/start/central_model.h"

namespace plenocal {
namespace TEST_FILE {

class EveryCameraModel : public ::testing::TestWithParam<CameraModel> {
 protected:
  [[nodiscard]] const CameraModel& Model() const { return GetParam(); }
};

std::string TestName(std::string_view model) {
  std::string name(model);
  std::replace(name.begin(), name.end(), '-', '_');
  return name;
}

INSTANTIATE_TEST_SUITE_P(Registry,
                         EveryCameraModel,
                         ::testing::ValuesIn(CameraModels().begin(), CameraModels().end()),
                         [](const auto& test) { return TestName(test.param.name); });

class EveryProperty : public ::testing::TestWithParam<std::tuple<CameraModel, ModelProperty>> {};

INSTANTIATE_TEST_SUITE_P(
    Registry,
    EveryProperty,
    ::testing::Combine(::testing::ValuesIn(CameraModels().begin(), CameraModels().end()),
                       ::testing::ValuesIn(ModelProperties().begin(), ModelProperties().end())),
    [](const auto& test) {
      return TestName(std::get<0>(test.param).name) + "_" +
             std::string(std::get<1>(test.param).name);
    });

TEST_P(EveryProperty, HoldsForEveryCameraModel) {
  const auto& [model, property] = GetParam();
  if (property.central_only && !model.IsCentral()) GTEST_SKIP() << "asked of central models only";
  EXPECT_THAT(property.violations(model), ::testing::IsEmpty()) << property.claim;
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

TEST(Remedy, OfAPlenopticModelsOwnParameterIsAboutThatParameter) {
  const std::array<size_t, 1> own{9};
  const DepthRange seen{.nearest = 0.5, .farthest = 1};
  const auto remedy = [&](const char* model) {
    return FindModel(CameraModels(), model)->Remedy(own, seen);
  };
  EXPECT_THAT(remedy("focused-plenoptic-pupil"), ::testing::HasSubstr("fixed: [f_L]"));
  const std::string of_tilt = remedy("focused-plenoptic-tilt");
  EXPECT_THAT(of_tilt, ::testing::HasSubstr("fixed: [t_x, t_y]"));
  EXPECT_THAT(of_tilt, ::testing::Not(::testing::HasSubstr("f_L")));
}

TEST(Registry, FindsModelsByTheirExactNameOnly) {
  for (const CameraModel& model : CameraModels()) {
    EXPECT_EQ(FindModel(CameraModels(), model.name), &model);
  }
  EXPECT_EQ(FindModel(CameraModels(), "no-such-model"), nullptr);
  EXPECT_EQ(FindModel(CameraModels(), ""), nullptr);
}

// An axial camera: its rays meet 10 mm before the origin.
struct Axial : CentralModel {
  static constexpr std::string_view kName = "axial", kSource = "a test";
  static constexpr Centre kCentre = Centre::kAxis;
  static constexpr std::array kParams{Param{"f", "px", 0}};
  static constexpr std::array kExample{400.0};
  static constexpr ImageSize kExampleSize{640, 480};
  static constexpr double kMiddle = 300, kPupil = 0.01;  // px, m

  template <typename T>
  static bool Image(const T* params, const Vector3<T>& p, const T& h, T* u) {
    const T z = p.z() - kPupil * h;
    u[0] = params[0] * p.x() / z + kMiddle;
    u[1] = params[0] * p.y() / z + kMiddle;
    return z > 0.0 && std::isfinite(ValueOf(u[0])) && std::isfinite(ValueOf(u[1]));
  }
  template <typename T>
  static bool Project(const T* params, const double*, const double*, const Vector3<T>& p, T* u) {
    return Image(params, p, T(1.0), u);
  }
  static std::optional<Ray> Unproject(const double* params, const double*, const double* values) {
    const Eigen::Vector3d direction(values[0] - kMiddle, values[1] - kMiddle, params[0]);
    if (!direction.allFinite()) return std::nullopt;
    return Ray{{0, 0, kPupil}, direction.stableNormalized()};
  }
  static std::vector<StartCandidate> Start(const StartProblem& /*problem*/) { return {}; }
};

struct AxialToInfinity : Axial {
  template <typename T>
  static bool Project(
      const T* params, const double*, const double*, const Vector3<T>& p, const T& h, T* u) {
    return Image(params, p, h, u);
  }
};

TEST(CameraModel, ProjectsPointsAtInfinityWhereItsHeaderDoes) {
  size_t violated = 0;
  for (const CameraModel& model : {MakeCameraModel<Axial>(), MakeCameraModel<AxialToInfinity>()}) {
    EXPECT_EQ((CheckModel(model, &violated), violated), 0) << CheckModel(model, &violated);
    const Eigen::Vector3d p(0.1, 0.2, 1);
    double u[2], J_point[6];
    for (const double h : {0.0, 0.5, -1.0}) {
      EXPECT_EQ(model.Project(model.example.data(), nullptr, u, p, u, h), model.homogeneous) << h;
      EXPECT_EQ(model.ProjectWithJacobian(
                    model.example.data(), nullptr, u, p, {.predicted = u, .J_point = J_point}, h),
                model.homogeneous)
          << h;
    }
  }
  EXPECT_FALSE(MakeCameraModel<Axial>().homogeneous);
}

TEST(CameraModel, OfPlenopticCamerasSeesPointsAsIfTheyWereDivided) {
  for (const CameraModel& model : CameraModels()) {
    if (!model.plenoptic) continue;
    EXPECT_TRUE(model.homogeneous);
    const Eigen::Vector3d p(0.1, -0.05, 1);
    const double lens[kMaxObservationSize] = {0, 0, 420, 380};
    double expected[2], found[2];
    const auto project = [&](const Eigen::Vector3d& at, double h, double* u) {
      return model.Project(model.example.data(), model.example_config.data(), lens, at, u, h);
    };
    ASSERT_TRUE(project(p, 1, expected));
    for (const double h : {0.5, 1e-6, 40.0}) {
      ASSERT_TRUE(project(h * p, h, found)) << h;
      EXPECT_NEAR(found[0], expected[0], 1e-9);
      EXPECT_NEAR(found[1], expected[1], 1e-9);
    }
    // Behind the camera, as p / h of both signs.
    EXPECT_FALSE(project(-p, 1, found));
    EXPECT_FALSE(project(-p, -1, found));
  }
}

// Point by point, from and to arrays of one coordinate each.
void ProjectColumns(const CameraModel& model,
                    const double* params,
                    const double* config,
                    const PointBlock& in,
                    const ProjectionOutput& out) {
  const size_t n = in.count, width = model.params.size();
  std::vector<double> J_params(2 * width);
  double values[kMaxObservationSize], u[2], J_point[6];
  for (size_t i = 0; i < n; ++i) {
    for (size_t k = 0; k < kMaxObservationSize; ++k) values[k] = in.values[k * n + i];
    const Eigen::Vector3d p(in.p[i], in.p[n + i], in.p[2 * n + i]);
    if (!model.ProjectWithJacobian(params, config, values, p, {u, J_params.data(), J_point})) {
      std::fill_n(u, 2, std::numeric_limits<double>::quiet_NaN());
    }
    for (size_t r = 0; r < 2; ++r) out.predicted[r * n + i] = u[r];
    for (size_t k = 0; k < J_params.size(); ++k) out.J_params[k * n + i] = J_params[k];
    for (size_t k = 0; k < 6; ++k) out.J_point[k * n + i] = J_point[k];
  }
}

// Where the derivative of the distorted radius is zero, by hand.
TEST(CameraModel, EndsWhereTheDistortedRadiusCeasesToGrow) {
  struct Lens {
    const char* model;
    std::vector<double> coefficients;
    double angle;  // rad
  };
  const std::vector<Lens> lenses{
      {"kannala-brandt4", {-0.2, 0, 0, 0}, std::sqrt(1 / 0.6)},            // 1 - 0.6 t^2
      {"kannala-brandt4", {0, 0, 0, -0.02}, std::pow(1 / 0.18, 1.0 / 8)},  // 1 - 0.18 t^8
      {"pinhole-radial3", {-0.3, 0, 0}, std::atan(std::sqrt(1 / 0.9))},
      {"pinhole-radtan4", {-0.3, 0, 0, 0}, std::atan(std::sqrt(1 / 0.9))},
      {"pinhole-radtan", {0, -0.1, 0, 0, 0}, std::atan(std::pow(2, 0.25))},  // 1 - 0.5 r^4
  };
  for (const Lens& lens : lenses) {
    const CameraModel& model = *FindModel(CameraModels(), lens.model);
    std::vector<double> params{300, 300, 320, 240};
    params.insert(params.end(), lens.coefficients.begin(), lens.coefficients.end());
    const auto images = [&](double angle, double azimuth) {
      const Eigen::Vector3d p(std::sin(angle) * std::cos(azimuth),
                              std::sin(angle) * std::sin(azimuth),
                              std::cos(angle));
      double u[2];
      return model.Project(params.data(), nullptr, nullptr, p, u);
    };
    for (const double azimuth : {0.0, 1.0, 4.0}) {
      EXPECT_TRUE(images(lens.angle - 0.001, azimuth)) << lens.model;
      EXPECT_FALSE(images(lens.angle + 0.001, azimuth)) << lens.model;
    }
  }
}

TEST(ProjectPoints, GivesBlocksToModelsThatTakeThem) {
  CameraModel model = *FindModel(CameraModels(), "kannala-brandt4");
  model.functions.project_block = &ProjectColumns;
  size_t violated = 0;
  EXPECT_EQ((CheckModel(model, &violated), violated), 0) << CheckModel(model, &violated);
}

// The last test of the registry: it grows.
TEST(Registry, KeepsTheDataOfModelsThatAreMadeAtRunTime) {
  struct Data {
    std::string name = "made-at-run-time";
    double x = 7;
  };
  auto data = std::make_shared<Data>();
  CameraModel model = *FindModel(CameraModels(), "pinhole");
  model.name = data->name;
  model.self = data.get();
  model.functions.project = [](const CameraModel& own,
                               const double* /*params*/,
                               const double* /*config*/,
                               const double* /*values*/,
                               const Eigen::Vector3d& /*p*/,
                               double /*h*/,
                               double* u) {
    u[0] = u[1] = static_cast<const Data*>(own.self)->x;
    return true;
  };
  const CameraModel* const added = &AddCameraModel(model, data, "test");
  EXPECT_EQ(FindModel(CameraModels(), "made-at-run-time"), added);
  EXPECT_THROW(AddCameraModel(model, data, "test"), Error);
  data.reset();
  double u[2] = {};
  EXPECT_TRUE(added->Project(nullptr, nullptr, nullptr, {0, 0, 1}, u));
  EXPECT_EQ(u[0], 7);
}

}  // namespace TEST_FILE
}  // namespace plenocal
