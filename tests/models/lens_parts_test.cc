// SPDX-License-Identifier: Apache-2.0
//
// Models of a lens and parts: equal to models that have the parts built in, with every property of
// a model.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <Eigen/Core>
#include <cmath>
#include <string>
#include <utility>
#include <vector>

#include "calib/base/error.h"
#include "calib/camera/camera_model.h"
#include "models/check/model_properties.h"
#include "models/registry.h"
#include "models/start/lens_with_parts.h"
#include "tests/calib/random.h"

namespace plenocal {
namespace TEST_FILE {

using ::testing::HasSubstr;
using ::testing::IsEmpty;
using testing::Random;

const CameraModel& Model(std::string_view name) { return *FindModel(CameraModels(), name); }

// Largest difference of two models' images of directions up to `angle` from the axis, px.
double Difference(const std::pair<std::string_view, std::vector<double>>& a,
                  const std::pair<std::string_view, std::vector<double>>& b,
                  double angle) {
  Random random(3);
  double largest = 0;
  for (int i = 0; i < 200; ++i) {
    const double theta = random.Uniform(0, angle), phi = random.Uniform(0, 6.3);
    const Eigen::Vector3d p(
        std::sin(theta) * std::cos(phi), std::sin(theta) * std::sin(phi), std::cos(theta));
    Eigen::Vector2d u, v;
    EXPECT_TRUE(Model(a.first).Project(a.second.data(), nullptr, u.data(), p, u.data()));
    EXPECT_TRUE(Model(b.first).Project(b.second.data(), nullptr, v.data(), p, v.data()));
    largest = std::max(largest, (u - v).norm());
  }
  return largest;
}

TEST(LensParts, AreTheModelsThatHaveThemBuiltIn) {
  constexpr double kRounding = 1e-11;
  const std::vector<double> f{600, 605, 322, 243}, k{-0.2, 0.03, 1e-3, -5e-4};
  const auto with = [&](std::vector<double> more) {
    std::vector<double> all = f;
    all.insert(all.end(), more.begin(), more.end());
    return all;
  };
  EXPECT_LT(Difference({"pinhole+radtan", with(k)}, {"pinhole-radtan4", with(k)}, 0.6), kRounding);
  const std::vector<double> fisheye{-0.01, 0.003, -2e-4, 1e-5};
  EXPECT_LT(
      Difference({"equidistant+radial4", with(fisheye)}, {"kannala-brandt4", with(fisheye)}, 1.5),
      kRounding);
  // Parts without effect.
  EXPECT_EQ(
      Difference(
          {"ucm+radtan+tilt+skew", with({0.6, 0, 0, 0, 0, 0, 0, 0})}, {"ucm", with({0.6})}, 1.5),
      0);
}

TEST(LensParts, HaveAllPropertiesOfAModel) {
  std::vector<std::string> names{"ucm+radtan",
                                 "equidistant+radial6+prism",
                                 "pinhole+brown+skew",
                                 "pinhole-radtan12+tilt",
                                 "equisolid+thin-prism+tilt+skew"};
  for (const LensPart& part : LensParts()) names.push_back("equisolid+" + std::string(part.name));
  for (const std::string& name : names) {
    for (const ModelProperty& property : ModelProperties()) {
      // A change of a high power's coefficient moves the edge itself.
      if (property.name == "HasDerivativesAtTheEdge") continue;
      EXPECT_THAT(property.violations(Model(name)), IsEmpty()) << name << ": " << property.claim;
    }
  }
}

TEST(LensParts, WithoutASenseAreRefused) {
  const auto message = [](std::string_view name) -> std::string {
    try {
      return FindModel(CameraModels(), name) == nullptr ? "none" : "made";
    } catch (const Error& error) {
      return error.what();
    }
  };
  EXPECT_THAT(message("ucm+tlit"), HasSubstr("there is no part 'tlit'"));
  EXPECT_THAT(message("ucm+tlit"), HasSubstr("tilt"));
  EXPECT_THAT(message("ucm+"), HasSubstr("no part ''"));
  EXPECT_THAT(message("kannala-brandt4+brown"),
              HasSubstr("two of its parts have a parameter 'k_1'"));
  EXPECT_EQ(message("nothing+tilt"), "none");
  EXPECT_EQ(message("focused-plenoptic+tilt"), "none");
  EXPECT_EQ(message("splined+tilt"), "none");
  EXPECT_EQ(message("ucm+skew"), "made");
  EXPECT_EQ(FindModel(CameraModels(), "ucm+skew"), FindModel(CameraModels(), "ucm+skew"));
}

}  // namespace TEST_FILE
}  // namespace plenocal
