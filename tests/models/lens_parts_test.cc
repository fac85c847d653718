// SPDX-License-Identifier: Apache-2.0
//
// Models of a lens and parts: equal to models that have the parts built in, with every property of
// a model.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <Eigen/Core>
#include <array>
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
  EXPECT_LT(Difference({"ucm+pupil+radtan+tilt+skew", with({0.6, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0})},
                       {"ucm", with({0.6})},
                       1.5),
            kRounding);
}

TEST(LensParts, HaveAllPropertiesOfAModel) {
  std::vector<std::string> names{"ucm+radtan",
                                 "equidistant+radial6+prism",
                                 "pinhole+brown+skew",
                                 "pinhole-radtan12+tilt",
                                 "splined+tilt",
                                 "splined+pupil",
                                 "kannala-brandt4+pupil+skew",
                                 "equisolid+thin-prism+tilt+skew"};
  for (const LensPart& part : LensParts()) names.push_back("equisolid+" + std::string(part.name));
  for (const std::string& name : names) {
    for (const ModelProperty& property : ModelProperties()) {
      // A change of a high power's coefficient moves the edge itself.
      if (property.name == "HasDerivativesAtTheEdge") continue;
      if (property.central_only && !Model(name).IsCentral()) continue;
      EXPECT_THAT(property.violations(Model(name)), IsEmpty()) << name << ": " << property.claim;
    }
  }
}

// The pupil of an equidistant lens lies on the axis where the ray of a point meets it, so that the
// point's place in the image follows from similar triangles.
TEST(LensParts, PupilMovesTheRaysAlongTheAxis) {
  const std::vector<double> params{400, 400, 320, 240, 0.003, -0.0005, 0.0002};
  const CameraModel& model = Model("equidistant+pupil");
  EXPECT_EQ(model.centre, Centre::kAxis);
  for (const double theta : {0.0, 1e-8, 0.3, 1.0, 1.9, 2.5}) {
    const double q = theta * theta;
    const double z_p =
        theta > 0 ? (theta / std::sin(theta) - 1) * (params[4] + q * (params[5] + q * params[6]))
                  : 0;
    const double seen[kMaxObservationSize] = {320 + 400 * theta * 0.6, 240 + 400 * theta * 0.8};
    const auto ray = model.Unproject(params.data(), nullptr, seen);
    ASSERT_TRUE(ray) << theta;
    EXPECT_NEAR((ray->origin - Eigen::Vector3d(0, 0, z_p)).norm(), 0, 1e-15) << theta;
    for (const double distance : {0.1, 0.3, 10.0, 1e6}) {
      const Eigen::Vector3d p(0.6 * distance * std::sin(theta),
                              0.8 * distance * std::sin(theta),
                              z_p + distance * std::cos(theta));
      double u[2];
      ASSERT_TRUE(model.Project(params.data(), nullptr, seen, p, u)) << theta;
      EXPECT_NEAR(u[0], seen[0], 1e-10) << theta << " " << distance;
      EXPECT_NEAR(u[1], seen[1], 1e-10) << theta << " " << distance;
    }
  }
  const double beyond[kMaxObservationSize] = {320 + 400 * 2.62, 240};
  EXPECT_FALSE(model.Unproject(params.data(), nullptr, beyond));
  double unseen[2];
  EXPECT_FALSE(model.Project(
      params.data(), nullptr, beyond, {std::sin(2.64), 0, std::cos(2.64)}, unseen));
  const DepthRange seen{.nearest = 0.5, .farthest = 0.7};
  const std::array<size_t, 1> focal{0}, pupil{4};
  EXPECT_THAT(model.Remedy(pupil, seen), HasSubstr("0.5 to 0.7 m: add frames that are nearer"));
  EXPECT_EQ(model.Remedy(focal, seen), "");
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
  EXPECT_THAT(message("ucm+radtan+pupil"), HasSubstr("name it first: 'ucm+pupil+...'"));
  EXPECT_EQ(message("ucm+skew"), "made");
  EXPECT_EQ(FindModel(CameraModels(), "ucm+skew"), FindModel(CameraModels(), "ucm+skew"));
}

}  // namespace TEST_FILE
}  // namespace plenocal
