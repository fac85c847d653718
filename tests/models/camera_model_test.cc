// SPDX-License-Identifier: Apache-2.0
//
// Properties that every camera model must have; run on all of the registry.
#include "calib/camera/camera_model.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <filesystem>
#include <fstream>
#include <limits>
#include <set>
#include <string>
#include <tuple>

#include "calib/files/session.h"
#include "models/check/model_properties.h"
#include "models/registry.h"

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

}  // namespace TEST_FILE
}  // namespace plenocal
