// SPDX-License-Identifier: Apache-2.0
#include "engine/formats/matlab_intrinsics.h"

#include <gmock/gmock.h>

#include <cmath>
#include <map>
#include <string>
#include <vector>

#include "models/registry.h"
#include "tests/engine/formats/camera_of_model.h"
#include "tests/refusal.h"

namespace plenocal {
namespace TEST_FILE {

using testing::CameraOf;
using ::testing::ElementsAre;
using testing::RefusalOf;
using ::testing::StartsWith;

using Arguments = std::map<std::string, std::vector<double>>;

Arguments ArgumentsOf(const CalibratedCamera& camera) {
  Arguments arguments;
  for (const MatlabArgument& argument : ToMatlab(camera)) {
    arguments[argument.name] = argument.values;
    EXPECT_EQ(argument.rows, argument.name == "StretchMatrix" ? 2 : 1) << argument.name;
  }
  return arguments;
}

CalibratedCamera Read(const Arguments& arguments, bool is_fisheye) {
  // All arguments have one size but for two or three radial coefficients.
  const auto read = [&](const std::string& name, size_t least, size_t most) {
    const bool is_radial = name == "RadialDistortion";
    const std::vector<double>& values = arguments.at(name);
    EXPECT_EQ(least, is_radial ? 2 : values.size()) << name;
    EXPECT_EQ(most, is_radial ? 3 : values.size()) << name;
    return values;
  };
  return FromMatlab(read, is_fisheye, "camera.mat");
}

// cameraIntrinsics has rows before columns, pixels that begin at 1, and the skew in px.
TEST(MatlabIntrinsics, AreThoseOfItsManual) {
  const CalibratedCamera camera = CameraOf(
      "pinhole-radtan+skew", {500, 510, 320, 240, -0.25, 0.125, 0.001, -0.002, 0.0625, 0.004});
  const Arguments arguments = ArgumentsOf(camera);
  EXPECT_THAT(arguments.at("FocalLength"), ElementsAre(500, 510));
  EXPECT_THAT(arguments.at("PrincipalPoint"), ElementsAre(321, 241));
  EXPECT_THAT(arguments.at("ImageSize"), ElementsAre(480, 640));
  EXPECT_THAT(arguments.at("RadialDistortion"), ElementsAre(-0.25, 0.125, 0.0625));
  EXPECT_THAT(arguments.at("TangentialDistortion"), ElementsAre(0.001, -0.002));
  EXPECT_THAT(arguments.at("Skew"), ElementsAre(2));
  const CalibratedCamera back = Read(arguments, false);
  EXPECT_EQ(back.model->name, camera.model->name);
  EXPECT_EQ(back.params, camera.params);
  EXPECT_EQ(back.image_size, camera.image_size);
}

TEST(MatlabIntrinsics, AreOfTheModelWithTheirCoefficients) {
  const auto model_of =
      [](const std::vector<double>& radial, const std::vector<double>& tangential, double skew) {
        return std::string(Read({{"FocalLength", {500, 500}},
                                 {"PrincipalPoint", {320, 240}},
                                 {"ImageSize", {480, 640}},
                                 {"RadialDistortion", radial},
                                 {"TangentialDistortion", tangential},
                                 {"Skew", {skew}}},
                                false)
                               .model->name);
      };
  EXPECT_EQ(model_of({0, 0}, {0, 0}, 0), "pinhole");
  EXPECT_EQ(model_of({0.1, 0}, {0, 0}, 0), "pinhole-radial3");
  EXPECT_EQ(model_of({0.1, 0, 0.2}, {0, 0}, 0), "pinhole-radial3");
  EXPECT_EQ(model_of({0, 0}, {0, 0.1}, 0), "pinhole-radtan4");
  EXPECT_EQ(model_of({0, 0, 0.1}, {0.1, 0}, 0), "pinhole-radtan");
  EXPECT_EQ(model_of({0, 0}, {0, 0}, 1), "pinhole+skew");
  EXPECT_EQ(model_of({0, 0.1}, {0, 0}, 1), "pinhole-radial3+skew");
}

TEST(MatlabIntrinsics, OfAFisheyeAreReadBack) {
  const CameraModel* const model = FindModel(CameraModels(), "scaramuzza");
  CalibratedCamera camera = CameraOf("scaramuzza", {model->example.begin(), model->example.end()});
  camera.image_size = model->example_size;
  const Arguments arguments = ArgumentsOf(camera);
  EXPECT_EQ(arguments.at("MappingCoefficients").size(), 4);
  EXPECT_THAT(arguments.at("ImageSize"), ElementsAre(camera.image_size[1], camera.image_size[0]));
  const CalibratedCamera back = Read(arguments, true);
  ASSERT_EQ(back.params.size(), camera.params.size());
  EXPECT_EQ(back.image_size, camera.image_size);
  for (size_t k = 0; k < camera.params.size(); ++k) {
    EXPECT_NEAR(back.params[k], camera.params[k], 1e-12 * (1 + std::abs(camera.params[k])))
        << model->params[k].name;
  }
}

TEST(MatlabIntrinsics, OfAnImageHaveAWholeNumberOfPixels) {
  for (const double rows : {0.0, -480.0, 480.5, 1e6}) {
    Arguments arguments = ArgumentsOf(CameraOf("pinhole", {500, 500, 320, 240}));
    arguments["ImageSize"] = {rows, 640};
    EXPECT_THAT(RefusalOf([&] { (void)Read(arguments, false); }),
                StartsWith("camera.mat: ImageSize: expected a number of pixels, found "))
        << rows;
  }
}

}  // namespace TEST_FILE
}  // namespace plenocal
