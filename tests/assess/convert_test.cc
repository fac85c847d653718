// SPDX-License-Identifier: Apache-2.0
#include "assess/convert.h"

#include <gmock/gmock.h>

#include <algorithm>
#include <cmath>

#include "calib/base/error.h"
#include "models/registry.h"

namespace plenocal {
namespace TEST_FILE {

using ::testing::HasSubstr;
using ::testing::ThrowsMessage;

CalibratedCamera Camera(const char* model, ImageSize size, std::vector<double> params) {
  CalibratedCamera camera;
  camera.name = "cam";
  camera.model = FindModel(CameraModels(), model);
  camera.image_size = size;
  camera.params = std::move(params);
  return camera;
}

const CameraModel& Model(const char* name) { return *FindModel(CameraModels(), name); }

// RMS, largest error and its place follow from the errors of the pixels.
void ExpectConsistent(const Conversion& conversion, ImageSize size) {
  ASSERT_EQ(conversion.errors.size(), kConvertedColumns * kConvertedRows);
  EXPECT_EQ(conversion.errors.front().u_px, Eigen::Vector2d(0, 0));
  EXPECT_EQ(conversion.errors.back().u_px, Eigen::Vector2d(size[0] - 1, size[1] - 1));
  double squares = 0, largest = 0;
  int seen = 0, unseen = 0;
  Eigen::Vector2d at = Eigen::Vector2d::Zero();
  for (const ConversionError& error : conversion.errors) {
    if (!error.difference_px) {
      ++unseen;
      continue;
    }
    ++seen;
    squares += error.difference_px->squaredNorm();
    if (error.difference_px->norm() <= largest) continue;
    largest = error.difference_px->norm();
    at = error.u_px;
  }
  EXPECT_NEAR(conversion.rms, std::sqrt(squares / seen), 1e-9 * (1 + conversion.rms));
  EXPECT_NEAR(conversion.largest, largest, 1e-12);
  EXPECT_EQ(conversion.largest_at, at);
  EXPECT_EQ(conversion.unseen, unseen);
}

TEST(Convert, OfOneLensInTwoNotationsIsExact) {
  const CalibratedCamera camera =
      Camera("pinhole-radtan4", {640, 480}, {500, 505, 322, 238, -0.2, 0.05, 1e-3, -2e-3});
  const Conversion conversion = Convert(camera, Model("pinhole-radtan8"));
  EXPECT_LT(conversion.rms, 1e-6);
  EXPECT_EQ(conversion.unseen, 0);
  for (size_t k = 0; k < 4; ++k) EXPECT_NEAR(conversion.params[k], camera.params[k], 1e-3) << k;
  ExpectConsistent(conversion, camera.image_size);
}

TEST(Convert, HasTheErrorsOfAModelThatCannotBend) {
  const CalibratedCamera camera =
      Camera("pinhole-radtan4", {640, 480}, {500, 500, 320, 240, -0.2, 0, 0, 0});
  const Conversion conversion = Convert(camera, Model("pinhole"));
  EXPECT_GT(conversion.rms, 1);
  EXPECT_LT(conversion.rms, conversion.largest);
  // Far in the corners, where the polynomial bends most.
  const Eigen::Vector2d away = (conversion.largest_at - Eigen::Vector2d(320, 240)).cwiseAbs();
  EXPECT_GT(away.x(), 300);
  EXPECT_GT(away.y(), 220);
  EXPECT_LT(conversion.params[0], 500);  // of an image that the distortion makes smaller
  ExpectConsistent(conversion, camera.image_size);
}

TEST(Convert, CountsWhatAPinholeDoesNotImage) {
  const CalibratedCamera camera =
      Camera("kannala-brandt4", {640, 640}, {190, 190, 320, 320, 0, 0, 0, 0});
  // 320 px from the middle lie 96 degrees off the axis.
  const Conversion conversion = Convert(camera, Model("pinhole"));
  EXPECT_GT(conversion.unseen, 0);
  ExpectConsistent(conversion, camera.image_size);
  const Conversion fisheye = Convert(camera, Model("equidistant"));
  EXPECT_LT(fisheye.rms, 1e-6);
  EXPECT_EQ(fisheye.unseen, 0);
  ExpectConsistent(fisheye, camera.image_size);
}

TEST(Convert, IsOfOrdinaryCamerasAlone) {
  const CalibratedCamera camera = Camera("pinhole", {640, 480}, {500, 500, 320, 240});
  EXPECT_THAT(
      [&] { Convert(camera, Model("focused-plenoptic")); },
      ThrowsMessage<Error>(HasSubstr("focused-plenoptic is no model of an ordinary camera")));
  // Nothing of the image is before the camera.
  const CalibratedCamera nothing =
      Camera("pinhole-radtan4", {640, 480}, {500, 500, 1e7, 240, -0.2, 0, 0, 0});
  EXPECT_THAT([&] { Convert(nothing, Model("pinhole-radtan8")); },
              ThrowsMessage<Error>(HasSubstr("images hardly any pixel")));
}

}  // namespace TEST_FILE
}  // namespace plenocal
