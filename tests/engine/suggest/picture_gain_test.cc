// SPDX-License-Identifier: Apache-2.0
#include "engine/suggest/picture_gain.h"

#include <gtest/gtest.h>

#include <limits>

namespace plenocal {
namespace TEST_FILE {

PictureGain Gain(double before) {
  PictureGain pictures{.points = 62};
  pictures.gain.emplace();
  pictures.gain->sigma_before = before;
  pictures.gain->sigma_after = 0.283;
  pictures.gain->share = 0.412;
  return pictures;
}

TEST(PictureGain, IsASentenceAndNumbers) {
  EXPECT_EQ(
      PictureGainText(Gain(0.31)),
      "62 points; sigma of the projection 0.31 -> 0.28 px; it adds 41 % of what the best view "
      "would");
  const nlohmann::json json = PictureGainJson(Gain(0.31));
  EXPECT_EQ(json["points"], 62);
  EXPECT_EQ(json["words"], PictureGainText(Gain(0.31)));
  EXPECT_EQ(json["sigma_now"], 0.31);
  EXPECT_EQ(json["sigma_after"], 0.283);
  EXPECT_EQ(json["share"], 0.412);
}

TEST(PictureGain, HasNoSigmaBeforeTheImagesDetermineTheCalibration) {
  const PictureGain pictures = Gain(std::numeric_limits<double>::infinity());
  EXPECT_EQ(PictureGainText(pictures), "62 points; it adds 41 % of what the best view would");
  EXPECT_TRUE(PictureGainJson(pictures)["sigma_now"].is_null());
  EXPECT_EQ(PictureGainJson(pictures)["sigma_after"], 0.283);
}

TEST(PictureGain, IsNotKnownWithoutPoints) {
  PictureGain pictures{.points = 0, .why = {{"left", "dark"}, {"right", "blurred"}}};
  EXPECT_EQ(PictureGainText(pictures), "the target was not found; left: dark; right: blurred");
  pictures = {.points = 1};
  EXPECT_EQ(PictureGainText(pictures), "1 point: they determine no pose");
  const nlohmann::json json = PictureGainJson(pictures);
  EXPECT_EQ(json["points"], 1);
  for (const char* key : {"sigma_now", "sigma_after", "share"}) EXPECT_TRUE(json[key].is_null());
}

}  // namespace TEST_FILE
}  // namespace plenocal
