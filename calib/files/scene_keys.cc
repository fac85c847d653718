// SPDX-License-Identifier: Apache-2.0
#include "calib/files/scene_keys.h"

#include <fmt/format.h>

#include <algorithm>
#include <charconv>
#include <functional>
#include <numbers>
#include <optional>
#include <string>
#include <string_view>
#include <utility>

#include "calib/base/error.h"
#include "calib/camera/marker_id.h"

namespace plenocal {
namespace {

constexpr int kTagPoints = 10'000'000, kTagStep = 10;
constexpr int kMostTags = 100'000;

// The number that follows `word` and a blank at the beginning of `text`, and what is left of it.
std::optional<std::pair<int, std::string_view>> NumberAfter(std::string_view word,
                                                            std::string_view text) {
  if (!text.starts_with(word) || text.substr(word.size(), 1) != " ") return std::nullopt;
  int number = 0;
  const char* const end = text.data() + text.size();
  const auto [rest, error] = std::from_chars(text.data() + word.size() + 1, end, number);
  if (error != std::errc() || number < 0) return std::nullopt;
  return std::pair(number, std::string_view(rest, static_cast<size_t>(end - rest)));
}

// "point 12", "tag 3", "tag 3 corner 0".
ScenePosition ReadScenePosition(const YamlNode& node) {
  const std::string text = node.AsString();
  if (const auto point = NumberAfter("point", text); point && point->second.empty()) {
    return {text, {point->first}};
  }
  if (const auto tag = TagPosition(text, TagPoint)) return *tag;
  node.Fail(
      fmt::format("expected 'point NUMBER' with the point's number in the tracks, 'tag ID' (its "
                  "centre) or 'tag ID corner 0' to 3, got '{}'",
                  text));
}

SceneTags ReadSceneTags(const YamlNode& node) {
  node.CheckKeys({"ids", "family", "border_bits", "size", "size_sigma"});
  static constexpr std::array<std::string_view, 2> kRequired{"ids", "family"};
  node.RequireKeys(kRequired, "family: tag36h11\nids: [3, 7]\n");
  SceneTags tags{.ids = {}, .node = node};
  for (const YamlNode& id : node.At("ids").Elements()) {
    tags.ids.push_back(id.AsInteger());
    if (tags.ids.back() < 0 || tags.ids.back() >= kMostTags) id.Fail("no tag has this id");
    if (std::ranges::count(tags.ids, tags.ids.back()) > 1) id.Fail("stands twice");
  }
  if (tags.ids.empty()) node.At("ids").Fail("name the tags that lie in the scene: [3, 7]");
  if (node.Has("size") != node.Has("size_sigma")) {
    node.Fail(
        "'size' and 'size_sigma', its standard deviation, belong together (m, or with a "
        "unit); leave out both where the size is not known");
  }
  if (node.Has("size")) {
    tags.size = node.At("size").AsLength();
    tags.size_sigma = node.At("size_sigma").AsLength();
  }
  return tags;
}

// "wall: tag 3", which YAML takes for a map within brackets.
ScenePosition ReadTargetPosition(const YamlNode& node,
                                 const std::vector<std::string_view>& targets) {
  std::string target, text;
  if (node.IsMap() && node.Entries().size() == 1) {
    target = node.Entries()[0].first;
    text = node.Entries()[0].second.AsString();
  } else {
    text = node.AsString();
    if (const size_t colon = text.find(": "); colon != std::string::npos) {
      target = text.substr(0, colon);
      text = text.substr(colon + 2);
    }
  }
  const auto found = std::ranges::find(targets, target);
  if (targets.empty() && !target.empty()) node.Fail("the only target needs no name; leave it out");
  if (!targets.empty() && found == targets.end()) {
    node.Fail(fmt::format("expected one of the targets' names first, '{}: {}'{}",
                          targets[0],
                          text,
                          SuggestName(target, targets)));
  }
  const auto corner = [](int id, int k) { return 4 * id + k; };
  std::optional<ScenePosition> position = TagPosition(text, corner);
  if (const auto marker = NumberAfter("marker", text); marker && marker->second.empty()) {
    position = ScenePosition{text, {marker->first}};
  }
  if (!position) {
    node.Fail(fmt::format(
        "expected 'marker NUMBER', 'tag ID' (its centre) or 'tag ID corner 0' to 3, got '{}'",
        text));
  }
  if (targets.empty()) return *position;
  for (int& number : position->points) {
    if (number >= MarkerId::kPerTarget) node.Fail("the target has no such marker");
    number = MarkerId{static_cast<size_t>(found - targets.begin()), number}.Number();
  }
  position->name = target + ": " + text;
  return *position;
}

SceneDistance ReadSceneDistance(const YamlNode& node,
                                const char* example,
                                const std::function<ScenePosition(const YamlNode&)>& read) {
  node.CheckKeys({"between", "value", "length", "sigma"});
  if (node.Has("value") == node.Has("length")) {
    node.Fail("give the distance once: 'value' or 'length' (m, or with a unit)");
  }
  static constexpr std::array<std::string_view, 2> kRequired{"between", "sigma"};
  node.RequireKeys(kRequired, fmt::format("between: {}\nsigma: 0.0005\n", example));
  const auto ends = node.At("between").Elements();
  if (ends.size() != 2) node.At("between").Fail(fmt::format("expected two points: {}", example));
  SceneDistance distance{.a = read(ends[0]),
                         .b = read(ends[1]),
                         .length = node.At(node.Has("value") ? "value" : "length").AsLength(),
                         .sigma = node.At("sigma").AsLength(),
                         .place = ends[0]};
  if (distance.a.points == distance.b.points) ends[1].Fail("is the same point; name two");
  return distance;
}

}  // namespace

int TagPoint(int id, int corner) { return kTagPoints + kTagStep * id + corner; }

std::vector<int> CornersOfTag(int id, int (*point)(int id, int corner)) {
  return {point(id, 0), point(id, 1), point(id, 2), point(id, 3)};
}

std::optional<ScenePosition> TagPosition(const std::string& text,
                                         int (*point)(int id, int corner)) {
  const auto tag = NumberAfter("tag", text);
  if (!tag || tag->first >= kMostTags) return std::nullopt;
  if (tag->second.empty()) return ScenePosition{text, CornersOfTag(tag->first, point)};
  const auto corner = NumberAfter(" corner", tag->second);
  if (!corner || !corner->second.empty() || corner->first >= 4) return std::nullopt;
  return ScenePosition{text, {point(tag->first, corner->first)}};
}

std::vector<SceneDistance> SizesOfTag(const SceneTags& tags, int id) {
  std::vector<SceneDistance> sizes;
  if (tags.size == 0) return sizes;
  const auto add = [&](int i, int j, double factor) {
    const auto corner = [&](int k) {
      return ScenePosition{fmt::format("tag {} corner {}", id, k), {TagPoint(id, k)}};
    };
    sizes.push_back({.a = corner(i),
                     .b = corner(j),
                     .length = factor * tags.size,
                     .sigma = factor * tags.size_sigma,
                     .common_sigma = factor * tags.size_sigma,
                     .place = tags.node});
  };
  for (int k = 0; k < 4; ++k) add(k, (k + 1) % 4, 1);
  add(0, 2, std::numbers::sqrt2);
  add(1, 3, std::numbers::sqrt2);
  return sizes;
}

SceneKeys ReadSceneKeys(const YamlNode& node) {
  node.CheckKeys({"points", "distances", "tags"});
  SceneKeys scene;
  if (node.Has("tags")) scene.tags = ReadSceneTags(node.At("tags"));
  if (node.Has("points")) {
    scene.points = node.At("points").AsInteger();
    if (scene.points < 1) node.At("points").Fail("expected a number of points");
  }
  if (!node.Has("distances")) return scene;
  for (const YamlNode& distance : node.At("distances").Elements()) {
    scene.distances.push_back(
        ReadSceneDistance(distance, "[point 12, point 40]", ReadScenePosition));
  }
  return scene;
}

std::vector<SceneDistance> ReadTargetDistances(const YamlNode& node,
                                               const std::vector<std::string_view>& targets) {
  std::vector<SceneDistance> distances;
  for (const YamlNode& distance : node.Elements()) {
    distances.push_back(
        ReadSceneDistance(distance,
                          targets.empty() ? "[tag 3, tag 7]" : "['wall: tag 3', 'wall: tag 7']",
                          [&](const YamlNode& end) { return ReadTargetPosition(end, targets); }));
  }
  return distances;
}

}  // namespace plenocal
