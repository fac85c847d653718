// SPDX-License-Identifier: Apache-2.0
#include "detectors/plenoptic/white/white_text.h"

#include <gtest/gtest.h>

#include <cmath>
#include <cstdio>
#include <string>

namespace plenocal {
namespace TEST_FILE {

WhiteCamera Camera() {
  WhiteCamera camera;
  camera.image_size = {640, 480};
  camera.images = 9;
  camera.level = 101.25;
  camera.full_scale = 255;
  camera.saturated = 0.00125;
  camera.black = 0.5;
  camera.unevenness = 0.0333;
  camera.darkest = 0.125;
  return camera;
}

const char* const kOrdinary =
    "left: 9 of 12 white images, 640 x 480 px, mean 101.2 of 255 grey values\n"
    "  saturated 0.125 %, black 50.000 % of the pixels; illumination uneven by 3.3 % from side to "
    "side\n"
    "  attenuation from 0.125 to 1\n";

TEST(WhiteText, OfAnOrdinaryCamera) { EXPECT_EQ(WhiteText("left", 12, Camera()), kOrdinary); }

TEST(WhiteText, HasTheNoise) {
  WhiteCamera camera = Camera();
  camera.noise =
      PhotonTransfer{.gain = 0.025, .gain_sigma = 0.0005, .read = 1.5, .read_sigma = 0.01};
  camera.noise->misfit = 0.1;
  const std::string noise =
      std::string(kOrdinary) +
      "  noise: variance = (1.500 +- 0.010)^2 + (0.0250 +- 0.0005) x grey value\n";
  EXPECT_EQ(WhiteText("left", 12, camera), noise);
  camera.noise->misfit = 0.25;
  const std::string misfit =
      noise +
      "  the noise deviates from this line by 25 %: these are no raw values (gamma, JPEG, noise "
      "reduction), or noise below the rounding\n";
  EXPECT_EQ(WhiteText("left", 12, camera), misfit);
  camera.noise->defects.push_back({.x = 3, .y = 7});
  EXPECT_EQ(WhiteText("left", 12, camera), misfit + "  1 defective pixel: (3, 7)\n");
  for (int i = 0; i < 8; ++i) camera.noise->defects.push_back({.x = i, .y = 0});
  EXPECT_EQ(WhiteText("left", 12, camera),
            misfit +
                "  9 defective pixels: (3, 7) (0, 0) (1, 0) (2, 0) (3, 0) (4, 0) (5, 0) (6, 0) "
                "...\n");
  camera.noise->defects.pop_back();
  EXPECT_EQ(
      WhiteText("left", 12, camera),
      misfit + "  8 defective pixels: (3, 7) (0, 0) (1, 0) (2, 0) (3, 0) (4, 0) (5, 0) (6, 0)\n");
}

TEST(WhiteText, HasTheGrid) {
  WhiteCamera camera = Camera();
  MicroLensGrid& grid = camera.grid.emplace();
  MicroLensArray& array = grid.array;
  array.types = 3;
  for (int i = 0; i < 7; ++i) array.lenses.push_back({.type = i % 3, .usable = i != 2});
  array.e_column = {20, 20 * std::tan(0.01)};
  array.e_row = {10, 17.5};
  grid.centre_rms = 0.02;
  grid.centre_sigma = 0.015;
  grid.degree = 3;
  grid.gain_spread = 0.0125;
  grid.misfit = 0.005;
  const double pitch = array.Pitch(), apart = std::atan2(17.5, 10) - 0.01;
  char line[200];
  std::snprintf(line,
                sizeof line,
                "  hexagonal lattice, pitch %.4f px, rotation %.4f deg, in the middle; rows 60 deg "
                "apart to %.3f deg\n",
                pitch,
                0.01 * 180 / M_PI,
                std::abs(60 - apart * 180 / M_PI));
  EXPECT_EQ(
      WhiteText("left", 12, camera),
      std::string(kOrdinary) + "  7 micro lenses, 1 unusable, 3 types: 3, 2, 2\n" + line +
          "  single centres about the lattice: 0.0200 px RMS, 0.0150 px robust, per coordinate "
          "(lattice bent by order 3)\n"
          "  micro images: brightness varies by 1.25 % between neighbours, profile fits to "
          "0.50 %\n");
  array.types = 1;
  for (MicroLens& lens : array.lenses) lens.type = 0;
  array.e_column = {20, 0};
  array.e_row = {0, 18};
  grid.degree = 0;
  EXPECT_EQ(WhiteText("left", 12, camera),
            std::string(kOrdinary) +
                "  7 micro lenses, 1 unusable, one type\n"
                "  rectangular lattice, pitch 20.0000 x 18.0000 px, rotation 0.0000 deg, in the "
                "middle; rows 90 deg apart to 0.000 deg\n"
                "  single centres about the lattice: 0.0200 px RMS, 0.0150 px robust, per "
                "coordinate\n"
                "  micro images: brightness varies by 1.25 % between neighbours, profile fits to "
                "0.50 %\n");
}

}  // namespace TEST_FILE
}  // namespace plenocal
