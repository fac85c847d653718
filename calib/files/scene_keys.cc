// SPDX-License-Identifier: Apache-2.0
#include "calib/files/scene_keys.h"

#include <fmt/format.h>

#include <charconv>
#include <string>

namespace plenocal {
namespace {

// "point 12".
int ReadPointName(const YamlNode& node) {
  constexpr std::string_view kWord = "point ";
  const std::string text = node.AsString();
  int number = 0;
  if (text.starts_with(kWord)) {
    const char* const end = text.data() + text.size();
    const auto [rest, error] = std::from_chars(text.data() + kWord.size(), end, number);
    if (error == std::errc() && rest == end && number >= 0) return number;
  }
  node.Fail(
      fmt::format("expected 'point NUMBER' with the point's number in the tracks, got '{}'", text));
}

SceneDistance ReadSceneDistance(const YamlNode& node) {
  node.CheckKeys({"between", "value", "length", "sigma"});
  if (node.Has("value") == node.Has("length")) {
    node.Fail("give the distance once: 'value' or 'length' (m, or with a unit)");
  }
  static constexpr std::array<std::string_view, 2> kRequired{"between", "sigma"};
  node.RequireKeys(kRequired, "between: [point 12, point 40]\nsigma: 0.0005\n");
  const auto ends = node.At("between").Elements();
  if (ends.size() != 2) node.At("between").Fail("expected two points: [point 12, point 40]");
  const SceneDistance distance{.point_a = ReadPointName(ends[0]),
                               .point_b = ReadPointName(ends[1]),
                               .length = node.At(node.Has("value") ? "value" : "length").AsLength(),
                               .sigma = node.At("sigma").AsLength(),
                               .place = ends[0]};
  if (distance.point_a == distance.point_b) ends[1].Fail("is the same point; name two");
  return distance;
}

}  // namespace

SceneKeys ReadSceneKeys(const YamlNode& node) {
  node.CheckKeys({"points", "distances"});
  SceneKeys scene;
  if (node.Has("points")) {
    scene.points = node.At("points").AsInteger();
    if (scene.points < 1) node.At("points").Fail("expected a number of points");
  }
  if (!node.Has("distances")) return scene;
  for (const YamlNode& distance : node.At("distances").Elements()) {
    scene.distances.push_back(ReadSceneDistance(distance));
  }
  return scene;
}

}  // namespace plenocal
