// SPDX-License-Identifier: Apache-2.0
#include "engine/json/accuracy_json.h"

#include <gtest/gtest.h>

#include <array>
#include <nlohmann/json.hpp>

namespace plenocal {
namespace TEST_FILE {

using Json = nlohmann::json;

// A pair at two distances, beyond the second of which one camera sees nothing.
RigAccuracy Pair() {
  RigAccuracy accuracy;
  accuracy.cameras = {"left", "right"};
  accuracy.grid = ImageGrid({60, 40}, 3);
  accuracy.bar = 0.25;
  accuracy.noise = {0.1, 0.2};
  accuracy.known = {"intrinsics", "extrinsics"};
  accuracy.relative_1_percent = 12;
  accuracy.open = {"left.f_x"};
  AccuracyAtDistance& at = accuracy.distances.emplace_back();
  at.distance = 2;
  at.seen_at = 0.5;
  at.cells.resize(2);
  at.cells[0].cell = 1;
  at.cells[0].z = {.noise = 3e-3, .calibration = 4e-3};
  at.cells[0].lateral = {.noise = 6e-4, .calibration = 8e-4};
  at.cells[1].cell = 5;
  at.z = {.noise = 3e-3, .calibration = 4e-3, .scale = 1e-3, .jitter = 2e-3};
  at.lateral = {.noise = 6e-4, .calibration = 8e-4};
  at.sigma_z = 5.5e-3, at.worst_z = 7e-3;
  at.sigma_lateral = 1e-3, at.worst_lateral = 2e-3;
  at.across = 1.5e-3;
  at.z_if_known = {4e-3, 5e-3};
  accuracy.distances.emplace_back().distance = 30;
  return accuracy;
}

TEST(AccuracyJson, NamesItsNumbers) {
  const std::array pair{Pair()};
  const Json json = AccuracyJson(pair, /*with_maps=*/false)[0];
  EXPECT_EQ(json["cameras"], Json::array({"left", "right"}));
  EXPECT_EQ(json["noise"], Json({{"left", 0.1}, {"right", 0.2}}));
  EXPECT_EQ(json["bar"], 0.25);
  EXPECT_EQ(json["open"], Json::array({"left.f_x"}));
  EXPECT_EQ(json["limits"],
            Json({{"calibration_equals_noise", nullptr},
                  {"relative_1_percent", 12.0},
                  {"beyond", nullptr}}));
  const Json& at = json["distances"][0];
  EXPECT_EQ(at["distance"], 2.0);
  EXPECT_EQ(at["seen_at"], 0.5);
  EXPECT_EQ(at["cells"], 2);
  EXPECT_EQ(at["z"],
            Json({{"median", 0.0055},
                  {"worst", 0.007},
                  {"noise", 0.003},
                  {"calibration", 0.004},
                  {"scale", 0.001},
                  {"jitter", 0.002}}));
  EXPECT_EQ(at["lateral"]["median"], 0.001);
  EXPECT_EQ(at["lateral"]["worst"], 0.002);
  EXPECT_EQ(at["bar_across"], 0.0015);
  EXPECT_TRUE(at["bar_along"].is_null());
  EXPECT_EQ(at["if_known"], Json({{"intrinsics", 0.004}, {"extrinsics", 0.005}}));
  EXPECT_FALSE(at.contains("map"));
  EXPECT_TRUE(json["distances"][1]["seen_at"].is_null());
}

TEST(AccuracyJson, HasMapsOfZOrOfTheLateralError) {
  std::array one{Pair()};
  const auto map = [&] { return AccuracyJson(one, /*with_maps=*/true)[0]["distances"][0]["map"]; };
  Json of_z = map();
  EXPECT_EQ(of_z["columns"], one[0].grid.Columns());
  EXPECT_EQ(of_z["rows"], one[0].grid.Rows());
  ASSERT_EQ(of_z["sigma"].size(), one[0].grid.Cells());
  EXPECT_EQ(of_z["sigma"][1], 0.005);
  EXPECT_TRUE(of_z["sigma"][0].is_null());
  one[0].has_depth = false;
  EXPECT_EQ(map()["sigma"][1], 0.001);
  EXPECT_TRUE(AccuracyJson(one, false)[0]["distances"][0]["z"].is_null());
}

TEST(AccuracyLine, IsOneSentenceADistance) {
  RigAccuracy pair = Pair();
  EXPECT_EQ(
      AccuracyLine(pair, pair.distances[0]),
      "left + right at 2 m: z 5.5 mm (noise 3, calibration 4, scale 1, jitter 2); a length of "
      "250 mm across 1.5 mm");
  EXPECT_EQ(AccuracyLine(pair, pair.distances[1]), "left + right at 30 m: not in the image of all");
  pair.has_depth = false;
  pair.distances[0].across.reset();
  EXPECT_EQ(AccuracyLine(pair, pair.distances[0]),
            "left + right at 2 m: x, y 1 mm (noise 0.6, calibration 0.8)");
}

}  // namespace TEST_FILE
}  // namespace plenocal
