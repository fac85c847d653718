// SPDX-License-Identifier: Apache-2.0
#include "models/splined.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <span>
#include <string>
#include <vector>

#include "models/check/model_properties.h"
#include "models/registry.h"
#include "tests/refusal.h"

namespace plenocal {
namespace TEST_FILE {

using ::testing::HasSubstr;
using ::testing::IsEmpty;

const CameraModel& Model(std::string_view name) { return *FindModel(CameraModels(), name); }

TEST(Splined, OfAnyKnotsHasAllPropertiesOfAModel) {
  for (const char* name : {"splined-4x4", "splined2-3x3", "splined-14x7", "splined2-11x9"}) {
    for (const ModelProperty& property : ModelProperties()) {
      EXPECT_THAT(property.violations(Model(name)), IsEmpty()) << name << ": " << property.claim;
    }
  }
}

// Knots by rows, x before y; names have the column before the row.
TEST(Splined, NamesItsKnotsByColumnAndRow) {
  const std::span<const Param> params = Model("splined-11x8").params;
  ASSERT_EQ(params.size(), 5U + 2 * 11 * 8);
  EXPECT_EQ(params[5].name, "x_00_00");
  EXPECT_EQ(params[6].name, "y_00_00");
  EXPECT_EQ(params[7].name, "x_01_00");
  EXPECT_EQ(params[5 + 2 * 11].name, "x_00_01");
  EXPECT_EQ(params.back().name, "y_10_07");
}

TEST(Splined, ProjectsAsMrcal) {
  struct Case {
    const char* name;
    double fov;
    std::vector<std::vector<double>> pixels;  // of mrcal 2.2's project()
  };
  const std::vector<Case> cases{{"splined-11x8",
                                 170,
                                 {{1649.0712452300, 1352.6007967640},
                                  {192.8915505250, 1432.5150984441},
                                  {625.9050229665, -799.4704091680},
                                  {4116.5020833124, 3201.0685729118}}},
                                {"splined2-11x8",
                                 170,
                                 {{1649.4131569881, 1349.7958210114},
                                  {196.0061871602, 1432.3696209659},
                                  {627.9332521242, -800.6371878182},
                                  {4111.7355759630, 3198.7858652272}}},
                                {"splined2-30x20",
                                 170,
                                 {{1644.5226359787, 1356.5844743397},
                                  {189.2052432181, 1403.7242832262},
                                  {592.5266408665, -800.7974226315},
                                  {4133.1766295230, 3192.4237970600}}},
                                {"splined-20x14",
                                 160,
                                 {{1623.6113468056, 1341.5793692795},
                                  {193.2487616076, 1439.7929666552},
                                  {608.2977204854, -796.4204556198},
                                  {4131.6152176619, 3192.4970778310}}},
                                {"splined2-3x3",
                                 170,
                                 {{1659.9408800602, 1361.0580077537},
                                  {198.5536576513, 1434.3902792779},
                                  {617.0829409655, -786.1918695566},
                                  {4136.0345343442, 3193.5398379121}}}};
  const std::vector<Eigen::Vector3d> points{
      {0.1, 0.2, 1}, {-1.1, 0.3, 1}, {-0.9, -1.5, 1}, {1.3, 0.9, -0.1}};
  for (const Case& expected : cases) {
    SCOPED_TRACE(expected.name);
    const CameraModel& model = Model(expected.name);
    std::vector<double> params{1500, 1800, 1499.5, 999.5, expected.fov};
    for (int k = 0; params.size() < model.params.size(); ++k) {
      params.push_back(0.02 * std::sin(0.7 * k * k));
    }
    for (size_t i = 0; i < points.size(); ++i) {
      double u[2] = {};
      EXPECT_TRUE(model.Project(params.data(), nullptr, nullptr, points[i], u));
      EXPECT_NEAR(u[0], expected.pixels[i][0], 1e-9);
      EXPECT_NEAR(u[1], expected.pixels[i][1], 1e-9);
    }
  }
}

TEST(Splined, WithoutASizeIsWhatItWasWhenItHadNoFamily) {
  const CameraModel& model = Model("splined");
  EXPECT_EQ(&Model("splined-11x9"), &model);
  EXPECT_NE(&Model("splined2-11x9"), &model);
  const std::vector<std::vector<double>> points{
      {0.1, 0.2, 1, 342.64831040822867, 284.6899219670903},
      {-1.1, -0.9, 1, 157.76158337133589, 106.13237726532734},
      {0.9, -1.5, 0.4, 486.48258092463607, -33.748469492244794}};
  for (const std::vector<double>& point : points) {
    double u[2] = {};
    ASSERT_TRUE(
        model.Project(model.example.data(), nullptr, nullptr, {point[0], point[1], point[2]}, u));
    EXPECT_NEAR(u[0], point[3], 1e-11);
    EXPECT_NEAR(u[1], point[4], 1e-11);
  }
}

TEST(Splined, IsMadeOnceOfEachSize) {
  EXPECT_EQ(&Model("splined-20x14"), &Model("splined-20x14"));
  EXPECT_EQ(Model("splined-20x14").params.size(), 5U + 2 * 20 * 14);
  EXPECT_EQ(Model("splined-20x14").support_size, 37U);
  EXPECT_EQ(Model("splined2-20x14").support_size, 23U);
  EXPECT_EQ(Model("splined-60x40").params.back().name, "y_59_39");
}

TEST(Splined, OfAWrongSizeIsRefused) {
  for (const char* name : {"splined-100x9",
                           "splined-3x4",
                           "splined2-3x2",
                           "splined-20x41",
                           "splined-axb",
                           "splined-20x14x2",
                           "splined-20x14+tilt",
                           "splined--20x14",
                           "splined-99999999999x9",
                           "splined-",
                           "splined2"}) {
    EXPECT_THAT(testing::RefusalOf([&] { FindModel(CameraModels(), name); }),
                ::testing::AllOf(HasSubstr("camera model '" + std::string(name) + "': "),
                                 HasSubstr("like splined-20x14")));
  }
  EXPECT_EQ(FindModel(CameraModels(), "splined4-20x14"), nullptr);
  EXPECT_EQ(FindModel(CameraModels(), "splines-20x14"), nullptr);
}

}  // namespace TEST_FILE
}  // namespace plenocal
